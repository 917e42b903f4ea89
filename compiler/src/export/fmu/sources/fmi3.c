/* The functions of FMI 3.0, but for reading and writing variables. */
#include "core.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define S ((smpl_instance *)instance)

fmi3Status smpl_say(smpl_instance *s, fmi3Status status, const char *format, ...)
{
    char text[1000];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (s->log && (s->logging || status >= fmi3Error)) {
        s->log(s->environment, status, status >= fmi3Error ? "logStatusError" : "logEvents", text);
    }
    return status;
}

static void destroy(smpl_instance *s)
{
    if (s) free(s->memory);
    free(s);
}

static smpl_instance *create(void)
{
    smpl_instance *s = (smpl_instance *)calloc(1, sizeof *s);
    if (!s) return NULL;
    s->memory = (double *)calloc(smpl_place(s, NULL) + 1, sizeof(double));
    if (!s->memory) {
        destroy(s);
        return NULL;
    }
    smpl_place(s, s->memory);
    smpl_reset(s);
    return s;
}

const char *fmi3GetVersion(void)
{
    return "3.0";
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String *categories)
{
    (void)count, (void)categories;
    S->logging = on;
    return fmi3OK;
}

static fmi3Instance instantiate(
    fmi3String token, fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, int co_simulation)
{
    smpl_instance *s;
    if (!token || strcmp(token, SMPL_TOKEN) != 0) {
        if (log) log(environment, fmi3Error, "logStatusError", "the instantiation token is that of another model");
        return NULL;
    }
    s = create();
    if (!s) {
        if (log) log(environment, fmi3Error, "logStatusError", "no memory");
        return NULL;
    }
    s->co_simulation = co_simulation;
    s->logging = logging;
    s->environment = environment;
    s->log = log;
    return s;
}

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name, (void)resources, (void)visible;
    if (SMPL_DELAYS > 0) {
        if (log) log(environment, fmi3Error, "logStatusError", "model exchange does not keep the past of `delay`: use co-simulation");
        return NULL;
    }
    return instantiate(token, logging, environment, log, 0);
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
    fmi3Boolean early, const fmi3ValueReference *intermediate, size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)early, (void)intermediate, (void)update;
    if (events || count > 0) {
        if (log) log(environment, fmi3Error, "logStatusError", "this FMU has no event mode and no intermediate updates in co-simulation");
        return NULL;
    }
    return instantiate(token, logging, environment, log, 1);
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    if (log) log(environment, fmi3Error, "logStatusError", "this FMU has no scheduled execution");
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    destroy(S);
}

/* Whether a function may be called in the present mode. */
static int is_in(smpl_instance *s, unsigned modes, const char *function)
{
    if (s && (modes & (1u << s->now.mode))) return 1;
    if (s) smpl_say(s, fmi3Error, "%s cannot be called here", function);
    return 0;
}

#define NEEDS(modes, function) \
    if (!is_in(S, modes, function)) return fmi3Error

#define IN(mode) (1u << (mode))

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_stop, (void)stop;
    NEEDS(IN(INSTANTIATED), "fmi3EnterInitializationMode");
    if (!isfinite(start)) return smpl_say(S, fmi3Error, "the start time must be finite");
    if (has_tolerance && !(tolerance >= 1e-14 && tolerance < 1.0)) {
        return smpl_say(S, fmi3Error, "the tolerance must be between 1e-14 and 1");
    }
    if (has_tolerance) S->now.rtol = fmin(S->now.rtol, tolerance);
    S->now.time = S->now.first = S->now.begin = start;
    S->now.mode = INITIALIZATION;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    NEEDS(IN(INITIALIZATION), "fmi3ExitInitializationMode");
    if (!smpl_initialise(S)) return fmi3Error;
    S->now.mode = S->co_simulation ? STEP : EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    NEEDS(S->co_simulation ? 0u : IN(CONTINUOUS), "fmi3EnterEventMode");
    memcpy(S->u_before, S->u, sizeof(double) * MODEL_ACTIONS);
    S->now.mode = EVENT;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    S->now.mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    smpl_reset(S);
    return fmi3OK;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return smpl_say(S, fmi3Error, "this FMU has no structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return smpl_say(S, fmi3Error, "this FMU has no structural parameters");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(
    fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals_changed, fmi3Boolean *states_changed,
    fmi3Boolean *has_next, fmi3Float64 *next)
{
    int changed = 0;
    NEEDS(IN(EVENT) | IN(STEP), "fmi3UpdateDiscreteStates");
    *again = *terminate = *nominals_changed = *states_changed = *has_next = false;
    if (S->co_simulation) return fmi3OK;
    const double sample = smpl_next_sample(S);
    const double near = 1e-9 * SMPL_STEP;
    if (S->now.open && S->now.time >= sample - near) {
        /* What was in force until now ends the interval; the inputs that were set at this event begin the next one. */
        double *inputs = S->u;
        S->u = S->u_before;
        S->now.prepared = 0;
        const int ended = smpl_sample_end(S);
        S->u = inputs;
        if (!ended) return fmi3Error;
        S->now.time = sample;
        changed = 1;
    }
    if (!S->now.open && !S->now.ended) {
        if (!smpl_sample_start(S)) return fmi3Error;
        changed = 1;
    }
    smpl_stale(S);
    if (!S->now.ended && !smpl_events(S, &changed)) return fmi3Error;
    if (!smpl_refresh(S)) return fmi3Error;
    *terminate = S->now.ended != 0;
    *states_changed = changed != 0;
    *has_next = true;
    *next = smpl_next_sample(S);
    *next = fmin(*next, smpl_next_break(S, S->now.time, *next));
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    NEEDS(S->co_simulation ? 0u : IN(EVENT), "fmi3EnterContinuousTimeMode");
    S->now.mode = CONTINUOUS;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean keeps_going, fmi3Boolean *event, fmi3Boolean *terminate)
{
    (void)keeps_going;
    NEEDS(IN(CONTINUOUS), "fmi3CompletedIntegratorStep");
    if (!smpl_refresh(S)) return fmi3Error;
    smpl_roots(S, smpl_clock(S, S->now.time), S->y, S->yp, S->roots);
    for (int i = 0; i < SMPL_ROOTS; ++i) {
        /* Conditions that have been left may become true again. */
        if (S->roots[i] < 0.0) S->holds[i] = 0.0;
    }
    *event = *terminate = false;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    NEEDS(IN(CONTINUOUS) | IN(EVENT), "fmi3SetTime");
    S->now.time = time;
    S->now.consistent = 0;
    return fmi3OK;
}

/* Whether a vector has the length that it should have. */
static int fits(smpl_instance *s, size_t length, size_t expected)
{
    if (length == expected) return 1;
    smpl_say(s, fmi3Error, "%lu numbers were given, there are %lu", (unsigned long)length, (unsigned long)expected);
    return 0;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 *states, size_t length)
{
    NEEDS(IN(CONTINUOUS) | IN(EVENT), "fmi3SetContinuousStates");
    if (!fits(S, length, MODEL_STATES)) return fmi3Error;
    for (size_t i = 0; i < length; ++i) S->y[smpl_states[i]] = states[i];
    S->now.consistent = 0;
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 *states, size_t length)
{
    if (!fits(S, length, MODEL_STATES)) return fmi3Error;
    if (S->now.mode == INITIALIZATION && !smpl_initialise(S)) return fmi3Error;
    for (size_t i = 0; i < length; ++i) states[i] = S->y[smpl_states[i]];
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 *derivatives, size_t length)
{
    if (!fits(S, length, MODEL_STATES)) return fmi3Error;
    if (S->now.mode == INITIALIZATION && !smpl_initialise(S)) return fmi3Error;
    if (!smpl_refresh(S)) return S->now.mode == CONTINUOUS ? fmi3Discard : fmi3Error;
    for (size_t i = 0; i < length; ++i) derivatives[i] = S->yp[smpl_states[i]] * SMPL_PACE;
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 *indicators, size_t length)
{
    if (!fits(S, length, SMPL_ROOTS)) return fmi3Error;
    if (S->now.mode == INITIALIZATION && !smpl_initialise(S)) return fmi3Error;
    if (!smpl_refresh(S)) return S->now.mode == CONTINUOUS ? fmi3Discard : fmi3Error;
    smpl_roots(S, smpl_clock(S, S->now.time), S->y, S->yp, indicators);
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 *nominals, size_t length)
{
    if (!fits(S, length, MODEL_STATES)) return fmi3Error;
    for (size_t i = 0; i < length; ++i) nominals[i] = SMPL_ATOL_FACTOR * smpl_scale[smpl_states[i]];
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *count)
{
    (void)instance;
    *count = SMPL_ROOTS;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *count)
{
    (void)instance;
    *count = MODEL_STATES;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return smpl_say(S, fmi3Error, "this FMU has no event mode in co-simulation");
}

fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keeps_going, fmi3Boolean *event, fmi3Boolean *terminate,
    fmi3Boolean *early, fmi3Float64 *last)
{
    const double near = 1e-9 * SMPL_STEP, to = time + step;
    int ok = 1;
    (void)keeps_going;
    NEEDS(S->co_simulation ? IN(STEP) : 0u, "fmi3DoStep");
    *event = *terminate = *early = false;
    if (!(step > 0.0) || fabs(time - S->now.time) > near) {
        return smpl_say(S, fmi3Error, "a step of %g from %.15g is none that this FMU, which is at %.15g, can take", step, time, S->now.time);
    }
    while (ok && !S->now.ended && S->now.time < to - near) {
        const double sample = smpl_next_sample(S);
        const int samples = sample <= to + near;
        int changed = 0;
        if (!S->now.open) ok = smpl_sample_start(S) && smpl_events(S, &changed);
        ok = ok && smpl_integrate(S, samples ? sample : to);
        if (ok && samples && !S->now.ended) ok = smpl_sample_end(S);
    }
    memcpy(S->u_before, S->u, sizeof(double) * MODEL_ACTIONS);
    *last = S->now.time;
    *terminate = S->now.ended != 0;
    return ok ? fmi3OK : fmi3Error;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
{
    (void)clock, (void)time;
    return smpl_say(S, fmi3Error, "this FMU has no clocks");
}
