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

/* Numbers that change beside the vectors. */
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
} smpl_progress;

/* What is kept from instant to instant: one block of numbers. */
#define SMPL_KEPT (2 * MODEL_UNKNOWNS + 2 * MODEL_ACTIONS + 2 * MODEL_PARAMETERS + MODEL_CONTEXT + 2 * SMPL_ROOTS)

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

/* Integrates to a time within the present sampling interval; 0 where it cannot. */
int smpl_integrate(smpl_instance *s, double to);

#endif
