/* What happens at the instants of an episode: initial values, sampling, events; consistent algebraic variables and rates. */
#include "core.h"

#include <math.h>
#include <string.h>

#define N MODEL_UNKNOWNS

/* A part of a block behind what is used of it; nowhere while the block is only measured. */
static double *take(double *block, size_t *used, size_t length)
{
    double *part = block ? block + *used : NULL;
    *used += length;
    return part;
}

size_t smpl_place(smpl_instance *s, double *block)
{
    size_t used = 0;
    s->kept = s->y = take(block, &used, N);
    s->yp = take(block, &used, N);
    s->u = take(block, &used, MODEL_ACTIONS);
    s->u_before = take(block, &used, MODEL_ACTIONS);
    s->p = take(block, &used, MODEL_PARAMETERS);
    s->p_set = take(block, &used, MODEL_PARAMETERS);
    s->c = take(block, &used, MODEL_CONTEXT);
    s->holds = take(block, &used, SMPL_ROOTS);
    s->passed = take(block, &used, SMPL_ROOTS);
#if SMPL_DELAYS
    s->lags = take(block, &used, SMPL_DELAYS);
    s->sizes = take(block, &used, SMPL_DELAYS);
    s->marks = take(block, &used, 2 * (size_t)SMPL_HISTORY);
    s->lags_now = take(block, &used, SMPL_DELAYS);
    s->delayed = take(block, &used, SMPL_DELAYS);
    s->seen = take(block, &used, SMPL_DELAYS);
    s->near = take(block, &used, SMPL_DELAYS);
    s->far = take(block, &used, SMPL_DELAYS);
    s->samples = take(block, &used, 8 * (size_t)SMPL_DELAYS);
    s->past_y = take(block, &used, N);
    s->past_p = take(block, &used, N);
    s->ring = take(block, &used, SMPL_HISTORY * SMPL_PIECE);
#endif
    s->u_used = take(block, &used, MODEL_ACTIONS);
    s->w = take(block, &used, MODEL_WORK);
    s->outputs = take(block, &used, MODEL_OUTPUTS);
    s->observations = take(block, &used, SMPL_OBSERVATIONS);
    s->roots = take(block, &used, SMPL_ROOTS);
    s->ahead = take(block, &used, SMPL_ROOTS);
    s->failures = take(block, &used, 2 * SMPL_FAILURES);
    s->partials = take(block, &used, SMPL_PARTIALS);
    s->f = take(block, &used, N);
    s->delta = take(block, &used, N);
    s->trial = take(block, &used, N);
    s->trial_p = take(block, &used, N);
    s->zero = take(block, &used, N);
    s->j0 = take(block, &used, MODEL_NONZEROS);
    s->j1 = take(block, &used, MODEL_NONZEROS);
    s->matrix = take(block, &used, MODEL_NONZEROS);
    s->seed = take(block, &used, SMPL_PARTIAL_COLUMNS + SMPL_PARTIAL_ROWS);
    s->p2 = take(block, &used, MODEL_PARAMETERS);
    s->y2 = take(block, &used, N);
    s->yp2 = take(block, &used, N);
    s->stages = take(block, &used, 16 * (size_t)N);
    s->place = take(block, &used, N);
    s->place_p = take(block, &used, N);
    s->end = take(block, &used, N);
    s->end_p = take(block, &used, N);
    s->right = take(block, &used, N);
    s->slope = take(block, &used, N);
    s->terms = take(block, &used, 5 * (size_t)N);
    block = block ? block + used : NULL;
    return used + smpl_lu_place(&s->lu, N, model_jacobian_columns, model_jacobian_rows, smpl_order, SMPL_L_ROOM, SMPL_U_ROOM, block);
}

void smpl_reset(smpl_instance *s)
{
    memset(&s->now, 0, sizeof s->now);
    memset(s->kept, 0, SMPL_KEPT * sizeof(double));
    s->now.rtol = SMPL_RTOL;
    for (int i = 0; i < MODEL_STATES; ++i) s->y[i] = model_states_table[i].nominal;
    for (int i = MODEL_STATES; i < N; ++i) s->y[i] = model_algebraic_table[i - MODEL_STATES].nominal;
    for (int i = 0; i < MODEL_ACTIONS; ++i) s->u[i] = s->u_before[i] = model_actions_table[i].nominal;
    for (int i = 0; i < MODEL_PARAMETERS; ++i) s->p[i] = model_parameters_table[i].nominal;
    for (int i = 0; i < MODEL_CONTEXT; ++i) s->c[i] = model_context_table[i].nominal;
}

/* Inputs, parameters or states have changed. */
void smpl_stale(smpl_instance *s)
{
    s->now.prepared = s->now.consistent = 0;
#if SMPL_DELAYS
    s->now.begun = 0;
#endif
}

void smpl_residual(smpl_instance *s, double clock, const double *y, const double *yp, double *out)
{
    smpl_look_back(s, clock, y, yp, 0);
    model_residual(clock, y, yp, s->u_used, s->p, s->w, out);
}

double smpl_clock(const smpl_instance *s, double time)
{
    return s->now.begin + (time - s->now.begin) * SMPL_PACE;
}

double smpl_next_sample(const smpl_instance *s)
{
    return s->now.first + (double)(s->now.steps + 1) * SMPL_STEP;
}

static void set_builtin(smpl_instance *s, int which, double value)
{
    for (int i = 0; i < SMPL_BUILTINS; ++i) {
        if (smpl_builtins[i].which == which) (smpl_builtins[i].in_p ? s->p : s->c)[smpl_builtins[i].at] = value;
    }
}

/* Copies of what was, at the start of the episode (0) or of the step (1). */
static void keep(smpl_instance *s, int instant)
{
    for (int i = 0; i < SMPL_COPIES; ++i) {
        const smpl_copy *copy = &smpl_copies[i];
        const double *from = copy->from == SMPL_Y ? s->y : copy->from == SMPL_U ? s->u_before : s->p;
        if (copy->instant == instant) (copy->in_p ? s->p : s->c)[copy->at] = from[copy->from_at];
    }
}

/* What actions and parameters determine. */
void smpl_prepare(smpl_instance *s)
{
    if (s->now.prepared) return;
    for (int i = 0; i < MODEL_ACTIONS; ++i) {
        const double scale = model_actions_table[i].scale;
        s->u_used[i] = SMPL_SINGLE ? (double)(float)(s->u[i] / scale) * scale : s->u[i];
    }
    model_prepare(s->u_used, s->p, s->w);
    s->now.prepared = 1;
    s->now.consistent = 0;
}

/* Root mean square of a correction of rates and algebraic variables, in tolerances. */
static double size_of(const smpl_instance *s, const double *delta, const double *y, const double *yp)
{
    double sum = 0.0;
    for (int i = 0; i < N; ++i) {
        const double scale = i < MODEL_STATES ? smpl_scale[i] / SMPL_STEP : smpl_scale[i];
        const double now = i < MODEL_STATES ? yp[i] : y[i];
        const double part = delta[i] / (s->now.rtol * (fabs(now) + SMPL_ATOL_FACTOR * scale));
        sum += part * part;
    }
    return sqrt(sum / (N > 0 ? N : 1));
}

/* Factorises the derivatives by rates and algebraic variables. */
int smpl_rate_matrix(smpl_instance *s, double clock, const double *y, const double *yp)
{
    smpl_look_back(s, clock, y, yp, 0);
    model_jacobian(clock, y, yp, 0.0, s->u_used, s->p, s->w, s->j0);
    model_jacobian(clock, y, yp, 1.0, s->u_used, s->p, s->w, s->j1);
    for (int j = 0; j < N; ++j) {
        for (int k = model_jacobian_columns[j]; k < model_jacobian_columns[j + 1]; ++k) {
            s->matrix[k] = j < MODEL_STATES ? s->j1[k] - s->j0[k] : s->j0[k];
        }
    }
    return smpl_lu_factorise(&s->lu, s->matrix);
}

/* The names of the unknowns. */
static const char *name_of(int unknown)
{
    return unknown < MODEL_STATES ? model_states_table[unknown].name : model_algebraic_table[unknown - MODEL_STATES].name;
}

/* Algebraic variables and rates by Newton's method, damped while it does not come nearer. */
int smpl_consistent(smpl_instance *s, double clock, double *y, double *yp)
{
    double size;
    if (!SMPL_IMPLICIT && N == MODEL_STATES) {
        smpl_residual(s, clock, y, s->zero, yp);
        return 1;
    }
    for (int i = MODEL_STATES; i < N; ++i) yp[i] = 0.0;
    smpl_residual(s, clock, y, yp, s->f);
    for (int iteration = 0; iteration < 100; ++iteration) {
        const int singular = smpl_rate_matrix(s, clock, y, yp);
        double damping = 1.0, next = INFINITY;
        if (singular) {
            smpl_say(s, fmi3Error, "time %.15g: the equations do not determine `%s`", clock, singular > 0 ? name_of(singular - 1) : "");
            return 0;
        }
        memcpy(s->delta, s->f, sizeof(double) * N);
        smpl_lu_solve(&s->lu, s->delta);
        size = size_of(s, s->delta, y, yp);
        while (damping > 1e-15) {
            memcpy(s->trial, y, sizeof(double) * N);
            memcpy(s->trial_p, yp, sizeof(double) * N);
            for (int i = 0; i < MODEL_STATES; ++i) s->trial_p[i] -= damping * s->delta[i];
            for (int i = MODEL_STATES; i < N; ++i) s->trial[i] -= damping * s->delta[i];
            smpl_residual(s, clock, s->trial, s->trial_p, s->f);
            memcpy(s->end_p, s->f, sizeof(double) * N);
            smpl_lu_solve(&s->lu, s->end_p);
            next = size_of(s, s->end_p, y, yp);
            if (next <= (1.0 - 0.5 * damping) * size || size <= 1e-3) break;
            damping *= 0.5;
        }
        if (!(size <= 1e-3) && !(next < size)) break;
        memcpy(y, s->trial, sizeof(double) * N);
        memcpy(yp, s->trial_p, sizeof(double) * N);
        /* The next correction would be the square of this one. */
        if (size <= 1e-3) return 1;
    }
    smpl_say(s, fmi3Error, "time %.15g: the algebraic equations have no solution that can be found", clock);
    return 0;
}

int smpl_refresh(smpl_instance *s)
{
    smpl_prepare(s);
    if (s->now.consistent) return 1;
    if (!smpl_consistent(s, smpl_clock(s, s->now.time), s->y, s->yp)) return 0;
    s->now.consistent = 1;
    return 1;
}

/* Computed parameters that were not given. */
int smpl_parameters(smpl_instance *s)
{
#if SMPL_HAS_parameters
    for (int i = 0; i < SMPL_GIVENS; ++i) {
        if (s->p_set[smpl_givens[i].parameter] > 0.0) (smpl_givens[i].in_p ? s->p : s->c)[smpl_givens[i].at] = 1.0;
    }
    model_parameters(smpl_clock(s, s->now.time), s->y, s->u_used, s->p, s->c);
#endif
    s->now.prepared = s->now.consistent = 0;
    return 1;
}

/* Start values are those of the description, or given; what follows from them is worked out. */
int smpl_initialise(smpl_instance *s)
{
    smpl_progress *now = &s->now;
    double *inputs = s->u;
    int ok;
    if (now->initialised) return 1;
    /* As in an environment the episode begins with the actions' defaults; the first step has its own. */
    s->u = s->u_before;
    set_builtin(s, 0, floor(now->first / SMPL_STEP + 0.5));
    set_builtin(s, 1, now->first);
    set_builtin(s, 2, now->first);
    smpl_stale(s);
    smpl_prepare(s);
    if (now->parameters_set) smpl_parameters(s);
#if SMPL_DELAYS
    now->recorded = 0;
    memset(s->seen, 0, SMPL_DELAYS * sizeof(double));
    ok = smpl_refresh(s) && smpl_past_start(s);
#else
    ok = smpl_refresh(s);
#endif
    keep(s, 0);
    keep(s, 1);
    s->u = inputs;
    smpl_stale(s);
    now->initialised = ok;
    return ok && smpl_refresh(s);
}

int smpl_sample_start(smpl_instance *s)
{
    smpl_progress *now = &s->now;
    const double clock = now->first + (double)now->steps * SMPL_STEP;
    keep(s, 1);
    memcpy(s->u_before, s->u, sizeof(double) * MODEL_ACTIONS);
    now->begin = clock;
    now->open = 1;
    set_builtin(s, 0, floor(now->first / SMPL_STEP + 0.5) + (double)now->steps);
    set_builtin(s, 1, clock);
    set_builtin(s, 2, clock);
    now->prepared = 0;
    smpl_prepare(s);
    smpl_look_back(s, clock, s->y, s->yp, 0);
#if SMPL_HAS_disturb
    for (int i = 0; i < SMPL_MOVABLES; ++i) s->p2[i] = s->p[smpl_movables[i]];
    model_disturb(clock, s->y, s->u_used, s->p, s->c);
    for (int i = 0; i < SMPL_MOVABLES; ++i) {
        if (s->p_set[smpl_movables[i]] > 0.0) s->p[smpl_movables[i]] = s->p2[i];
    }
#endif
#if SMPL_HAS_start
    model_start(clock, s->y, s->u_used, s->p, s->c);
#endif
    smpl_stale(s);
    return smpl_refresh(s);
}

/* Failures that are looked for at sampling instants. */
static void find_failures(smpl_instance *s, double clock)
{
    (void)s, (void)clock;
#if SMPL_HAS_failures
    smpl_look_back(s, clock, s->y, s->yp, 0);
    model_failures(clock, s->y, s->yp, s->u_used, s->p, s->c, s->failures);
    for (int i = 0; i < SMPL_FAILURES; ++i) {
        if (s->failures[2 * i] == 1.0 && !s->now.goes_on && !s->now.ended) {
            s->now.ended = 1;
            smpl_say(s, fmi3Warning, "time %.15g: failure %s", clock, smpl_failure_names[i]);
        }
    }
#endif
}

int smpl_sample_end(smpl_instance *s)
{
    const double clock = smpl_clock(s, s->now.time);
    smpl_prepare(s);
#if SMPL_HAS_end
    smpl_look_back(s, clock, s->y, s->yp, 0);
    model_end(clock, s->y, s->u_used, s->p, s->c);
#endif
    smpl_stale(s);
    if (!smpl_refresh(s)) return 0;
    find_failures(s, clock);
    s->now.open = 0;
    ++s->now.steps;
    return 1;
}

void smpl_roots(smpl_instance *s, double clock, const double *y, const double *yp, double *out)
{
    (void)s, (void)clock, (void)y, (void)yp, (void)out;
#if SMPL_HAS_events
    smpl_look_back(s, clock, y, yp, 0);
    model_events(clock, y, yp, s->u_used, s->p, s->w, out);
#endif
}

double smpl_next_break(smpl_instance *s, double time, double limit)
{
    double next = INFINITY;
    (void)s, (void)time, (void)limit;
#if SMPL_HAS_next_break
    const double end = smpl_clock(s, limit), near = 2e-12 * fmax(fabs(smpl_clock(s, time)), fabs(end));
    double from = smpl_clock(s, time) + near, width = near;
    smpl_prepare(s);
    for (int tries = 0; tries < 64 && from <= end; ++tries) {
        model_next_break(from, s->y, s->yp, s->u_used, s->p, s->c, &next);
        if (!(next <= from)) break;
        from += width;
        width *= 2.0;
        next = INFINITY;
    }
    next = s->now.begin + (next - smpl_clock(s, s->now.begin)) / SMPL_PACE;
#endif
    return next;
}

/* How far ahead the motion of a condition is looked for, over the sampling interval, and how much of it counts as now. */
#define AHEAD 1e-7
#define AT_ONCE 1e-3

/* Conditions at the present state; which of them became true. */
static int settle(smpl_instance *s, int *fired)
{
    const double clock = smpl_clock(s, s->now.time), step = AHEAD * SMPL_STEP * SMPL_PACE;
    int found = 0;
    if (!smpl_refresh(s)) return -1;
    smpl_roots(s, clock, s->y, s->yp, s->roots);
    for (int i = 0; i < N; ++i) s->y2[i] = s->y[i] + step * (i < MODEL_STATES ? s->yp[i] : 0.0);
    memcpy(s->yp2, s->yp, sizeof(double) * N);
    if (!smpl_consistent(s, clock + step, s->y2, s->yp2)) return -1;
    smpl_roots(s, clock + step, s->y2, s->yp2, s->ahead);
    for (int i = 0; i < SMPL_ROOTS; ++i) {
        const double value = s->roots[i], motion = s->ahead[i] - value, near = AT_ONCE * fabs(motion);
        int holds = value > 0.0;
        if (isnan(value)) continue;
        if (s->passed[i] > 0.0 || fabs(value) <= near) holds = motion > 0.0 || (motion == 0.0 && value >= 0.0);
        else if (value == 0.0) holds = !smpl_root_table[i].strict;
        fired[i] = holds && !(s->holds[i] > 0.0);
        found |= fired[i];
        s->holds[i] = holds;
        s->passed[i] = 0.0;
    }
    return found;
}

/* Runs what the events at this instant ask for; `changed` says whether one did. */
int smpl_events(smpl_instance *s, int *changed)
{
    int fired[SMPL_ROOTS + 1] = {0};
    for (int round = 0; SMPL_ROOTS > 0; ++round) {
        const int found = settle(s, fired);
        const double clock = smpl_clock(s, s->now.time);
        if (found < 0) return 0;
        if (!found) break;
        if (round >= SMPL_MAX_EVENTS) {
            smpl_say(s, fmi3Error, "time %.15g: events follow one another without end", clock);
            return 0;
        }
        set_builtin(s, 1, clock);
        smpl_look_back(s, clock, s->y, s->yp, 0);
        for (int i = 0; i < SMPL_ROOTS; ++i) {
            if (!fired[i]) continue;
            smpl_say(s, fmi3OK, "time %.15g: event %s", clock, smpl_root_table[i].name);
            if (smpl_root_table[i].kind == SMPL_FAILS && !s->now.goes_on) {
                smpl_say(s, fmi3Warning, "time %.15g: failure %s", clock, smpl_root_table[i].name);
                s->now.ended = 1;
            }
            if (smpl_root_table[i].kind == SMPL_SUCCEEDS && !s->now.goes_on) {
                smpl_say(s, fmi3OK, "time %.15g: success %s", clock, smpl_root_table[i].name);
                s->now.ended = 1;
            }
            if (smpl_root_table[i].kind == SMPL_RUNS) {
                smpl_run_event(smpl_root_table[i].program, clock, s->y, s->u_used, s->p, s->c);
                *changed = 1;
            }
        }
        set_builtin(s, 1, smpl_clock(s, s->now.begin));
        smpl_stale(s);
        if (s->now.ended) break;
    }
    return smpl_refresh(s);
}
