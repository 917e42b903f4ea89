/* The integrator: Rodas5P, a stiffly accurate Rosenbrock method of order 5 for systems of index 1 (G. Steinebach, BIT Numer. Math. 63
 * (2023) 27), with events on its dense output of order 4.
 *
 * Rates that are given implicitly, F(t, y, y') = 0, are integrated as y' = v, 0 = F(t, y, v); v is eliminated from each stage, so that
 * the matrix is always dF/dy + dF/dy' / (h gamma). */
#include "core.h"

#include <math.h>
#include <string.h>

#define N MODEL_UNKNOWNS
#define GAMMA 0.21193756319429014

static const double nodes[8] = {0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0};
static const double slopes[8] = {
    0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0};
static const double a[6][5] = {
    {0.0, 0.0, 0.0, 0.0, 0.0},
    {3.0, 0.0, 0.0, 0.0, 0.0},
    {2.849394379747939, 0.45842242204463923, 0.0, 0.0, 0.0},
    {-6.954028509809101, 2.489845061869568, -10.358996098473584, 0.0, 0.0},
    {2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641, 0.0},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946},
};
static const double c[8][7] = {
    {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-14.155112264123755, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-17.97296035885952, -2.859693295451294, 0.0, 0.0, 0.0, 0.0, 0.0},
    {147.12150275711716, -1.41221402718213, 71.68940251302358, 0.0, 0.0, 0.0, 0.0},
    {165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306, 0.0, 0.0, 0.0},
    {24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471, 0.0, 0.0},
    {30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623, -28.087943162872662, 0.0},
    {37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002, -54.66780262877968,
     -9.48861652309627},
};
static const double dense[3][8] = {
    {25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204, 0.524948541321073, 1.1241088310450404,
     0.4272876194431874, -0.17202221070155493},
    {-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796, 20.176138334709044, 15.98066361424651,
     -6.789040303419874, -6.710236069923372},
    {11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643, -52.072871366152654, -59.78993625266729,
     -0.15582684282751913, 4.883087185713722},
};

/* Reciprocal tolerance of an unknown. */
static double weight(const smpl_instance *s, int i, double x, double y)
{
    if (i >= MODEL_STATES && !SMPL_ALGEBRAIC_ERRORS) return 0.0;
    return 1.0 / (s->now.rtol * (SMPL_ATOL_FACTOR * smpl_scale[i] + fmax(fabs(x), fabs(y))));
}

/* Root mean square in tolerances. */
static double norm(const smpl_instance *s, const double *x, const double *begin, const double *end)
{
    double sum = 0.0;
    for (int i = 0; i < N; ++i) {
        const double part = x[i] * weight(s, i, begin[i], end[i]);
        sum += part * part;
    }
    return sqrt(sum / (N > 0 ? N : 1));
}

static void residual(smpl_instance *s, double t, const double *y, const double *yp, double *out)
{
    /* A step whose past is not recorded yet is one to be shortened. */
    smpl_look_back(s, t, y, yp, 1);
    model_residual(t, y, SMPL_IMPLICIT ? yp : s->zero, s->u_used, s->p, s->w, out);
}

/* The right-hand side's derivative by time, by a difference of order two inside of the step. */
static void differentiate_by_time(smpl_instance *s, double t, double h, const double *now)
{
    const double least = 1e3 * 2.220446049250313e-16 * fabs(t), ahead = fmin(fmax(1e-4 * h, least), 0.25 * h);
    const double near = (t + ahead) - t, far = (t + 2.0 * ahead) - t;
    const double first = far / (near * (far - near)), second = -near / (far * (far - near));
    residual(s, t + near, s->y, s->yp, s->f);
    residual(s, t + far, s->y, s->yp, s->right);
    for (int i = 0; i < N; ++i) s->slope[i] = first * (s->f[i] - now[i]) + second * (s->right[i] - now[i]);
}

/* A step of length h from the present state to `end` and `end_p`; the error in tolerances, not a number where there is none. */
static double attempt(smpl_instance *s, double t, double h)
{
    double *u = s->stages, *v = s->stages + 8 * (size_t)N, *now = s->delta;
    smpl_look_back(s, t, s->y, s->yp, 0);
    model_jacobian(t, s->y, SMPL_IMPLICIT ? s->yp : s->zero, 1.0 / (h * GAMMA), s->u_used, s->p, s->w, s->matrix);
    if (SMPL_IMPLICIT) {
        model_jacobian(t, s->y, s->yp, 0.0, s->u_used, s->p, s->w, s->j0);
        for (int k = 0; k < MODEL_NONZEROS; ++k) s->j1[k] = (s->matrix[k] - s->j0[k]) * (h * GAMMA);
    }
    if (smpl_lu_factorise(&s->lu, s->matrix)) return NAN;
    residual(s, t, s->y, s->yp, now);
    if (SMPL_TIMED) differentiate_by_time(s, t, h, now);
    memcpy(s->place, s->y, sizeof(double) * N);
    memcpy(s->place_p, s->yp, sizeof(double) * N);
    for (int stage = 0; stage < 8; ++stage) {
        double *own = u + stage * (size_t)N, *own_v = v + stage * (size_t)N;
        for (int i = 0; i < N && stage > 0; ++i) {
            double sum = 0.0, sum_v = 0.0;
            if (stage < 6) {
                for (int j = 0; j < stage; ++j) {
                    sum += a[stage][j] * u[j * (size_t)N + i];
                    sum_v += a[stage][j] * v[j * (size_t)N + i];
                }
                s->place[i] = s->y[i] + sum;
                s->place_p[i] = s->yp[i] + sum_v;
            } else {
                s->place[i] += u[(stage - 1) * (size_t)N + i];
                s->place_p[i] += v[(stage - 1) * (size_t)N + i];
            }
        }
        if (stage > 0) residual(s, t + nodes[stage] * h, s->place, s->place_p, s->right);
        else memcpy(s->right, now, sizeof(double) * N);
        for (int i = 0; i < N; ++i) {
            double sum = 0.0;
            for (int j = 0; j < stage; ++j) sum += c[stage][j] * u[j * (size_t)N + i];
            own[i] = s->right[i] + (SMPL_TIMED ? h * slopes[stage] * s->slope[i] : 0.0);
            own_v[i] = i < MODEL_STATES ? sum / h + (SMPL_IMPLICIT ? s->place_p[i] : 0.0) : 0.0;
        }
        if (SMPL_IMPLICIT) {
            for (int j = 0; j < MODEL_STATES; ++j) {
                for (int k = model_jacobian_columns[j]; k < model_jacobian_columns[j + 1]; ++k) {
                    own[model_jacobian_rows[k]] -= s->j1[k] * own_v[j];
                }
            }
        } else {
            for (int i = 0; i < MODEL_STATES; ++i) own[i] += own_v[i];
        }
        for (int i = 0; i < N; ++i) own[i] = -own[i];
        smpl_lu_solve(&s->lu, own);
        for (int i = 0; i < MODEL_STATES; ++i) own_v[i] = own[i] / (h * GAMMA) - own_v[i];
    }
    for (int i = 0; i < N; ++i) {
        s->end[i] = s->place[i] + u[7 * (size_t)N + i];
        s->end_p[i] = s->place_p[i] + v[7 * (size_t)N + i];
    }
    return norm(s, u + 7 * (size_t)N, s->y, s->end);
}

/* Whether the algebraic variables at the end of the step solve their equations. A step finds them by equations that are linear, and their
   errors need not be tested: Newton's method with the matrix of the step brings them there, and converges where the step is short enough. */
static int determine(smpl_instance *s, double t)
{
    double before = INFINITY;
    for (int iteration = 0; N > MODEL_STATES && iteration < 4; ++iteration) {
        double sum = 0.0, size;
        residual(s, t, s->end, s->end_p, s->right);
        for (int i = 0; i < MODEL_STATES; ++i) s->right[i] = 0.0;
        smpl_lu_solve(&s->lu, s->right);
        for (int i = MODEL_STATES; i < N; ++i) {
            const double part = s->right[i] / (s->now.rtol * (SMPL_ATOL_FACTOR * smpl_scale[i] + fabs(s->end[i])));
            sum += part * part;
            s->end[i] -= s->right[i];
        }
        size = sqrt(sum / (N > MODEL_STATES ? N - MODEL_STATES : 1));
        if (size <= 0.1 || (size < 1.0 && size * size < 0.1 * before)) return 1;
        if (!(size < 0.5 * before)) return 0;
        before = size;
    }
    return N == MODEL_STATES;
}

/* The polynomial of the last step, which began at the present state. */
static void make_polynomial(smpl_instance *s)
{
    memcpy(s->terms, s->y, sizeof(double) * N);
    memcpy(s->terms + N, s->end, sizeof(double) * N);
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < N; ++i) {
            double sum = 0.0;
            for (int j = 0; j < 8; ++j) sum += dense[k][j] * s->stages[j * (size_t)N + i];
            s->terms[(2 + k) * (size_t)N + i] = sum;
        }
    }
}

void smpl_interpolate(const smpl_instance *s, double share, double h, double *y, double *yp)
{
    const double *first = s->terms, *last = first + N, *k1 = last + N, *k2 = k1 + N, *k3 = k2 + N, rest = 1.0 - share;
    for (int i = 0; i < N; ++i) {
        const double inner = k1[i] + share * (k2[i] + share * k3[i]);
        y[i] = rest * first[i] + share * (last[i] + rest * inner);
        yp[i] = (last[i] - first[i] + (rest - share) * inner + share * rest * (k2[i] + 2.0 * share * k3[i])) / h;
    }
}

/* Whether a condition became true at a state, or ceased to be where that matters. */
static int passes(smpl_instance *s, double t, const double *y, const double *yp)
{
    int found = 0;
    if (SMPL_ROOTS == 0) return 0;
    smpl_roots(s, t, y, yp, s->roots);
    for (int i = 0; i < SMPL_ROOTS; ++i) {
        const int before = s->holds[i] > 0.0, both = smpl_root_table[i].kind == SMPL_RESTARTS;
        s->passed[i] = before ? (both && s->roots[i] < 0.0) : s->roots[i] > 0.0;
        found |= s->passed[i] > 0.0;
    }
    return found;
}

/* Conditions that have ceased to hold may become true again. */
static void release(smpl_instance *s)
{
    for (int i = 0; i < SMPL_ROOTS; ++i) {
        if (s->roots[i] < 0.0) s->holds[i] = 0.0;
    }
}

/* The share of the last step at which the first condition became true; the state there. */
static double locate(smpl_instance *s, double t, double h)
{
    double low = 0.0, high = 1.0;
    const double fine = 2.220446049250313e-16 * (1.0 + fabs(t) / h);
    while (high - low > fine) {
        const double middle = low + 0.5 * (high - low);
        if (middle <= low || middle >= high) break;
        smpl_interpolate(s, middle, h, s->y2, s->yp2);
        if (passes(s, t + middle * h, s->y2, s->yp2)) high = middle;
        else {
            release(s);
            low = middle;
        }
    }
    smpl_interpolate(s, high, h, s->y2, s->yp2);
    passes(s, t + high * h, s->y2, s->yp2);
    return high;
}

/* Power 1/32, which every processor rounds alike. */
static double root32(double x)
{
    return sqrt(sqrt(sqrt(sqrt(sqrt(x)))));
}

static void accept(smpl_progress *now, double h, double error)
{
    const double root = root32(fmax(error, 1e-9)), power = root * root * root * root * root;
    const double factor = 0.9 * now->last_error / power;
    const double next = h * fmin(fmax(factor, 0.1), now->rejected ? 1.0 : 8.0);
    now->proposed = factor >= 1.0 && h < now->proposed ? fmax(next, now->proposed) : next;
    now->last_error = root;
    now->rejected = 0;
}

static void reject(smpl_progress *now, double h, double error)
{
    const double root = root32(error), power = root * root * root * root * root * root;
    now->proposed = h * (isfinite(error) ? fmin(fmax(0.9 / power, 0.1), 0.9) : 0.25);
    now->rejected = 1;
}

/* A first step by the size of the rates and how they change a little later. */
static double first_step(smpl_instance *s, double t, double interval)
{
    double size, speed, ahead, change, most;
    size = norm(s, s->y, s->y, s->y);
    for (int i = 0; i < N; ++i) s->right[i] = i < MODEL_STATES ? s->yp[i] : 0.0;
    speed = norm(s, s->right, s->y, s->y);
    ahead = speed > 0.0 ? fmin(fmax(0.01 * size / speed, 1e-6 * interval), interval) : 1e-3 * interval;
    for (int i = 0; i < N; ++i) s->place[i] = s->y[i] + ahead * s->right[i];
    residual(s, t, s->y, s->yp, s->delta);
    residual(s, t + ahead, s->place, s->yp, s->f);
    for (int i = 0; i < N; ++i) s->right[i] = i < MODEL_STATES ? s->f[i] - s->delta[i] : 0.0;
    change = norm(s, s->right, s->y, s->y) / ahead;
    if (!isfinite(change)) return 0.01 * ahead;
    most = fmax(speed, change);
    if (most == 0.0) return interval;
    return fmin(fmin(pow(0.01 / most, 0.2), 100.0 * ahead), interval);
}

/* The step to take where so much is left: equal ones where few fit. */
static double fit(double proposed, double left)
{
    const double pieces = ceil(left / proposed - 1e-9);
    return pieces <= 1.0 ? left : pieces <= 4.0 ? left / pieces : proposed;
}

/* The largest error of the last step. */
static const char *culprit(const smpl_instance *s)
{
    int worst = 0;
    double largest = -1.0;
    for (int i = 0; i < MODEL_STATES; ++i) {
        const double size = fabs(s->stages[7 * (size_t)N + i] * weight(s, i, s->y[i], s->end[i]));
        if (!(size <= largest)) {
            largest = size;
            worst = i;
        }
    }
    return MODEL_STATES > 0 ? model_states_table[worst].name : "";
}

/* The longest step: what it reads of the past is recorded. */
static double longest(const smpl_progress *now)
{
#if SMPL_DELAYS
    return fmin(SMPL_MAX_STEP, now->shortest);
#else
    (void)now;
    return SMPL_MAX_STEP;
#endif
}

/* Returns 1 if the past that a step reads is kept; reports it if not. */
static int is_known(smpl_instance *s)
{
#if SMPL_DELAYS
    return !smpl_say_lost(s);
#else
    (void)s;
    return 1;
#endif
}

/* Keeps a step for delayed values. */
static int record(smpl_instance *s, double t, double h, double to)
{
#if SMPL_DELAYS
    return smpl_past_record(s, t, h, to);
#else
    (void)s, (void)t, (void)h, (void)to;
    return 1;
#endif
}

/* Goes on from the present state, behind a break that was crossed if there is one; 0 where it cannot. */
static int go_on(smpl_instance *s, double crossed)
{
#if SMPL_DELAYS
    if (!smpl_past_begin(s, crossed)) return 0;
#endif
    (void)crossed;
    return smpl_refresh(s);
}

/* The next time at which an equation or a delayed value changes its form, as far as it matters before a time. */
static double next_break(smpl_instance *s, double to)
{
    double next = smpl_clock(s, smpl_next_break(s, s->now.time, to));
#if SMPL_DELAYS
    const double end = smpl_clock(s, to);
    next = fmin(next, smpl_past_break(s));
    /* A break at the end is crossed there: the instant sees what is behind it, and delayed values have one later. */
    if (next <= end + 2e-12 * fabs(end)) next = fmin(next, nextafter(end, -INFINITY));
#endif
    return next;
}

/* Steps to a time of the model, to the first event before it, or nowhere (-1). 1 for an event. */
static int run(smpl_instance *s, double t, double to, double *reached)
{
    smpl_progress *now = &s->now;
    for (int steps = 0; steps < SMPL_MAX_STEPS; ++steps) {
        int rejections = 0;
        double h, error;
        if (to - t <= 4.0 * 2.220446049250313e-16 * fabs(to)) break;
        for (;; ++rejections) {
            h = fit(fmin(now->proposed, longest(now)), to - t);
            error = attempt(s, t, h);
            if (error <= 1.0 && determine(s, t + h)) break;
            if (error <= 1.0) error = INFINITY;
            reject(now, h, isnan(error) ? INFINITY : error);
            if (rejections > 60 || now->proposed < 4.0 * 2.220446049250313e-16 * fabs(t)) {
                if (is_known(s)) smpl_say(s, fmi3Error, "time %.15g: no step is short enough for `%s`", t, culprit(s));
                return -1;
            }
        }
        accept(now, h, error);
        const double end = to - t - h <= 4.0 * 2.220446049250313e-16 * fabs(to) ? to : t + h;
        if (SMPL_ROOTS > 0 || SMPL_DELAYS > 0) make_polynomial(s);
        if (SMPL_ROOTS > 0) {
            smpl_interpolate(s, 1.0, h, s->y2, s->yp2);
            if (passes(s, end, s->end, s->yp2)) {
                const double share = locate(s, t, h);
                *reached = share == 1.0 ? end : t + share * h;
                if (!record(s, t, h, *reached)) return -1;
                memcpy(s->y, s->y2, sizeof(double) * N);
                memcpy(s->yp, s->yp2, sizeof(double) * N);
                return 1;
            }
            release(s);
        }
        if (!record(s, t, h, end)) return -1;
        memcpy(s->y, s->end, sizeof(double) * N);
        memcpy(s->yp, s->end_p, sizeof(double) * N);
        t = end;
        if (t == to) {
            *reached = to;
            return 0;
        }
    }
    if (to - t <= 4.0 * 2.220446049250313e-16 * fabs(to)) {
        *reached = to;
        return 0;
    }
    smpl_say(s, fmi3Error, "time %.15g: more than %d steps", t, SMPL_MAX_STEPS);
    return -1;
}

/* Integrates to a time of the FMU; what happens on the way is done. */
int smpl_integrate(smpl_instance *s, double to)
{
    smpl_progress *now = &s->now;
    for (int events = 0; now->time < to && !now->ended;) {
        const double begin = smpl_clock(s, now->time), end = smpl_clock(s, to);
        const double width = 16.0 * 2.220446049250313e-16 * fmax(fabs(begin), fabs(end));
        double next, reached = begin;
        int changed = 0, outcome, breaks;
        if (!go_on(s, NAN)) return 0;
        next = next_break(s, to);
        breaks = next < end;
        if (!(now->proposed > 0.0)) {
            now->proposed = first_step(s, begin, end - begin);
            now->last_error = 1.0;
        }
        outcome = run(s, begin, breaks ? next - width : end, &reached);
        if (outcome < 0) return 0;
        now->time = outcome == 0 && !breaks ? to : now->begin + (reached - now->begin) / SMPL_PACE;
        if (outcome == 0 && breaks) now->time = fmin(now->begin + (next + width - now->begin) / SMPL_PACE, to);
        now->consistent = 0;
        if (!go_on(s, outcome == 0 && breaks ? next : NAN)) return 0;
        if (outcome == 1 || breaks) {
            if (!smpl_events(s, &changed)) return 0;
            if (outcome == 1 && ++events > SMPL_MAX_EVENTS) {
                smpl_say(s, fmi3Error, "time %.15g: events follow one another without end", reached);
                return 0;
            }
        }
    }
    return 1;
}
