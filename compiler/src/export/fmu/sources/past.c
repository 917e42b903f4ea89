/* The ring of polynomials: records steps, and looks up what was a dead time ago. */
#include "past.h"

#include <math.h>
#include <string.h>

#define N MODEL_UNKNOWNS

/* The source of samples: the values before the start, or the last step, which began at t. */
typedef struct {
    int of_step;
    double t, h;
} smpl_span;

/* cos(pi k / 7), and the extrema of a Chebyshev polynomial as parts of a span. */
static const double cosines[14] = {
    1.0, 0.9009688679024191, 0.6234898018587336, 0.2225209339563144, -0.2225209339563144, -0.6234898018587336, -0.9009688679024191,
    -1.0, -0.9009688679024191, -0.6234898018587336, -0.2225209339563144, 0.2225209339563144, 0.6234898018587336, 0.9009688679024191};
static const double shares[TERMS] = {
    0.0, 0.04951556604879048, 0.1882550990706332, 0.3887395330218428, 0.6112604669781572, 0.8117449009293668, 0.9504844339512095, 1.0};

/* The element of p or c that holds a number of a delayed value: 0 the value, 1 its rate, 2 the earlier time. */
static void put(smpl_instance *s, int element, int which, double value)
{
    const smpl_slot *slot = &smpl_slots[3 * element + which];
    if (slot->at >= 0) (slot->in_p ? s->p : s->c)[slot->at] = value;
}

/* The longest dead time that an element may have while what is older is given up. */
static double reach_of(const smpl_instance *s, int element)
{
    const double most = call_of(element)->most;
    return isfinite(most) ? fmax(most, s->lags[element]) : s->lags[element];
}

/* The place of an earlier time, which is in a piece that begins within this reach behind it. */
void smpl_find_spot(const smpl_instance *s, double at, double reach, smpl_spot *spot)
{
    int low = 0, high = s->now.pieces;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (piece_at(s, middle)[FROM] <= at + reach) low = middle + 1;
        else high = middle;
    }
    const int k = low > 0 ? low - 1 : 0;
    const double *piece = piece_at(s, k), end = k + 1 == s->now.pieces ? piece[TO] : INFINITY;
    const double x = 2.0 * (fmax(fmin(at, end), piece[FROM]) - piece[BEGIN]) / piece[LENGTH] - 1.0, slope = 2.0 / piece[LENGTH];
    spot->piece = piece;
    spot->beyond = at < piece[FROM] && k == 0 ? at - piece[FROM] : fmax(at - end, 0.0);
    spot->basis[0] = 1.0, spot->basis[1] = x;
    spot->rates[0] = 0.0, spot->rates[1] = slope;
    for (int n = 2; n < TERMS; ++n) {
        spot->basis[n] = 2.0 * x * spot->basis[n - 1] - spot->basis[n - 2];
        spot->rates[n] = 2.0 * (slope * spot->basis[n - 1] + x * spot->rates[n - 1]) - spot->rates[n - 2];
    }
}

/* Value and rate there; beyond the end they go on along a straight line, before the beginning the value stays. */
double smpl_value_at(const smpl_spot *spot, int element, double *rate)
{
    const double *terms = spot->piece + COEFFICIENTS + (size_t)element * TERMS;
    double now = 0.0;
    *rate = 0.0;
    for (int n = TERMS - 1; n >= 0; --n) {
        now += terms[n] * spot->basis[n];
        *rate += terms[n] * spot->rates[n];
    }
    if (spot->beyond < 0.0) *rate = 0.0;
    return spot->beyond > 0.0 ? now + spot->beyond * *rate : now;
}

/* Delayed values without a record: the present ones, or those before the start; repeatedly, where they read each other. Returns by how much
 * they differ in the last two repetitions, in parts of themselves. */
static double look_at_present(smpl_instance *s, double clock, const double *y, const double *yp)
{
    double change = 0.0;
    model_lags(clock, y, yp, s->u_used, s->p, s->w, s->lags_now);
    for (int e = 0; e < WIDTH; ++e) {
        put(s, e, 1, 0.0);
        put(s, e, 2, clock - s->lags_now[e]);
    }
    for (int round = 0; round < (SMPL_DELAYS_FOLLOW ? ROUNDS : 1); ++round) {
        model_delayed(clock, y, yp, s->u_used, s->p, s->w, s->delayed);
#if SMPL_HAS_before
        for (int e = 0, known = -1; e < WIDTH; ++e) {
            if (!call_of(e)->before) continue;
            if (known < 0 || s->lags_now[known] != s->lags_now[e]) {
                model_before(clock - s->lags_now[e], y, yp, s->u_used, s->p, s->w, s->near);
                known = e;
            }
            s->delayed[e] = s->near[e];
        }
#endif
        change = 0.0;
        for (int e = 0; e < WIDTH; ++e) {
            const double own = fabs(s->seen[e] - s->delayed[e]) / fmax(fabs(s->delayed[e]), 2.2250738585072014e-308);
            change = isnan(own) ? INFINITY : fmax(change, own);
            s->seen[e] = s->delayed[e];
            put(s, e, 0, s->delayed[e]);
        }
        if (change <= 4.0 * ROUNDING) break;
    }
    return SMPL_DELAYS_FOLLOW ? change : 0.0;
}

/* `strictly`: values of a time that is not recorded yet are not numbers, so that a step to there is shortened. */
void smpl_look_back(smpl_instance *s, double clock, const double *y, const double *yp, int strictly)
{
    /* Where an integration begins, breaks within the rounding of time are behind. */
    const double reach = fabs(clock - s->now.began) <= near_to(s->now.began) ? near_to(clock) : 4.0 * ROUNDING * fabs(clock);
    smpl_spot spot;
    double known = NAN;
    if (!s->now.recorded) {
        look_at_present(s, clock, y, yp);
        return;
    }
    if (SMPL_DELAYS_VARY) {
        model_lags(clock, y, yp, s->u_used, s->p, s->w, s->lags_now);
        s->now.shortest = INFINITY;
        for (int e = 0; e < WIDTH; ++e) {
            if (call_of(e)->varies) s->lags[e] = s->lags_now[e];
            s->now.shortest = fmin(s->now.shortest, s->lags[e]);
        }
    }
    spot.beyond = 0.0;
    for (int e = 0; e < WIDTH; ++e) {
        const smpl_delay *call = call_of(e);
        const double lag = s->lags[e], earlier = clock - lag;
        double rate, value;
        if (earlier != known) smpl_find_spot(s, earlier, reach, &spot);
        known = earlier;
        value = smpl_value_at(&spot, e, &rate);
        const int lost = spot.beyond < -SLACK * lag && (s->now.cut_off || call->before);
        if (lost) s->lost = 1 + e;
        if (lost || !(lag > 0.0) || (strictly && call->varies && spot.beyond > SLACK * lag) || lag > call->most * (1.0 + SLACK)) value = NAN;
        put(s, e, 0, value);
        put(s, e, 1, rate);
        put(s, e, 2, earlier);
    }
}

/* Reports the past that a failed step would have needed. */
int smpl_say_lost(smpl_instance *s)
{
    const int lost = s->lost;
    if (lost > 0) {
        smpl_say(s, fmi3Error, "time %.15g: the past of `%s` is no longer kept: its dead time grew", s->now.time, call_of(lost - 1)->name);
    }
    s->lost = 0;
    return lost > 0;
}

/* Forgets what no dead time reaches from a time on. */
void smpl_forget_old(smpl_instance *s, double time)
{
    smpl_progress *now = &s->now;
    double longest = 0.0;
    int kept = 0;
    for (int e = 0; e < WIDTH; ++e) longest = fmax(longest, reach_of(s, e));
    while (now->pieces > 1 && piece_at(s, 0)[TO] < time - longest * (1.0 + SLACK)) {
        now->first_piece = (now->first_piece + 1) % SMPL_HISTORY;
        --now->pieces;
        now->cut_off = 1;
    }
    for (int k = 0; k < now->marks; ++k) {
        if (s->marks[2 * k] + longest * (1.0 + SLACK) < time) continue;
        s->marks[2 * kept] = s->marks[2 * k];
        s->marks[2 * kept + 1] = s->marks[2 * k + 1];
        ++kept;
    }
    now->marks = kept;
}

/* Forgets what is later than a time. */
void smpl_forget_new(smpl_instance *s, double time)
{
    while (s->now.pieces > 1 && piece_at(s, s->now.pieces - 1)[FROM] >= time) --s->now.pieces;
    if (s->now.pieces > 0) {
        double *last = piece_at(s, s->now.pieces - 1);
        last[TO] = fmin(last[TO], fmax(time, last[FROM]));
    }
}

int smpl_past_full(smpl_instance *s, double time)
{
    int longest = 0;
    (void)time;
    for (int e = 1; e < WIDTH; ++e) longest = reach_of(s, e) > reach_of(s, longest) ? e : longest;
    smpl_say(s, fmi3Error, "time %.15g: the past of `%s` has more than %d steps: export with a longer `history`", time,
             call_of(longest)->name, SMPL_HISTORY);
    return 0;
}

/* Adds a piece through samples at its nodes; `from` may be a break that is behind `begin`. 0 where there is no room. */
static int push(smpl_instance *s, double from, double begin, double to)
{
    if (s->now.pieces == SMPL_HISTORY) smpl_forget_old(s, begin);
    if (s->now.pieces == SMPL_HISTORY) return smpl_past_full(s, begin);
    double *piece = piece_at(s, s->now.pieces++);
    piece[FROM] = from, piece[TO] = to, piece[BEGIN] = begin, piece[LENGTH] = to - begin;
    for (int e = 0; e < WIDTH; ++e) {
        double *terms = piece + COEFFICIENTS + (size_t)e * TERMS;
        const double first = s->samples[e];
        for (int n = 0; n < TERMS; ++n) {
            double sum = 0.0;
            for (int k = 0; k < TERMS; ++k) {
                const double part = (s->samples[(size_t)k * WIDTH + e] - first) * cosines[n * (TERMS - 1 - k) % 14];
                sum += k == 0 || k == TERMS - 1 ? 0.5 * part : part;
            }
            terms[n] = sum * (n == 0 || n == TERMS - 1 ? 1.0 : 2.0) / (TERMS - 1);
        }
        /* Those of equal values are exact. */
        terms[0] += first;
        for (int k = 0; k < TERMS; ++k) s->sizes[e] = fmax(s->sizes[e], fabs(s->samples[(size_t)k * WIDTH + e]));
    }
    return 1;
}

/* Returns 1 if the last terms of the polynomials of the last piece are small, in parts of the size of each value. */
static int is_resolved(const smpl_instance *s)
{
    const double *piece = piece_at(s, s->now.pieces - 1);
    for (int e = 0; e < WIDTH; ++e) {
        const double *terms = piece + COEFFICIENTS + (size_t)e * TERMS, rest = fabs(terms[TERMS - 1]) + fabs(terms[TERMS - 2]);
        if (isfinite(rest) && rest > PRECISION * s->now.rtol * s->sizes[e]) return 0;
    }
    return 1;
}

/* Values of the delayed expressions at a time. */
static void sample(smpl_instance *s, const smpl_span *span, double t, double *out)
{
    if (span->of_step) {
        smpl_interpolate(s, (t - span->t) / span->h, span->h, s->past_y, s->past_p);
        smpl_look_back(s, t, s->past_y, s->past_p, 0);
        model_delayed(t, s->past_y, s->past_p, s->u_used, s->p, s->w, out);
        return;
    }
#if SMPL_HAS_before
    model_before(t, s->y, s->yp, s->u_used, s->p, s->w, out);
#endif
    for (int e = 0; e < WIDTH; ++e) {
        if (!call_of(e)->before) out[e] = s->seen[e];
    }
}

/* Replaces samples at the ends of a span that belong to the other side of a jump there by the straight line from within. Returns whether
 * there was one. */
static int continue_to_ends(smpl_instance *s, const smpl_span *span, double from, double to)
{
    const double inside = fmin(fmax(FORWARD * s->now.shortest, 1e3 * ROUNDING * fabs(to)), INWARD * (to - from));
    int any = 0;
    for (int last = 0; last < 2; ++last) {
        double *samples = s->samples + (last ? (size_t)(TERMS - 1) * WIDTH : 0);
        const double end = last ? to : from, step = last ? -inside : inside;
        sample(s, span, end + step, s->near);
        sample(s, span, end + 2.0 * step, s->far);
        for (int e = 0; e < WIDTH; ++e) {
            const double jump = fabs(s->near[e] - samples[e]);
            if (jump > JUMP * s->now.rtol * s->sizes[e] && fabs(s->far[e] - s->near[e]) < 0.5 * jump) {
                samples[e] = 2.0 * s->near[e] - s->far[e];
                any = 1;
            }
        }
    }
    return any;
}

/* Records values over a span of time as few polynomials as they need. 0 where there is no room. */
static int record_span(smpl_instance *s, const smpl_span *span, double begin, double end)
{
    double from = begin, length = end - begin;
    const double least = length / (1 << HALVINGS);
    while (from < end) {
        const double to = from + length >= end * (1.0 - ROUNDING) || from + length >= end ? end : from + length;
        const double behind = s->now.crossed <= from ? s->now.crossed : from;
        int resolved;
        if (!(to > from)) break;
        for (int k = 0; k < TERMS; ++k) {
            sample(s, span, k == TERMS - 1 ? to : from + shares[k] * (to - from), s->samples + (size_t)k * WIDTH);
        }
        if (!push(s, behind, from, to)) return 0;
        resolved = is_resolved(s);
        if (!resolved && continue_to_ends(s, span, from, to)) {
            --s->now.pieces;
            if (!push(s, behind, from, to)) return 0;
            resolved = is_resolved(s);
        }
        if (!resolved && length > 1.5 * least) {
            --s->now.pieces;
            length *= 0.5;
            continue;
        }
        s->now.crossed = NAN;
        from = to;
    }
    return 1;
}

/* Returns 1 if a dead time is one that the element can have. */
int smpl_allows(smpl_instance *s, int element, double lag)
{
    const smpl_delay *call = call_of(element);
    (void)s;
    if (lag > 0.0 && isfinite(lag) && lag <= call->most * (1.0 + SLACK)) return 1;
    smpl_say(s, fmi3Error, "the dead time of `%s` is %.15g: it must be positive, finite and within its bounds", call->name, lag);
    return 0;
}

void smpl_measure(smpl_instance *s)
{
    s->now.shortest = INFINITY;
    for (int e = 0; e < WIDTH; ++e) s->now.shortest = fmin(s->now.shortest, s->lags[e]);
}

/* Records what was before the start, which is at the present state. */
int smpl_past_start(smpl_instance *s)
{
    smpl_progress *now = &s->now;
    const double t = smpl_clock(s, now->time), change = look_at_present(s, t, s->y, s->yp);
    const smpl_span span = {0, t, 0.0};
    double longest = 0.0;
    s->lost = 0;
    now->first_piece = now->pieces = now->marks = now->cut_off = now->begun = 0;
    now->crossed = NAN;
    for (int e = 0; e < WIDTH; ++e) {
        s->sizes[e] = 0.0;
        s->lags[e] = s->lags_now[e];
        if (change > now->rtol || !isfinite(s->delayed[e])) {
            smpl_say(s, fmi3Error, "the value of `%s` before the start depends on itself or is not finite: give one, `delay(e, theta, before = e0)`",
                     call_of(e)->name);
            return 0;
        }
        if (!smpl_allows(s, e, s->lags[e])) return 0;
        longest = fmax(longest, reach_of(s, e));
    }
    smpl_measure(s);
    if (!record_span(s, &span, t - longest, t)) return 0;
    now->recorded = 1;
    now->began = t;
    now->left = t + near_to(t);
    return 1;
}

/* Records the last step, up to a time. */
int smpl_past_record(smpl_instance *s, double t, double h, double to)
{
    const smpl_span span = {1, t, h};
    s->lost = 0;
    smpl_forget_new(s, s->now.crossed <= t ? s->now.crossed : t);
    return record_span(s, &span, t, to);
}

/* Numbers of the past in a saved state: the pieces, the oldest first, then the marks. Returns how many there are. */
size_t smpl_past_save(const smpl_instance *s, double *out)
{
    const size_t pieces = (size_t)s->now.pieces * SMPL_PIECE, marks = 2 * (size_t)s->now.marks;
    for (int k = 0; out && k < s->now.pieces; ++k) memcpy(out + (size_t)k * SMPL_PIECE, piece_at(s, k), SMPL_PIECE * sizeof(double));
    if (out) memcpy(out + pieces, s->marks, marks * sizeof(double));
    return pieces + marks;
}

void smpl_past_restore(smpl_instance *s, const double *from)
{
    const size_t pieces = (size_t)s->now.pieces * SMPL_PIECE;
    s->now.first_piece = 0;
    memcpy(s->ring, from, pieces * sizeof(double));
    memcpy(s->marks, from + pieces, 2 * (size_t)s->now.marks * sizeof(double));
}
