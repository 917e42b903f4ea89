/* An instance of the model: its vectors, and what happens at the instants of an episode. */
#ifndef SMPL_CORE_H
#define SMPL_CORE_H

#include "linear.h"
#include "tables.h"

#ifdef SMPL_BATCH
/* A batch has no log. */
#define smpl_say(...) ((void)0)
#else
#include "fmi3.h"
#endif

/* Where an instance is. */
typedef enum { INSTANTIATED, INITIALIZATION, EVENT, CONTINUOUS, STEP, TERMINATED } smpl_mode;

/* Numbers that change apart from the vectors. */
typedef struct {
    smpl_mode mode;
    double time;          /* of the FMU */
    double first, begin;  /* times at which the first and the present sampling interval begin */
    double rtol;
    double proposed, last_error; /* length and error of the last step of the solver */
    long steps;           /* sampling intervals that are over */
    int initialised;      /* initial values are those of the parameters */
    int open;             /* the present sampling interval has begun */
    int prepared;         /* `w` is that of the inputs and parameters */
    int consistent;       /* algebraic variables and rates are those of the state */
    int rejected;
    int ended;            /* a failure */
    int goes_on;          /* failures end nothing */
    int parameters_set;
#if SMPL_DELAYS
    int recorded;            /* delayed values are those of the record, and not those before the start */
    int begun;               /* the integration goes on where it has ended */
    int first_piece, pieces; /* the oldest piece of the ring, and how many there are */
    int marks;               /* places at which recorded values are not smooth */
    int cut_off;             /* older pieces have been given up */
    double began, left;      /* the time at which the integration began, up to which breaks are behind */
    double crossed;          /* the break that was crossed there */
    double shortest;         /* dead time */
#endif
} smpl_progress;

/* What is kept from instant to instant: one block of numbers. */
#define SMPL_KEPT \
    (2 * MODEL_UNKNOWNS + 2 * MODEL_ACTIONS + 2 * MODEL_PARAMETERS + MODEL_CONTEXT + 2 * SMPL_ROOTS + 2 * SMPL_DELAYS)

/* Numbers of a piece of the past: its times, and polynomials of degree 7. */
#define SMPL_PIECE (4 + 8 * (size_t)SMPL_DELAYS)

typedef struct {
    smpl_progress now;
#ifndef SMPL_BATCH
    int co_simulation, logging;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    double *memory; /* what the instance was placed in */
#endif
    double *kept;                 /* what is kept from instant to instant: the first SMPL_KEPT numbers of the block */
    double *y, *yp;               /* unknowns in the order of the model, and rates */
    double *u, *u_before;         /* actions, and those that were in force at the end of the last interval */
    double *p, *p_set, *c;        /* the model's parameters, 1 for those that were given, context */
    double *holds, *passed;       /* conditions of events that hold; that the solver has found to become true */
    double *u_used, *w, *outputs, *observations, *roots, *ahead, *failures, *partials;
    double *f, *delta, *trial, *trial_p, *zero;
    double *j0, *j1, *matrix, *seed, *p2, *y2, *yp2;
#if SMPL_DELAYS
    double *lags, *sizes;         /* dead times, largest sizes of recorded values: kept, too */
    double *ring, *marks;         /* pieces, and times with the derivative that jumps there */
    double *lags_now, *delayed, *seen, *near, *far, *samples, *past_y, *past_p;
    int lost;                     /* 1 + the element whose past was asked for and is not kept any more */
#endif
    double *stages, *place, *place_p, *end, *end_p, *right, *slope, *terms;
    smpl_lu lu;
} smpl_instance;

#ifndef SMPL_BATCH
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
fmi3Status smpl_say(smpl_instance *s, fmi3Status status, const char *format, ...);
#endif

/* Lays out an instance in a block of numbers, or measures it without one. Returns the length of the block, which begins with what is
 * kept from instant to instant. */
size_t smpl_place(smpl_instance *s, double *block);
void smpl_reset(smpl_instance *s);
void smpl_stale(smpl_instance *s);

/* The model's time at a time of the FMU. */
double smpl_clock(const smpl_instance *s, double time);
double smpl_next_sample(const smpl_instance *s);
double smpl_next_break(smpl_instance *s, double time, double limit);

int smpl_initialise(smpl_instance *s);
int smpl_parameters(smpl_instance *s);
int smpl_refresh(smpl_instance *s);
int smpl_consistent(smpl_instance *s, double clock, double *y, double *yp);
int smpl_rate_matrix(smpl_instance *s, double clock, const double *y, const double *yp);
void smpl_prepare(smpl_instance *s);

int smpl_sample_start(smpl_instance *s);
int smpl_sample_end(smpl_instance *s);
int smpl_events(smpl_instance *s, int *changed);
void smpl_roots(smpl_instance *s, double clock, const double *y, const double *yp, double *out);

/* The residual, with what was a dead time ago. */
void smpl_residual(smpl_instance *s, double clock, const double *y, const double *yp, double *out);

#if SMPL_DELAYS
/* Makes delayed values those at a point. */
void smpl_look_back(smpl_instance *s, double clock, const double *y, const double *yp, int strictly);
int smpl_past_start(smpl_instance *s);
int smpl_past_begin(smpl_instance *s, double crossed);
int smpl_past_record(smpl_instance *s, double t, double h, double to);
double smpl_past_break(const smpl_instance *s);
size_t smpl_past_save(const smpl_instance *s, double *out);
void smpl_past_restore(smpl_instance *s, const double *from);
int smpl_say_lost(smpl_instance *s);
#else
#define smpl_look_back(...) ((void)0)
#endif

/* State and rates within the last step, which began at the present state. */
void smpl_interpolate(const smpl_instance *s, double share, double h, double *y, double *yp);

/* Integrates to a time within the present sampling interval; 0 where it cannot. */
int smpl_integrate(smpl_instance *s, double to);

#endif
