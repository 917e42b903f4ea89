/* The past of delayed expressions: polynomials over accepted steps in a ring, and the times at which they are not smooth.
 *
 * A step sees one form of each delayed value: it ends where a delayed value is not smooth, and is not longer than the shortest dead time. */
#ifndef SMPL_PAST_H
#define SMPL_PAST_H

#include "core.h"

#define WIDTH SMPL_DELAYS
#define TERMS 8
#define ROUNDING 2.220446049250313e-16

/* Part of a dead time by which a time may exceed what is recorded. */
#define SLACK 1e-9
/* Most repetitions until values that read each other at the start agree, and halvings of a step until polynomials go through its values:
 * to a part of the relative tolerance. */
#define ROUNDS 200
#define HALVINGS 8
#define PRECISION 0.01
/* Relative tolerances that a value or its rate has to change by, to jump; the part of a dead time over which a rate is looked at; the part
 * of a step in which values may be looked at instead of at its ends. */
#define JUMP 10.0
#define KINK 100.0
#define FORWARD 1e-7
#define INWARD 1e-3
/* The derivative whose jumps are left to the error test. */
#define SMOOTH 6

/* A piece of the ring: the times between which it holds, beginning and length of the polynomials' span, coefficients in Chebyshev's basis. */
enum { FROM, TO, BEGIN, LENGTH, COEFFICIENTS };

/* A place in a piece with the basis there, and the time beyond the end of what is recorded; negative before its beginning. */
typedef struct {
    const double *piece;
    double basis[TERMS], rates[TERMS], beyond;
} smpl_spot;

static double *piece_at(const smpl_instance *s, int k)
{
    return s->ring + (size_t)((s->now.first_piece + k) % SMPL_HISTORY) * SMPL_PIECE;
}

static double near_to(double time)
{
    return 2e-12 * fabs(time);
}

static const smpl_delay *call_of(int element)
{
    return &smpl_delay_table[smpl_delay_of[element]];
}

/* The place of an earlier time, which is in a piece that begins within this reach behind it. */
void smpl_find_spot(const smpl_instance *s, double at, double reach, smpl_spot *spot);
/* Value and rate there. */
double smpl_value_at(const smpl_spot *spot, int element, double *rate);
/* Forgets what no dead time reaches from a time on, and what is later than a time. */
void smpl_forget_old(smpl_instance *s, double time);
void smpl_forget_new(smpl_instance *s, double time);
/* Says that the past has no room, and returns 0. */
int smpl_past_full(smpl_instance *s, double time);
/* Returns 1 if a dead time is one that the element can have. */
int smpl_allows(smpl_instance *s, int element, double lag);
/* Finds the shortest dead time. */
void smpl_measure(smpl_instance *s);

#endif
