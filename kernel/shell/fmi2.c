/* FMI 2.0, co-simulation and model exchange, over fmu.h.  Types are those of the standard on
 * every platform served here. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fmu.h"

typedef int fmi2Boolean;
typedef int fmi2Status;
typedef unsigned int fmi2ValueReference;
typedef void (*logger_function)(void *environment, const char *instance, fmi2Status status,
                                const char *category, const char *message, ...);

typedef struct {
    logger_function logger;
    void *(*allocate)(size_t, size_t); /* not used: as the model description states */
    void (*release)(void *);
    void (*step_finished)(void *, fmi2Status);
    void *environment;
} callback_functions;

typedef struct {
    fmi2Boolean again, terminate, nominals_changed, states_changed, next_defined;
    double next_time;
} event_info;

enum { MODEL_EXCHANGE, CO_SIMULATION };
enum { DO_STEP_STATUS, PENDING_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED };

static void report_fmi2(const fmu_logger *logger, int status, const char *text) {
    logger_function function = (logger_function)logger->callback;
    char message[2048]; /* the message is a printf format */
    size_t k = 0;
    if (!function) return;
    for (; *text && k + 2 < sizeof message; text++) {
        if (*text == '%') message[k++] = '%';
        message[k++] = *text;
    }
    message[k] = 0;
    function(logger->environment, logger->name, status, "logStatusError", message);
}

/* ---- life ------------------------------------------------------------------------------------ */

AM_FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
AM_FMI const char *fmi2GetVersion(void) { return "2.0"; }

AM_FMI fmu *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                            const callback_functions *callbacks, fmi2Boolean visible,
                            fmi2Boolean logging) {
    fmu_logger logger = {.report = report_fmi2};
    (void)visible;
    (void)logging; /* only errors are logged, and they always are */
    if (callbacks) {
        logger.callback = (void (*)(void))callbacks->logger;
        logger.environment = callbacks->environment;
    }
    snprintf(logger.name, sizeof logger.name, "%s", name ? name : "");
    if (type != CO_SIMULATION && type != MODEL_EXCHANGE) {
        report_fmi2(
            &logger, FMU_ERROR,
            "unknown type of instance; FMI 2.0 knows model exchange (0) and co-simulation (1)");
        return NULL;
    }
    return fmu_open(resources, guid, type == CO_SIMULATION ? FMU_CO_SIMULATION : FMU_MODEL_EXCHANGE,
                    &logger);
}

AM_FMI void fmi2FreeInstance(fmu *f) { fmu_close(f); }

AM_FMI fmi2Status fmi2SetDebugLogging(fmu *f, fmi2Boolean on, size_t n,
                                      const char *const categories[]) {
    (void)on;
    (void)n;
    (void)categories;
    return f ? FMU_OK : FMU_ERROR;
}

AM_FMI fmi2Status fmi2SetupExperiment(fmu *f, fmi2Boolean tolerance_defined, double tolerance,
                                      double start, fmi2Boolean stop_defined, double stop) {
    /* the step is fixed by mode.step */
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    return fmu_set_start(f, start);
}

AM_FMI fmi2Status fmi2EnterInitializationMode(fmu *f) { return fmu_begin_initialization(f); }
AM_FMI fmi2Status fmi2ExitInitializationMode(fmu *f) { return fmu_end_initialization(f); }
AM_FMI fmi2Status fmi2Terminate(fmu *f) { return fmu_stop(f); }
AM_FMI fmi2Status fmi2Reset(fmu *f) { return fmu_reset(f); }

/* ---- values ---------------------------------------------------------------------------------- */

AM_FMI fmi2Status fmi2GetReal(fmu *f, const fmi2ValueReference vr[], size_t n, double values[]) {
    return fmu_get(f, vr, n, values, n);
}

AM_FMI fmi2Status fmi2SetReal(fmu *f, const fmi2ValueReference vr[], size_t n,
                              const double values[]) {
    return fmu_set(f, vr, n, values, n);
}

AM_FMI fmi2Status fmi2GetInteger(fmu *f, const fmi2ValueReference vr[], size_t n, int values[]) {
    if (fmu_check_integers(f, vr, n)) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        double value;
        if (fmu_get(f, vr + k, 1, &value, 1)) return FMU_ERROR;
        values[k] = (int)lrint(value);
    }
    return FMU_OK;
}

AM_FMI fmi2Status fmi2SetInteger(fmu *f, const fmi2ValueReference vr[], size_t n,
                                 const int values[]) {
    if (fmu_check_integers(f, vr, n)) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        double value = values[k];
        if (fmu_set(f, vr + k, 1, &value, 1)) return FMU_ERROR;
    }
    return FMU_OK;
}

AM_FMI fmi2Status fmi2SetRealInputDerivatives(fmu *f, const fmi2ValueReference vr[], size_t n,
                                              const int order[], const double values[]) {
    for (size_t k = 0; k < n; k++) {
        if (order[k] != 1) {
            return fmu_refuse(
                f, "derivative of order %d of an input; only the first derivative is taken",
                order[k]);
        }
    }
    return fmu_set_slopes(f, vr, n, values);
}

AM_FMI fmi2Status fmi2GetDirectionalDerivative(fmu *f, const fmi2ValueReference unknowns[],
                                               size_t nu, const fmi2ValueReference knowns[],
                                               size_t nk, const double seed[],
                                               double sensitivity[]) {
    return fmu_directional(f, unknowns, nu, knowns, nk, seed, sensitivity);
}

/* ---- steps ----------------------------------------------------------------------------------- */

AM_FMI fmi2Status fmi2DoStep(fmu *f, double t, double dt, fmi2Boolean no_set_state_prior) {
    (void)no_set_state_prior;
    return fmu_step(f, t, dt);
}

AM_FMI fmi2Status fmi2GetRealStatus(fmu *f, int kind, double *value) {
    if (!f || kind != LAST_SUCCESSFUL_TIME) {
        return fmu_refuse(f, "status %d has no real value", kind);
    }
    *value = fmu_time(f);
    return FMU_OK;
}

AM_FMI fmi2Status fmi2GetBooleanStatus(fmu *f, int kind, fmi2Boolean *value) {
    if (!f || kind != TERMINATED) return fmu_refuse(f, "status %d has no truth value", kind);
    *value = 0; /* the model never ends a simulation */
    return FMU_OK;
}

/* ---- model exchange -------------------------------------------------------------------------- */

AM_FMI fmi2Status fmi2EnterEventMode(fmu *f) { return fmu_begin_event(f); }
AM_FMI fmi2Status fmi2EnterContinuousTimeMode(fmu *f) { return fmu_begin_continuous(f); }

AM_FMI fmi2Status fmi2NewDiscreteStates(fmu *f, event_info *info) {
    event_info found = {0};
    int status = fmu_update_discrete(f, &found.next_time);
    found.next_defined = status == FMU_OK && isfinite(found.next_time);
    *info = found;
    return status;
}

AM_FMI fmi2Status fmi2CompletedIntegratorStep(fmu *f, fmi2Boolean no_set_state_prior,
                                              fmi2Boolean *enter_event_mode,
                                              fmi2Boolean *terminate) {
    (void)no_set_state_prior;
    *enter_event_mode = *terminate = 0;
    return fmu_complete_step(f, enter_event_mode);
}

AM_FMI fmi2Status fmi2SetTime(fmu *f, double time) { return fmu_set_time(f, time); }
AM_FMI fmi2Status fmi2SetContinuousStates(fmu *f, const double x[], size_t n) {
    return fmu_set_states(f, x, n);
}
AM_FMI fmi2Status fmi2GetContinuousStates(fmu *f, double x[], size_t n) {
    return fmu_get_states(f, x, n);
}
AM_FMI fmi2Status fmi2GetDerivatives(fmu *f, double dx[], size_t n) {
    return fmu_get_derivatives(f, dx, n);
}
AM_FMI fmi2Status fmi2GetNominalsOfContinuousStates(fmu *f, double x[], size_t n) {
    return fmu_get_nominals(f, x, n);
}

AM_FMI fmi2Status fmi2GetEventIndicators(fmu *f, double z[], size_t n) {
    (void)z;
    return fmu_get_indicators(f, n);
}

/* ---- stored states --------------------------------------------------------------------------- */

AM_FMI fmi2Status fmi2GetFMUstate(fmu *f, fmu_state **state) { return fmu_get_state(f, state); }
AM_FMI fmi2Status fmi2SetFMUstate(fmu *f, const fmu_state *state) {
    return fmu_set_state(f, state);
}

AM_FMI fmi2Status fmi2FreeFMUstate(fmu *f, fmu_state **state) {
    fmu_free_state(state);
    return f ? FMU_OK : FMU_ERROR;
}

AM_FMI fmi2Status fmi2SerializedFMUstateSize(fmu *f, const fmu_state *state, size_t *size) {
    return fmu_state_size(f, state, size);
}

AM_FMI fmi2Status fmi2SerializeFMUstate(fmu *f, const fmu_state *state, char bytes[], size_t n) {
    return fmu_save_state(f, state, bytes, n);
}

AM_FMI fmi2Status fmi2DeSerializeFMUstate(fmu *f, const char bytes[], size_t n, fmu_state **state) {
    return fmu_load_state(f, bytes, n, state);
}

/* ---- what the standard names and this FMU does not offer ----------------------------------------
 * Importers load every function, so all are there; the model description states that they are not
 * to be called. */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define NOT_OFFERED(function, why, ...) \
    AM_FMI fmi2Status function(fmu *f, __VA_ARGS__) { return fmu_refuse(f, #function ": " why); }
#define NO_VARIABLES(function, type)                                                             \
    AM_FMI fmi2Status function(fmu *f, const fmi2ValueReference vr[], size_t n, type values[]) { \
        return f && n == 0 ? FMU_OK                                                              \
                           : fmu_refuse(f, #function ": the FMU has no variable of this type");  \
    }
#define ASYNCHRONOUS "steps are never left pending"

NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2GetString, const char *)
NO_VARIABLES(fmi2SetString, const char *const)

NOT_OFFERED(fmi2GetStatus, ASYNCHRONOUS, int kind, fmi2Status *value)
NOT_OFFERED(fmi2GetIntegerStatus, ASYNCHRONOUS, int kind, int *value)
NOT_OFFERED(fmi2GetStringStatus, ASYNCHRONOUS, int kind, const char **value)
AM_FMI fmi2Status fmi2CancelStep(fmu *f) { return fmu_refuse(f, "fmi2CancelStep: " ASYNCHRONOUS); }

NOT_OFFERED(fmi2GetRealOutputDerivatives, "no output derivatives are given",
            const fmi2ValueReference vr[], size_t n, const int order[], double values[])
