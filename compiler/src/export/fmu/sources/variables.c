/* Reading and writing variables, saved states, directional derivatives. */
#include "core.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define S ((smpl_instance *)instance)
#define N MODEL_UNKNOWNS

/* The vector that holds a variable; NULL where it cannot be computed. */
static const double *vector_of(smpl_instance *s, smpl_source source)
{
    const double clock = smpl_clock(s, s->now.time);
    (void)clock;
    if (source != SMPL_Y && source != SMPL_U && source != SMPL_P && !smpl_refresh(s)) return NULL;
    switch (source) {
    case SMPL_Y: return s->y;
    case SMPL_Z: return s->y;
    case SMPL_YP: return s->yp;
    case SMPL_U: return s->u;
    case SMPL_P: return s->p;
    case SMPL_OUT:
#if SMPL_HAS_outputs
        smpl_look_back(s, clock, s->y, s->yp, 0);
        model_outputs(clock, s->y, s->yp, s->u_used, s->p, s->w, s->outputs);
#endif
        return s->outputs;
    case SMPL_OBSERVED:
#if SMPL_HAS_observations
        smpl_look_back(s, clock, s->y, s->yp, 0);
        model_observations(clock, s->y, s->yp, s->u_used, s->p, s->c, s->observations);
#endif
        return s->observations;
    case SMPL_EVENT:
        smpl_roots(s, clock, s->y, s->yp, s->roots);
        return s->roots;
    default: return NULL;
    }
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference *references, size_t count, fmi3Float64 *values, size_t length)
{
    const double *vectors[SMPL_SOURCES] = {NULL};
    size_t at = 0;
    if (S->now.mode == INITIALIZATION && !smpl_initialise(S)) return fmi3Error;
    for (size_t k = 0; k < count; ++k) {
        const smpl_variable *variable = smpl_variables + (references[k] < SMPL_VARIABLES ? references[k] : 0);
        if (references[k] >= SMPL_VARIABLES || variable->source == SMPL_SWITCH) {
            return smpl_say(S, fmi3Error, "no number has the value reference %u", (unsigned)references[k]);
        }
        if (at + (size_t)variable->count > length) return smpl_say(S, fmi3Error, "the vector of values is too short");
        if (variable->source == SMPL_TIME) {
            values[at++] = S->now.time;
            continue;
        }
        if (S->now.mode == INSTANTIATED && variable->source != SMPL_Y && variable->source != SMPL_U && variable->source != SMPL_P) {
            return smpl_say(S, fmi3Error, "what the equations determine is known from initialization on");
        }
        if (!vectors[variable->source]) vectors[variable->source] = vector_of(S, variable->source);
        if (!vectors[variable->source]) return S->now.mode == CONTINUOUS ? fmi3Discard : fmi3Error;
        for (int i = 0; i < variable->count; ++i) {
            const double pace = variable->source == SMPL_YP ? SMPL_PACE : 1.0;
            values[at++] = vectors[variable->source][smpl_places[variable->first + i]] * pace;
        }
    }
    return at == length ? fmi3OK : smpl_say(S, fmi3Error, "the vector of values is too long");
}

/* Whether a variable may be set in the present mode. */
static int is_settable(smpl_instance *s, smpl_role role)
{
    const smpl_mode mode = s->now.mode;
    const int early = mode == INSTANTIATED || mode == INITIALIZATION;
    switch (role) {
    case SMPL_INPUT: return mode != TERMINATED;
    case SMPL_START: return early;
    /* FMI 3.0.2: in model exchange, in event mode only what events do not set (reinit = false), in continuous-time mode all states. */
    case SMPL_STATE: return early || mode == CONTINUOUS || (mode == EVENT && !s->co_simulation);
    case SMPL_RESET_STATE: return early || mode == CONTINUOUS;
    case SMPL_PARAMETER: return early || mode == EVENT || mode == STEP;
    default: return 0;
    }
}

/* Makes new values those of the model. */
static fmi3Status set(smpl_instance *s, const smpl_variable *variable, const double *values)
{
    const int early = s->now.mode == INSTANTIATED || s->now.mode == INITIALIZATION;
    int changed = 0;
    if (early && variable->source != SMPL_U) s->now.initialised = 0;
    for (int i = 0; i < variable->count; ++i) {
        const int place = smpl_places[variable->first + i];
        if (!isfinite(values[i])) return smpl_say(s, fmi3Error, "a value that is not finite cannot be set");
        switch (variable->source) {
        case SMPL_U:
            changed |= s->u[place] != values[i];
            s->u[place] = values[i];
            break;
        case SMPL_Y:
            changed |= s->y[place] != values[i];
            s->y[place] = values[i];
            break;
        default:
            changed |= s->p[place] != values[i] || !(s->p_set[place] > 0.0);
            if (variable->role == SMPL_PARAMETER && s->p[place] != values[i]) s->now.parameters_set = 1;
            s->p[place] = values[i];
            s->p_set[place] = 1.0;
        }
    }
    if (!changed) return fmi3OK;
    if (variable->role == SMPL_PARAMETER && !early) smpl_parameters(s);
    smpl_stale(s);
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference *references, size_t count, const fmi3Float64 *values, size_t length)
{
    size_t at = 0;
    for (size_t k = 0; k < count; ++k) {
        const smpl_variable *variable = smpl_variables + (references[k] < SMPL_VARIABLES ? references[k] : 0);
        fmi3Status status;
        if (references[k] >= SMPL_VARIABLES || variable->source == SMPL_SWITCH) {
            return smpl_say(S, fmi3Error, "no number has the value reference %u", (unsigned)references[k]);
        }
        if (variable->role == SMPL_SHAPED) return smpl_say(S, fmi3Error, "this value is part of the FMU (%s): export it with another one by `--set`", SMPL_SHAPED_BY);
        if (!is_settable(S, variable->role)) return smpl_say(S, fmi3Error, "the variable %u cannot be set here", (unsigned)references[k]);
        if (at + (size_t)variable->count > length) return smpl_say(S, fmi3Error, "the vector of values is too short");
        status = set(S, variable, values + at);
        if (status != fmi3OK) return status;
        at += (size_t)variable->count;
    }
    return at == length ? fmi3OK : smpl_say(S, fmi3Error, "the vector of values is too long");
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference *references, size_t count, fmi3Boolean *values, size_t length)
{
    for (size_t k = 0; k < count; ++k) {
        const int known = references[k] < SMPL_VARIABLES && smpl_variables[references[k]].source == SMPL_SWITCH && k < length;
        if (!known) return smpl_say(S, fmi3Error, "no truth value has the value reference %u", (unsigned)references[k]);
        values[k] = !S->now.goes_on;
    }
    return fmi3OK;
}

fmi3Status fmi3SetBoolean(
    fmi3Instance instance, const fmi3ValueReference *references, size_t count, const fmi3Boolean *values, size_t length)
{
    for (size_t k = 0; k < count; ++k) {
        const int known = references[k] < SMPL_VARIABLES && smpl_variables[references[k]].source == SMPL_SWITCH && k < length;
        if (!known) return smpl_say(S, fmi3Error, "no truth value has the value reference %u", (unsigned)references[k]);
        S->now.goes_on = !values[k];
    }
    return fmi3OK;
}

/* Types of which this FMU has no variables: reading or writing none of them is no error. */
#define NONE(type)                                                                                                                       \
    fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference *references, size_t count, fmi3##type *values, size_t length) \
    {                                                                                                                                    \
        (void)references, (void)values, (void)length;                                                                                    \
        return count == 0 ? fmi3OK : smpl_say(S, fmi3Error, "this FMU has no variables of the type " #type);                             \
    }                                                                                                                                    \
    fmi3Status fmi3Set##type(                                                                                                            \
        fmi3Instance instance, const fmi3ValueReference *references, size_t count, const fmi3##type *values, size_t length)              \
    {                                                                                                                                    \
        (void)references, (void)values, (void)length;                                                                                    \
        return count == 0 ? fmi3OK : smpl_say(S, fmi3Error, "this FMU has no variables of the type " #type);                             \
    }

NONE(Float32)
NONE(Int8)
NONE(UInt8)
NONE(Int16)
NONE(UInt16)
NONE(Int32)
NONE(UInt32)
NONE(Int64)
NONE(UInt64)
NONE(String)

/* Functions that this FMU does not have. */
#define MISSING(name, what, ...)                                       \
    fmi3Status fmi3##name(fmi3Instance instance, __VA_ARGS__)          \
    {                                                                  \
        return smpl_say(S, fmi3Error, "this FMU has no " what);        \
    }

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define REFERENCES const fmi3ValueReference *references, size_t count

MISSING(GetBinary, "binary variables", REFERENCES, size_t *sizes, fmi3Binary *values, size_t length)
MISSING(SetBinary, "binary variables", REFERENCES, const size_t *sizes, const fmi3Binary *values, size_t length)
MISSING(GetClock, "clocks", REFERENCES, fmi3Clock *values)
MISSING(SetClock, "clocks", REFERENCES, const fmi3Clock *values)
MISSING(GetNumberOfVariableDependencies, "table of dependencies", fmi3ValueReference reference, size_t *count)
MISSING(GetVariableDependencies, "table of dependencies", fmi3ValueReference reference, size_t *elements, fmi3ValueReference *independents,
        size_t *of_independents, fmi3DependencyKind *kinds, size_t count)
MISSING(GetIntervalDecimal, "clocks", REFERENCES, fmi3Float64 *intervals, fmi3IntervalQualifier *qualifiers)
MISSING(GetIntervalFraction, "clocks", REFERENCES, fmi3UInt64 *counters, fmi3UInt64 *resolutions, fmi3IntervalQualifier *qualifiers)
MISSING(GetShiftDecimal, "clocks", REFERENCES, fmi3Float64 *shifts)
MISSING(GetShiftFraction, "clocks", REFERENCES, fmi3UInt64 *counters, fmi3UInt64 *resolutions)
MISSING(SetIntervalDecimal, "clocks", REFERENCES, const fmi3Float64 *intervals)
MISSING(SetIntervalFraction, "clocks", REFERENCES, const fmi3UInt64 *counters, const fmi3UInt64 *resolutions)
MISSING(SetShiftDecimal, "clocks", REFERENCES, const fmi3Float64 *shifts)
MISSING(SetShiftFraction, "clocks", REFERENCES, const fmi3UInt64 *counters, const fmi3UInt64 *resolutions)
MISSING(GetOutputDerivatives, "derivatives of outputs by time", REFERENCES, const fmi3Int32 *orders, fmi3Float64 *values, size_t length)
MISSING(GetAdjointDerivative, "adjoint derivatives", const fmi3ValueReference *unknowns, size_t unknown_count,
        const fmi3ValueReference *knowns, size_t known_count, const fmi3Float64 *seed, size_t seed_length, fmi3Float64 *sensitivity,
        size_t length)

/* A saved state: the numbers that change apart from the vectors, then the vectors, and the past of delayed expressions. */
#define SAVED (sizeof(smpl_progress) + SMPL_KEPT * sizeof(double))

/* Bytes of a saved state. */
static size_t saved(const void *state)
{
#if SMPL_DELAYS
    smpl_progress now;
    memcpy(&now, state, sizeof now);
    return SAVED + ((size_t)now.pieces * SMPL_PIECE + 2 * (size_t)now.marks) * sizeof(double);
#else
    (void)state;
    return SAVED;
#endif
}

/* Whether bytes are those of a saved state. */
static int is_saved(const void *bytes, size_t size)
{
    if (size < SAVED) return 0;
#if SMPL_DELAYS
    smpl_progress now;
    memcpy(&now, bytes, sizeof now);
    if (now.pieces < 0 || now.pieces > SMPL_HISTORY || now.marks < 0 || now.marks > SMPL_HISTORY) return 0;
#endif
    return size == saved(bytes);
}

static fmi3Status wrong_size(smpl_instance *s, size_t size)
{
    return smpl_say(s, fmi3Error, "%lu bytes are not a saved state of this FMU", (unsigned long)size);
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    void *room = realloc(*state, saved(&S->now));
    if (!room) return smpl_say(S, fmi3Error, "no memory");
    *state = room;
    memcpy(room, &S->now, sizeof S->now);
    memcpy((char *)room + sizeof S->now, S->kept, SMPL_KEPT * sizeof(double));
#if SMPL_DELAYS
    smpl_past_save(S, (double *)((char *)room + SAVED));
#endif
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    if (!state) return smpl_say(S, fmi3Error, "there is no saved state");
    memcpy(&S->now, state, sizeof S->now);
    memcpy(S->kept, (char *)state + sizeof S->now, SMPL_KEPT * sizeof(double));
    S->now.prepared = 0;
#if SMPL_DELAYS
    smpl_past_restore(S, (const double *)((char *)state + SAVED));
#endif
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    if (!state) return smpl_say(S, fmi3Error, "there is no saved state");
    *size = saved(state);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte *bytes, size_t size)
{
    if (!state || size != saved(state)) return wrong_size(S, size);
    memcpy(bytes, state, size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte *bytes, size_t size, fmi3FMUState *state)
{
    void *room;
    if (!is_saved(bytes, size)) return wrong_size(S, size);
    room = realloc(*state, size);
    if (!room) return smpl_say(S, fmi3Error, "no memory");
    *state = room;
    memcpy(room, bytes, size);
    return fmi3OK;
}

/* Where the columns of the partial derivatives begin: y, y', u, p; and the rows: residual, outputs, observations. */
#define COLUMN_YP N
#define COLUMN_U (2 * N)
#define COLUMN_P (2 * N + MODEL_ACTIONS)
#define ROW_OUT N
#define ROW_OBSERVED (N + MODEL_OUTPUTS)

/* Spreads seeds over the columns; 0 where one is of something that is not known. */
static int spread(smpl_instance *s, const fmi3ValueReference *knowns, size_t count, const double *seed, size_t length)
{
    size_t at = 0;
    memset(s->seed, 0, SMPL_PARTIAL_COLUMNS * sizeof(double));
    for (size_t k = 0; k < count; ++k) {
        const smpl_variable *variable = smpl_variables + (knowns[k] < SMPL_VARIABLES ? knowns[k] : 0);
        const int first = variable->source == SMPL_Y ? 0 : variable->source == SMPL_U ? COLUMN_U : COLUMN_P;
        if (variable->role != SMPL_INPUT && variable->source != SMPL_Y) {
            smpl_say(s, fmi3Error, "there are derivatives by states and inputs, not by the variable %u", (unsigned)knowns[k]);
            return 0;
        }
        for (int i = 0; i < variable->count && at < length; ++i) s->seed[first + smpl_places[variable->first + i]] = seed[at++];
    }
    if (at != length) smpl_say(s, fmi3Error, "the vector of seeds has another length than what is known");
    return at == length;
}

/* Adds what a column gives to the rows from `first` on; the others are left alone. */
static void multiply(smpl_instance *s, int first, int last, double *rows)
{
    for (int k = 0; k < SMPL_PARTIALS; ++k) {
        if (smpl_partial_rows[k] >= first && smpl_partial_rows[k] < last) {
            rows[smpl_partial_rows[k]] += s->partials[k] * s->seed[smpl_partial_columns[k]];
        }
    }
}

/* Derivatives of all rows along the seed, with those of rates and algebraic variables that follow from them. */
static int differentiate(smpl_instance *s, double *rows)
{
    const double clock = smpl_clock(s, s->now.time);
    memset(rows, 0, SMPL_PARTIAL_ROWS * sizeof(double));
    if (!smpl_refresh(s)) return 0;
#if SMPL_HAS_partials
    smpl_look_back(s, clock, s->y, s->yp, 0);
    model_partials(clock, s->y, s->yp, s->u_used, s->p, s->c, s->partials);
#endif
    if (smpl_rate_matrix(s, clock, s->y, s->yp)) return 0;
    multiply(s, 0, N, rows);
    for (int j = 0; j < MODEL_STATES; ++j) {
        for (int k = model_jacobian_columns[j]; k < model_jacobian_columns[j + 1]; ++k) {
            rows[model_jacobian_rows[k]] += s->j0[k] * s->seed[j];
        }
    }
    for (int i = 0; i < N; ++i) rows[i] = -rows[i];
    smpl_lu_solve(&s->lu, rows);
    for (int i = 0; i < MODEL_STATES; ++i) s->seed[COLUMN_YP + i] = rows[i];
    for (int i = MODEL_STATES; i < N; ++i) s->seed[i] = rows[i];
    multiply(s, N, SMPL_PARTIAL_ROWS, rows);
    return 1;
}

fmi3Status fmi3GetDirectionalDerivative(
    fmi3Instance instance, const fmi3ValueReference *unknowns, size_t unknown_count, const fmi3ValueReference *knowns, size_t known_count,
    const fmi3Float64 *seed, size_t seed_length, fmi3Float64 *sensitivity, size_t length)
{
    double *rows = S->seed + SMPL_PARTIAL_COLUMNS;
    size_t at = 0;
    if (S->now.mode == INITIALIZATION && !smpl_initialise(S)) return fmi3Error;
    if (!spread(S, knowns, known_count, seed, seed_length) || !differentiate(S, rows)) return fmi3Error;
    for (size_t k = 0; k < unknown_count; ++k) {
        const smpl_variable *variable = smpl_variables + (unknowns[k] < SMPL_VARIABLES ? unknowns[k] : 0);
        const int first = variable->source == SMPL_OUT ? ROW_OUT : variable->source == SMPL_OBSERVED ? ROW_OBSERVED
                          : variable->source == SMPL_YP || variable->source == SMPL_Z ? 0 : -1;
        if (first < 0) return smpl_say(S, fmi3Error, "there are no derivatives of the variable %u", (unsigned)unknowns[k]);
        for (int i = 0; i < variable->count && at < length; ++i) {
            sensitivity[at++] = rows[first + smpl_places[variable->first + i]] * (variable->source == SMPL_YP ? SMPL_PACE : 1.0);
        }
    }
    return at == length ? fmi3OK : smpl_say(S, fmi3Error, "the vector of sensitivities has another length than what is unknown");
}
