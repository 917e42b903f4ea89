/* The interface of FMI 3.0 (https://fmi-standard.org/docs/3.0.2/) as far as a model implements it. */
#ifndef SMPL_FMI3_H
#define SMPL_FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define FMI3_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI3_EXPORT __attribute__((visibility("default")))
#else
#define FMI3_EXPORT
#endif

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3DependencyKind, fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(
    fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

FMI3_EXPORT const char *fmi3GetVersion(void);
FMI3_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance, fmi3Boolean on, size_t count, const fmi3String *categories);
FMI3_EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment,
    fmi3LogMessageCallback);
FMI3_EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
    fmi3Boolean early, const fmi3ValueReference *intermediate, size_t count, fmi3InstanceEnvironment, fmi3LogMessageCallback,
    fmi3IntermediateUpdateCallback);
FMI3_EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3InstanceEnvironment,
    fmi3LogMessageCallback, fmi3ClockUpdateCallback, fmi3LockPreemptionCallback, fmi3UnlockPreemptionCallback);
FMI3_EXPORT void fmi3FreeInstance(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3EnterInitializationMode(
    fmi3Instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop);
FMI3_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3Terminate(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3Reset(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance);
FMI3_EXPORT fmi3Status fmi3GetFloat32(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Float32 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetFloat32(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Float32 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetFloat64(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Float64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetFloat64(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Float64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetInt8(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Int8 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetInt8(fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Int8 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetUInt8(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3UInt8 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetUInt8(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3UInt8 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetInt16(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Int16 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetInt16(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Int16 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetUInt16(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3UInt16 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetUInt16(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3UInt16 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetInt32(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Int32 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetInt32(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Int32 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetUInt32(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3UInt32 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetUInt32(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3UInt32 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetInt64(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Int64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetInt64(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Int64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetUInt64(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3UInt64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetUInt64(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3UInt64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetBoolean(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Boolean *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetBoolean(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Boolean *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetString(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3String *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetString(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3String *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetBinary(
    fmi3Instance, const fmi3ValueReference *references, size_t count, size_t *sizes, fmi3Binary *values, size_t length);
FMI3_EXPORT fmi3Status fmi3SetBinary(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const size_t *sizes, const fmi3Binary *values, size_t length);
FMI3_EXPORT fmi3Status fmi3GetClock(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Clock *values);
FMI3_EXPORT fmi3Status fmi3SetClock(fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Clock *values);
FMI3_EXPORT fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance, fmi3ValueReference, size_t *count);
FMI3_EXPORT fmi3Status fmi3GetVariableDependencies(
    fmi3Instance, fmi3ValueReference, size_t *elements, fmi3ValueReference *independents, size_t *of_independents,
    fmi3DependencyKind *kinds, size_t count);
FMI3_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance, fmi3FMUState *);
FMI3_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance, fmi3FMUState);
FMI3_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance, fmi3FMUState *);
FMI3_EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance, fmi3FMUState, size_t *size);
FMI3_EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance, fmi3FMUState, fmi3Byte *bytes, size_t size);
FMI3_EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance, const fmi3Byte *bytes, size_t size, fmi3FMUState *);
FMI3_EXPORT fmi3Status fmi3GetDirectionalDerivative(
    fmi3Instance, const fmi3ValueReference *unknowns, size_t unknown_count, const fmi3ValueReference *knowns, size_t known_count,
    const fmi3Float64 *seed, size_t seed_length, fmi3Float64 *sensitivity, size_t length);
FMI3_EXPORT fmi3Status fmi3GetAdjointDerivative(
    fmi3Instance, const fmi3ValueReference *unknowns, size_t unknown_count, const fmi3ValueReference *knowns, size_t known_count,
    const fmi3Float64 *seed, size_t seed_length, fmi3Float64 *sensitivity, size_t length);
FMI3_EXPORT fmi3Status fmi3GetIntervalDecimal(
    fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Float64 *intervals, fmi3IntervalQualifier *qualifiers);
FMI3_EXPORT fmi3Status fmi3GetIntervalFraction(
    fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3UInt64 *counters, fmi3UInt64 *resolutions,
    fmi3IntervalQualifier *qualifiers);
FMI3_EXPORT fmi3Status fmi3GetShiftDecimal(fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3Float64 *shifts);
FMI3_EXPORT fmi3Status fmi3GetShiftFraction(
    fmi3Instance, const fmi3ValueReference *references, size_t count, fmi3UInt64 *counters, fmi3UInt64 *resolutions);
FMI3_EXPORT fmi3Status fmi3SetIntervalDecimal(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Float64 *intervals);
FMI3_EXPORT fmi3Status fmi3SetIntervalFraction(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3UInt64 *counters, const fmi3UInt64 *resolutions);
FMI3_EXPORT fmi3Status fmi3SetShiftDecimal(fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Float64 *shifts);
FMI3_EXPORT fmi3Status fmi3SetShiftFraction(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3UInt64 *counters, const fmi3UInt64 *resolutions);
FMI3_EXPORT fmi3Status fmi3UpdateDiscreteStates(
    fmi3Instance, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals_changed, fmi3Boolean *states_changed,
    fmi3Boolean *has_next, fmi3Float64 *next);
FMI3_EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance, fmi3Boolean keeps_going, fmi3Boolean *event, fmi3Boolean *terminate);
FMI3_EXPORT fmi3Status fmi3SetTime(fmi3Instance, fmi3Float64 time);
FMI3_EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance, const fmi3Float64 *states, size_t length);
FMI3_EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance, fmi3Float64 *derivatives, size_t length);
FMI3_EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance, fmi3Float64 *indicators, size_t length);
FMI3_EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance, fmi3Float64 *states, size_t length);
FMI3_EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance, fmi3Float64 *nominals, size_t length);
FMI3_EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance, size_t *count);
FMI3_EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance, size_t *count);
FMI3_EXPORT fmi3Status fmi3GetOutputDerivatives(
    fmi3Instance, const fmi3ValueReference *references, size_t count, const fmi3Int32 *orders, fmi3Float64 *values, size_t length);
FMI3_EXPORT fmi3Status fmi3DoStep(
    fmi3Instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keeps_going, fmi3Boolean *event, fmi3Boolean *terminate,
    fmi3Boolean *early, fmi3Float64 *last);
FMI3_EXPORT fmi3Status fmi3ActivateModelPartition(fmi3Instance, fmi3ValueReference clock, fmi3Float64 time);

#endif
