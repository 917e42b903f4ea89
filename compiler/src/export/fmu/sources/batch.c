/* Many instances at once: the numbers of instance i are at memory + i * memory_length. As C a call is a loop over instances, as CUDA one
 * thread per instance. Nothing is allocated. */
#include "core.h"

#include <math.h>
#include <string.h>

#define N MODEL_UNKNOWNS
#define PROGRESS ((sizeof(smpl_progress) + sizeof(double) - 1) / sizeof(double))

#if defined(__CUDACC__)
#define ENTRY extern "C" __global__ void
#define EACH(i, count) const int i = (int)(blockIdx.x * blockDim.x + threadIdx.x); if (i < count)
#elif defined(__cplusplus)
#define ENTRY extern "C" void
#define EACH(i, count) for (int i = 0; i < count; ++i)
#else
#define ENTRY void
#define EACH(i, count) for (int i = 0; i < count; ++i)
#endif

/* What became of an instance. */
enum { RUNS, ENDED, UNSOLVED };

static size_t memory_length(void)
{
    smpl_instance s;
    memset(&s, 0, sizeof s);
    return PROGRESS + smpl_place(&s, NULL);
}

static void open_instance(smpl_instance *s, double *memory)
{
    memset(s, 0, sizeof *s);
    smpl_place(s, memory + PROGRESS);
    memcpy(&s->now, memory, sizeof s->now);
    memset(s->lu.mark, 0, sizeof(int) * N);
}

static void observe(smpl_instance *s, double *observations, double *rewards)
{
    const double clock = smpl_clock(s, s->now.time);
    (void)clock, (void)observations, (void)rewards;
    smpl_look_back(s, clock, s->y, s->yp, 0);
#if SMPL_HAS_observations
    model_observations(clock, s->y, s->yp, s->u_used, s->p, s->c, observations);
#endif
#if SMPL_HAS_rewards
    if (rewards) model_rewards(clock, s->y, s->yp, s->u_used, s->p, s->c, rewards);
#endif
}

/* What a host has to know: lengths of the memory of an instance, of its unknowns, states, actions, parameters, observations, rewards. */
ENTRY smpl_batch_describe(int count, long long *out)
{
    EACH(i, count)
    {
        out[7 * i] = (long long)memory_length();
        out[7 * i + 1] = N;
        out[7 * i + 2] = MODEL_STATES;
        out[7 * i + 3] = MODEL_ACTIONS;
        out[7 * i + 4] = MODEL_PARAMETERS;
        out[7 * i + 5] = SMPL_OBSERVATIONS;
        out[7 * i + 6] = SMPL_REWARDS;
    }
}

/* Begins an episode in the instances that `which` marks. States and parameters that are not a number have their nominal values. */
ENTRY smpl_batch_reset(
    int count, const int *which, const double *states, const double *parameters, double *memory, double *unknowns,
    double *observations, int *status)
{
    EACH(i, count)
    {
        if (which[i]) {
            smpl_instance s;
            double *own = memory + (size_t)i * memory_length();
            open_instance(&s, own);
            smpl_reset(&s);
            for (int k = 0; k < MODEL_STATES; ++k) {
                const double value = states[(size_t)i * MODEL_STATES + k];
                if (!isnan(value)) s.y[k] = value;
            }
            for (int k = 0; k < MODEL_PARAMETERS; ++k) {
                const double value = parameters[(size_t)i * MODEL_PARAMETERS + k];
                if (isnan(value)) continue;
                s.p[k] = value;
                s.p_set[k] = 1.0;
                s.now.parameters_set = 1;
            }
            status[i] = smpl_initialise(&s) ? RUNS : UNSOLVED;
            observe(&s, observations + (size_t)i * SMPL_OBSERVATIONS, 0);
            memcpy(unknowns + (size_t)i * N, s.y, sizeof(double) * N);
            memcpy(own, &s.now, sizeof s.now);
        }
    }
}

/* One step of every instance that runs. `status`: 0 runs, 1 has ended by a failure or success, 2 could not be solved. */
ENTRY smpl_batch_step(
    int count, const double *actions, double *memory, double *unknowns, double *observations, double *rewards, int *status)
{
    EACH(i, count)
    {
        if (status[i] == RUNS) {
            smpl_instance s;
            int changed = 0, solved;
            double *own = memory + (size_t)i * memory_length();
            open_instance(&s, own);
            memcpy(s.u, actions + (size_t)i * MODEL_ACTIONS, sizeof(double) * MODEL_ACTIONS);
            smpl_stale(&s);
            solved = smpl_sample_start(&s) && smpl_events(&s, &changed) && smpl_integrate(&s, smpl_next_sample(&s));
            if (solved && !s.now.ended) solved = smpl_sample_end(&s);
            observe(&s, observations + (size_t)i * SMPL_OBSERVATIONS, rewards + (size_t)i * SMPL_REWARDS);
            memcpy(unknowns + (size_t)i * N, s.y, sizeof(double) * N);
            memcpy(own, &s.now, sizeof s.now);
            status[i] = !solved ? UNSOLVED : s.now.ended ? ENDED : RUNS;
        }
    }
}
