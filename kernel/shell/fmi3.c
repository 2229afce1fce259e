/* FMI 3.0, co-simulation and model exchange, over fmu.h. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>

#include "fmu.h"

typedef int fmi3Status;
typedef uint32_t fmi3ValueReference;
typedef void (*logger_function)(void *environment, fmi3Status status, const char *category,
                                const char *message);
typedef void (*update_function)(void *environment, double time, bool set_requested,
                                bool get_allowed, bool step_finished, bool can_return,
                                bool *return_requested, double *return_time);
typedef void (*notice_function)(void *environment);
typedef void (*lock_function)(void);

static void report_fmi3(const fmu_logger *logger, int status, const char *text) {
    if (logger->callback) {
        ((logger_function)logger->callback)(logger->environment, status, "logStatusError", text);
    }
}

static fmu_logger logger_of(const char *name, void *environment, logger_function callback) {
    fmu_logger logger = {
        .report = report_fmi3, .environment = environment, .callback = (void (*)(void))callback};
    snprintf(logger.name, sizeof logger.name, "%s", name ? name : "");
    return logger;
}

/* ---- life ------------------------------------------------------------------------------------ */

AM_FMI const char *fmi3GetVersion(void) { return "3.0"; }

AM_FMI fmu *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                        bool visible, bool logging, bool events, bool early_return,
                                        const fmi3ValueReference intermediate[], size_t n,
                                        void *environment, logger_function callback,
                                        update_function update) {
    fmu_logger logger = logger_of(name, environment, callback);
    /* only errors are logged, and they always are */
    (void)visible;
    (void)logging;
    (void)early_return;
    (void)intermediate;
    (void)update;
    if (events || n) {
        report_fmi3(
            &logger, FMU_ERROR,
            "this FMU has neither an event mode nor intermediate updates; instantiate it without "
            "them");
        return NULL;
    }
    return fmu_open(resources, token, FMU_CO_SIMULATION, &logger);
}

AM_FMI fmu *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources,
                                         bool visible, bool logging, void *environment,
                                         logger_function callback) {
    fmu_logger logger = logger_of(name, environment, callback);
    (void)visible;
    (void)logging;
    return fmu_open(resources, token, FMU_MODEL_EXCHANGE, &logger);
}

AM_FMI fmu *fmi3InstantiateScheduledExecution(const char *name, const char *token,
                                              const char *resources, bool visible, bool logging,
                                              void *environment, logger_function callback,
                                              notice_function clock, lock_function lock,
                                              lock_function unlock) {
    fmu_logger logger = logger_of(name, environment, callback);
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)clock;
    (void)lock;
    (void)unlock;
    report_fmi3(&logger, FMU_ERROR, "this FMU offers no scheduled execution");
    return NULL;
}

AM_FMI void fmi3FreeInstance(fmu *f) { fmu_close(f); }

AM_FMI fmi3Status fmi3SetDebugLogging(fmu *f, bool on, size_t n, const char *const categories[]) {
    (void)on;
    (void)n;
    (void)categories;
    return f ? FMU_OK : FMU_ERROR;
}

AM_FMI fmi3Status fmi3EnterInitializationMode(fmu *f, bool tolerance_defined, double tolerance,
                                              double start, bool stop_defined, double stop) {
    /* the step is fixed by mode.step */
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    return fmu_set_start(f, start) ? FMU_ERROR : fmu_begin_initialization(f);
}

AM_FMI fmi3Status fmi3ExitInitializationMode(fmu *f) { return fmu_end_initialization(f); }
AM_FMI fmi3Status fmi3Terminate(fmu *f) { return fmu_stop(f); }
AM_FMI fmi3Status fmi3Reset(fmu *f) { return fmu_reset(f); }

/* ---- values ---------------------------------------------------------------------------------- */

AM_FMI fmi3Status fmi3GetFloat64(fmu *f, const fmi3ValueReference vr[], size_t n, double values[],
                                 size_t nvalues) {
    return fmu_get(f, vr, n, values, nvalues);
}

AM_FMI fmi3Status fmi3SetFloat64(fmu *f, const fmi3ValueReference vr[], size_t n,
                                 const double values[], size_t nvalues) {
    return fmu_set(f, vr, n, values, nvalues);
}

static int scalars(const fmu *f, size_t n, size_t nvalues) {
    if (n == nvalues) return FMU_OK;
    return fmu_refuse(f, "%lu values for %lu variables; every variable of this type is a scalar",
                      (unsigned long)nvalues, (unsigned long)n);
}

AM_FMI fmi3Status fmi3GetInt64(fmu *f, const fmi3ValueReference vr[], size_t n, int64_t values[],
                               size_t nvalues) {
    if (scalars(f, n, nvalues) || fmu_check_integers(f, vr, n)) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        double value;
        if (fmu_get(f, vr + k, 1, &value, 1)) return FMU_ERROR;
        values[k] = llrint(value);
    }
    return FMU_OK;
}

AM_FMI fmi3Status fmi3SetInt64(fmu *f, const fmi3ValueReference vr[], size_t n,
                               const int64_t values[], size_t nvalues) {
    if (scalars(f, n, nvalues) || fmu_check_integers(f, vr, n)) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        double value = (double)values[k];
        if (fmu_set(f, vr + k, 1, &value, 1)) return FMU_ERROR;
    }
    return FMU_OK;
}

AM_FMI fmi3Status fmi3GetUInt64(fmu *f, const fmi3ValueReference vr[], size_t n, uint64_t values[],
                                size_t nvalues) {
    return scalars(f, n, nvalues) ? FMU_ERROR : fmu_get_samples(f, vr, n, values);
}

AM_FMI fmi3Status fmi3SetUInt64(fmu *f, const fmi3ValueReference vr[], size_t n,
                                const uint64_t values[], size_t nvalues) {
    return scalars(f, n, nvalues) ? FMU_ERROR : fmu_set_samples(f, vr, n, values);
}

AM_FMI fmi3Status fmi3EnterConfigurationMode(fmu *f) { return fmu_begin_configuration(f); }
AM_FMI fmi3Status fmi3ExitConfigurationMode(fmu *f) { return fmu_end_configuration(f); }

static int one_to_one(const fmu *f, size_t nseed, size_t seeded, size_t nto, size_t found) {
    if (nseed == seeded && nto == found) return FMU_OK;
    return fmu_refuse(
        f, "%lu seeds and %lu sensitivities; every variable is a scalar: give %lu and %lu",
        (unsigned long)nseed, (unsigned long)nto, (unsigned long)seeded, (unsigned long)found);
}

AM_FMI fmi3Status fmi3GetDirectionalDerivative(fmu *f, const fmi3ValueReference unknowns[],
                                               size_t nu, const fmi3ValueReference knowns[],
                                               size_t nk, const double seed[], size_t nseed,
                                               double sensitivity[], size_t nsensitivity) {
    if (one_to_one(f, nseed, nk, nsensitivity, nu)) return FMU_ERROR;
    return fmu_directional(f, unknowns, nu, knowns, nk, seed, sensitivity);
}

AM_FMI fmi3Status fmi3GetAdjointDerivative(fmu *f, const fmi3ValueReference unknowns[], size_t nu,
                                           const fmi3ValueReference knowns[], size_t nk,
                                           const double seed[], size_t nseed, double sensitivity[],
                                           size_t nsensitivity) {
    if (one_to_one(f, nseed, nu, nsensitivity, nk)) return FMU_ERROR;
    return fmu_adjoint(f, unknowns, nu, knowns, nk, seed, sensitivity);
}

/* ---- steps ----------------------------------------------------------------------------------- */

AM_FMI fmi3Status fmi3DoStep(fmu *f, double t, double dt, bool no_set_state_prior,
                             bool *event_needed, bool *terminate, bool *early_return,
                             double *last_time) {
    (void)no_set_state_prior;
    int status = fmu_step(f, t, dt);
    *event_needed = *terminate = *early_return = false;
    if (f) *last_time = fmu_time(f);
    return status;
}

/* ---- model exchange -------------------------------------------------------------------------- */

AM_FMI fmi3Status fmi3EnterEventMode(fmu *f) { return fmu_begin_event(f); }
AM_FMI fmi3Status fmi3EnterContinuousTimeMode(fmu *f) { return fmu_begin_continuous(f); }

AM_FMI fmi3Status fmi3UpdateDiscreteStates(fmu *f, bool *again, bool *terminate,
                                           bool *nominals_changed, bool *states_changed,
                                           bool *next_defined, double *next_time) {
    *again = *terminate = *nominals_changed = *states_changed = false;
    int status = fmu_update_discrete(f, next_time);
    *next_defined = status == FMU_OK && isfinite(*next_time);
    return status;
}

AM_FMI fmi3Status fmi3CompletedIntegratorStep(fmu *f, bool no_set_state_prior,
                                              bool *enter_event_mode, bool *terminate) {
    (void)no_set_state_prior;
    int event = 0;
    int status = fmu_complete_step(f, &event);
    *enter_event_mode = event;
    *terminate = false;
    return status;
}

AM_FMI fmi3Status fmi3SetTime(fmu *f, double time) { return fmu_set_time(f, time); }
AM_FMI fmi3Status fmi3SetContinuousStates(fmu *f, const double x[], size_t n) {
    return fmu_set_states(f, x, n);
}
AM_FMI fmi3Status fmi3GetContinuousStates(fmu *f, double x[], size_t n) {
    return fmu_get_states(f, x, n);
}
AM_FMI fmi3Status fmi3GetContinuousStateDerivatives(fmu *f, double dx[], size_t n) {
    return fmu_get_derivatives(f, dx, n);
}
AM_FMI fmi3Status fmi3GetNominalsOfContinuousStates(fmu *f, double x[], size_t n) {
    return fmu_get_nominals(f, x, n);
}
AM_FMI fmi3Status fmi3GetNumberOfContinuousStates(fmu *f, size_t *n) {
    return fmu_count_states(f, n);
}

AM_FMI fmi3Status fmi3GetEventIndicators(fmu *f, double z[], size_t n) {
    (void)z;
    return fmu_get_indicators(f, n);
}

AM_FMI fmi3Status fmi3GetNumberOfEventIndicators(fmu *f, size_t *n) {
    *n = 0;
    return fmu_get_indicators(f, 0);
}

/* ---- stored states --------------------------------------------------------------------------- */

AM_FMI fmi3Status fmi3GetFMUState(fmu *f, fmu_state **state) { return fmu_get_state(f, state); }
AM_FMI fmi3Status fmi3SetFMUState(fmu *f, const fmu_state *state) {
    return fmu_set_state(f, state);
}

AM_FMI fmi3Status fmi3FreeFMUState(fmu *f, fmu_state **state) {
    fmu_free_state(state);
    return f ? FMU_OK : FMU_ERROR;
}

AM_FMI fmi3Status fmi3SerializedFMUStateSize(fmu *f, const fmu_state *state, size_t *size) {
    return fmu_state_size(f, state, size);
}

AM_FMI fmi3Status fmi3SerializeFMUState(fmu *f, const fmu_state *state, uint8_t bytes[], size_t n) {
    return fmu_save_state(f, state, bytes, n);
}

AM_FMI fmi3Status fmi3DeserializeFMUState(fmu *f, const uint8_t bytes[], size_t n,
                                          fmu_state **state) {
    return fmu_load_state(f, bytes, n, state);
}

/* ---- what the standard names and this FMU does not offer ----------------------------------------
 * Importers load every function, so all are there; the model description states that they are not
 * to be called. */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define NOT_OFFERED(function, why, ...) \
    AM_FMI fmi3Status function(fmu *f, __VA_ARGS__) { return fmu_refuse(f, #function ": " why); }
#define NOT_OFFERED_PLAIN(function, why) \
    AM_FMI fmi3Status function(fmu *f) { return fmu_refuse(f, #function ": " why); }
#define NO_VARIABLES(type, ctype)                                                    \
    AM_FMI fmi3Status fmi3Get##type(fmu *f, const fmi3ValueReference vr[], size_t n, \
                                    ctype values[], size_t nvalues) {                \
        return f && n == 0 ? FMU_OK : fmu_refuse(f, "fmi3Get" #type ": " NO_TYPE);   \
    }                                                                                \
    AM_FMI fmi3Status fmi3Set##type(fmu *f, const fmi3ValueReference vr[], size_t n, \
                                    const ctype values[], size_t nvalues) {          \
        return f && n == 0 ? FMU_OK : fmu_refuse(f, "fmi3Set" #type ": " NO_TYPE);   \
    }
#define NO_TYPE "the FMU has no variable of this type"
#define NO_CLOCKS "the FMU has no clocks"
#define NO_STEPS "co-simulation has no event mode here"
#define VRS const fmi3ValueReference vr[], size_t n

NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, char *)

NOT_OFFERED(fmi3GetBinary, NO_TYPE, VRS, size_t sizes[], const uint8_t *values[], size_t nvalues)
NOT_OFFERED(fmi3SetBinary, NO_TYPE, VRS, const size_t sizes[], const uint8_t *const values[],
            size_t nvalues)
NOT_OFFERED(fmi3GetClock, NO_CLOCKS, VRS, bool values[])
NOT_OFFERED(fmi3SetClock, NO_CLOCKS, VRS, const bool values[])
NOT_OFFERED(fmi3GetIntervalDecimal, NO_CLOCKS, VRS, double intervals[], int qualifiers[])
NOT_OFFERED(fmi3GetIntervalFraction, NO_CLOCKS, VRS, uint64_t counters[], uint64_t resolutions[],
            int qualifiers[])
NOT_OFFERED(fmi3GetShiftDecimal, NO_CLOCKS, VRS, double shifts[])
NOT_OFFERED(fmi3GetShiftFraction, NO_CLOCKS, VRS, uint64_t counters[], uint64_t resolutions[])
NOT_OFFERED(fmi3SetIntervalDecimal, NO_CLOCKS, VRS, const double intervals[])
NOT_OFFERED(fmi3SetIntervalFraction, NO_CLOCKS, VRS, const uint64_t counters[],
            const uint64_t resolutions[])
NOT_OFFERED(fmi3SetShiftDecimal, NO_CLOCKS, VRS, const double shifts[])
NOT_OFFERED(fmi3SetShiftFraction, NO_CLOCKS, VRS, const uint64_t counters[],
            const uint64_t resolutions[])
NOT_OFFERED(fmi3ActivateModelPartition, NO_CLOCKS, fmi3ValueReference clock, double time)

NOT_OFFERED_PLAIN(fmi3EnterStepMode, NO_STEPS)
NOT_OFFERED_PLAIN(fmi3EvaluateDiscreteStates,
                  "discrete states are updated by fmi3UpdateDiscreteStates only")

NOT_OFFERED(fmi3GetNumberOfVariableDependencies,
            "dependencies do not change; see modelDescription.xml", fmi3ValueReference vr,
            size_t *n)
NOT_OFFERED(fmi3GetVariableDependencies, "dependencies do not change; see modelDescription.xml",
            fmi3ValueReference dependent, size_t elements_of_dependent[],
            fmi3ValueReference independents[], size_t elements_of_independents[], int kinds[],
            size_t n)

NOT_OFFERED(fmi3GetOutputDerivatives, "no output derivatives are given", VRS,
            const int32_t orders[], double values[], size_t nvalues)
