/* The form of the tables that describe a model. */
#ifndef SMPL_TYPES_H
#define SMPL_TYPES_H

/* What holds a variable. */
typedef enum {
    SMPL_TIME, SMPL_Y, SMPL_Z, SMPL_YP, SMPL_U, SMPL_P, SMPL_OUT, SMPL_OBSERVED, SMPL_EVENT, SMPL_SWITCH, SMPL_SOURCES
} smpl_source;

/* When it may be set: never, at any time, before the start, between steps too, never since it is a part of the FMU. */
typedef enum { SMPL_CALCULATED, SMPL_INPUT, SMPL_START, SMPL_STATE, SMPL_RESET_STATE, SMPL_PARAMETER, SMPL_SHAPED } smpl_role;

/* A variable: its elements are at `places[first]`, ... of what holds it. */
typedef struct {
    smpl_source source;
    smpl_role role;
    int first, count;
} smpl_variable;

/* A value at another instant: 0 the start of the episode, 1 the end of the last step. */
typedef struct {
    int instant, in_p, at;
    smpl_source from;
    int from_at;
} smpl_copy;

/* Completed steps (0) or the clock (1). */
typedef struct {
    int which, in_p, at;
} smpl_builtin;

/* Whether a parameter is given. */
typedef struct {
    int parameter, in_p, at;
} smpl_given;

/* Where a number of a delayed value is read: an element of p or c; nowhere below 0. */
typedef struct {
    int in_p, at;
} smpl_slot;

/* A call of `delay`: its dead time changes at any time; there are values before the start; the longest dead time of one that changes. */
typedef struct {
    const char *name;
    int varies, before;
    double most;
} smpl_delay;

/* What an event does. */
typedef enum { SMPL_FAILS, SMPL_RUNS, SMPL_RESTARTS, SMPL_SUCCEEDS } smpl_action;

/* The condition of an event. */
typedef struct {
    const char *name;
    smpl_action kind;
    int program, strict;
} smpl_root;

#endif
