/* Times at which delayed values are not smooth: a dead time behind those of recorded values. */
#include "past.h"

#include <math.h>
#include <string.h>

#define N MODEL_UNKNOWNS

/* Notes a place at which the derivative of this order jumps. 0 where there is no room. */
static int mark(smpl_instance *s, double time, int level)
{
    if (level >= SMOOTH) return 1;
    for (int k = s->now.marks - 1; k >= 0; --k) {
        if (fabs(s->marks[2 * k] - time) <= near_to(time)) {
            s->marks[2 * k + 1] = fmin(s->marks[2 * k + 1], level);
            return 1;
        }
    }
    if (s->now.marks == SMPL_HISTORY) return smpl_past_full(s, time);
    s->marks[2 * s->now.marks] = time;
    s->marks[2 * s->now.marks + 1] = level;
    ++s->now.marks;
    return 1;
}

/* Returns 1 if an element has the dead time of one before it: its breaks are the same. */
static int repeats(const smpl_instance *s, int element)
{
    if (call_of(element)->varies) return 1;
    for (int e = element - 1; e >= 0; --e) {
        if (!call_of(e)->varies && s->lags[e] == s->lags[element]) return 1;
    }
    return 0;
}

/* The next time at which a delayed value is not smooth: a dead time behind a mark. */
double smpl_past_break(const smpl_instance *s)
{
    double next = INFINITY;
    for (int e = 0; e < WIDTH && s->now.marks > 0; ++e) {
        if (repeats(s, e)) continue;
        for (int k = 0; k < s->now.marks; ++k) {
            const double at = s->marks[2 * k] + s->lags[e];
            if (at > s->now.left) next = fmin(next, at);
        }
    }
    return next;
}

/* Breaks up to a time are left behind: unknowns have a kink there, one derivative smoother. Values that are delayed and read delayed ones
 * jump as these do. */
static int leave_breaks(smpl_instance *s, double reach)
{
    for (int k = 0; k < s->now.marks; ++k) {
        for (int e = 0; e < WIDTH; ++e) {
            const double at = s->marks[2 * k] + s->lags[e];
            if (!(at > s->now.left && at <= reach) || repeats(s, e)) continue;
            if (!mark(s, at, (int)s->marks[2 * k + 1] + (SMPL_DELAYS_FOLLOW ? 0 : 1))) return 0;
        }
    }
    s->now.left = reach;
    return 1;
}

/* An integration begins at the present state, which may not be consistent yet; `crossed` is the break behind which it does. */
static int begin(smpl_instance *s, double crossed)
{
    smpl_progress *now = &s->now;
    const double t = smpl_clock(s, now->time), reach = t + near_to(t);
    int moved = 0, kept = 0;
    now->crossed = crossed;
    now->began = t;
    now->consistent = 0;
    smpl_forget_new(s, t);
    /* Steps on both sides of an event: the piece before them continues. */
    while (now->pieces > 1 && piece_at(s, now->pieces - 1)[TO] - piece_at(s, now->pieces - 1)[FROM] <= SLACK * now->shortest) --now->pieces;
    for (int k = 0; k < now->marks; ++k) {
        if (s->marks[2 * k] > reach) continue;
        s->marks[2 * kept] = s->marks[2 * k];
        s->marks[2 * kept + 1] = s->marks[2 * k + 1];
        ++kept;
    }
    now->marks = kept;
    now->left = fmin(now->left, reach);
    smpl_forget_old(s, t);
    model_lags(t, s->y, s->yp, s->u_used, s->p, s->w, s->lags_now);
    for (int e = 0; e < WIDTH; ++e) {
        if (call_of(e)->varies || s->lags_now[e] == s->lags[e]) continue;
        if (!smpl_allows(s, e, s->lags_now[e])) return 0;
        s->lags[e] = s->lags_now[e];
        moved = 1;
        if (t - s->lags[e] < piece_at(s, 0)[FROM] - SLACK * s->lags[e] && (now->cut_off || call_of(e)->before)) {
            s->lost = 1 + e;
            smpl_say_lost(s);
            return 0;
        }
    }
    if (!moved) return leave_breaks(s, reach);
    /* The dead times are others: breaks follow from the marks anew. */
    smpl_measure(s);
    now->left = reach;
    return 1;
}

/* An integration has begun at the present state: notes whether delayed expressions jump there, or have a kink. */
static int note_jumps(smpl_instance *s)
{
    smpl_progress *now = &s->now;
    const double t = smpl_clock(s, now->time), ahead = fmax(FORWARD * now->shortest, 1e3 * ROUNDING * fabs(t));
    double *later[2] = {s->near, s->far};
    int level = SMOOTH;
    smpl_spot spot;
    smpl_look_back(s, t, s->y, s->yp, 0);
    model_delayed(t, s->y, s->yp, s->u_used, s->p, s->w, s->delayed);
    for (int j = 0; j < 2; ++j) {
        const double far = (j + 1) * ahead;
        for (int i = 0; i < N; ++i) s->past_y[i] = s->y[i] + (i < MODEL_STATES ? far * s->yp[i] : 0.0);
        memcpy(s->past_p, s->yp, sizeof(double) * N);
        if (SMPL_DELAYS_FOLLOW && !smpl_consistent(s, t + far, s->past_y, s->past_p)) return 0;
        smpl_look_back(s, t + far, s->past_y, s->past_p, 0);
        model_delayed(t + far, s->past_y, s->past_p, s->u_used, s->p, s->w, later[j]);
    }
    smpl_look_back(s, t, s->y, s->yp, 0);
    smpl_find_spot(s, piece_at(s, now->pieces - 1)[TO], 0.0, &spot);
    for (int e = 0; e < WIDTH; ++e) {
        double slope, first = s->delayed[e], rate = (s->near[e] - first) / ahead;
        const double before = smpl_value_at(&spot, e, &slope), size = now->rtol * fmax(s->sizes[e], fabs(first)), jump = fabs(s->near[e] - first);
        /* A condition at its threshold is of one value there and of the other one behind it. */
        if (jump > JUMP * size && fabs(s->far[e] - s->near[e]) < 0.5 * jump) {
            first = s->near[e];
            rate = (s->far[e] - s->near[e]) / ahead;
        }
        if (fabs(first - before) > JUMP * size) level = 0;
        else if (level > 1 && fabs(rate - slope) * s->lags[e] > KINK * size) level = 1;
    }
    return mark(s, isnan(now->crossed) ? t : now->crossed, level);
}

int smpl_past_begin(smpl_instance *s, double crossed)
{
    if (s->now.begun && isnan(crossed)) return 1;
    smpl_prepare(s);
    if (!begin(s, crossed) || !smpl_refresh(s) || !note_jumps(s)) return 0;
    s->now.begun = 1;
    return 1;
}
