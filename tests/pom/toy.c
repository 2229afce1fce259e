/* A first-order lag as an FMI 2.0 slave and model, and its brothers, chosen by the guid: crash, hang, error, nan;
 * fixed (steps of 1/60 s only), killed (by SIGKILL, once); event.
 *   theta' = q,  q = (2 delta_e - theta) / 0.5,  nz = 1 - 4 delta_e - 0.1 gear + 0.01 notch (direct feed-through)
 * References: 0 delta_e, 1 thrust, 2 gear (Boolean), 3 notch (Integer); 10 theta, 11 q, 12 nz; 100 ... parameters, 101 is init.theta.
 * As a slave the lag is solved exactly for inputs that are linear inside a step (derivatives given) or held.
 * As a model with the guid "event" q jumps by 0.05 rad/s at t = 3.01 s, which it announces as a time event. */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define API __attribute__((visibility("default")))
#define TAU 0.5

typedef struct {
    void *functions[5];
    void *environment;
} callbacks_t;
typedef void (*logger_t)(void *, const char *, int, const char *, const char *, ...);

typedef struct {
    double r[256], slope, t, jump;
    int continuous;
    char kind[16];
    logger_t logger;
    void *environment;
} toy_t;

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *category) { return 0; }

API void *fmi2Instantiate(const char *name, int type, const char *guid, const char *place, const void **callbacks, int visible, int logging) {
    toy_t *toy = calloc(1, sizeof *toy);
    strncpy(toy->kind, guid, sizeof toy->kind - 1);
    toy->logger = (logger_t)callbacks[0];
    toy->environment = (void *)callbacks[4];
    return toy;
}
API void fmi2FreeInstance(void *c) { free(c); }
API int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop) { return 0; }
API int fmi2EnterInitializationMode(void *c) { return 0; }
API int fmi2ExitInitializationMode(void *c) {
    ((toy_t *)c)->r[10] = ((toy_t *)c)->r[101];
    return 0;
}
API int fmi2Terminate(void *c) { return 0; }
API int fmi2Reset(void *c) { return 0; }

API int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *value) {
    toy_t *toy = c;
    toy->r[11] = (2.0 * toy->r[0] - toy->r[10]) / TAU + toy->jump;
    toy->r[12] = 1.0 - 4.0 * toy->r[0] - 0.1 * toy->r[2] + 0.01 * toy->r[3];
    for (size_t i = 0; i < n; i++) value[i] = toy->r[vr[i]];
    return 0;
}
API int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *value) {
    for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i];
    ((toy_t *)c)->slope = 0.0;
    return 0;
}
API int fmi2SetRealInputDerivatives(void *c, const unsigned *vr, size_t n, const int *order, const double *value) {
    for (size_t i = 0; i < n; i++)
        if (vr[i] == 0) ((toy_t *)c)->slope = value[i];
    return 0;
}
API int fmi2DoStep(void *c, double t, double h, int no_set) {
    toy_t *toy = c;
    if (!strcmp(toy->kind, "crash") && t > 0.5) raise(SIGSEGV);
    if (!strcmp(toy->kind, "killed") && fopen(getenv("TOY_KILLED"), "wx")) raise(SIGKILL); /* the first time only */
    if (!strcmp(toy->kind, "fixed") && fabs(h - 1.0 / 60.0) > 1e-12) return 3;
    if (!strcmp(toy->kind, "hang"))
        for (volatile double x = 1.0; x > 0.0;) x += 1.0;
    if (!strcmp(toy->kind, "error") && t > 0.99) {
        toy->logger(toy->environment, "toy", 3, "logStatusError", "the engine has left the wing");
        return 3;
    }
    /* theta' = (2 (u + s t) - theta)/TAU */
    const double u = toy->r[0], s = toy->slope, e = exp(-h / TAU);
    toy->r[10] = toy->r[10] * e + 2.0 * (u - s * TAU) * (1.0 - e) + 2.0 * s * h;
    toy->r[0] = u + s * h;
    if (!strcmp(toy->kind, "nan") && t > 0.99) toy->r[10] = NAN;
    return 0;
}

#define STUB(name) \
    API int name(void) { return 3; }
STUB(fmi2GetInteger) STUB(fmi2GetBoolean) STUB(fmi2GetString) STUB(fmi2SetString)
STUB(fmi2GetFMUstate) STUB(fmi2SetFMUstate) STUB(fmi2FreeFMUstate) STUB(fmi2SerializedFMUstateSize) STUB(fmi2SerializeFMUstate)
STUB(fmi2DeSerializeFMUstate) STUB(fmi2GetDirectionalDerivative) STUB(fmi2GetRealOutputDerivatives) STUB(fmi2CancelStep)
STUB(fmi2GetStatus) STUB(fmi2GetRealStatus) STUB(fmi2GetIntegerStatus) STUB(fmi2GetBooleanStatus) STUB(fmi2GetStringStatus)
API int fmi2SetInteger(void *c, const unsigned *vr, size_t n, const int *value) {
    if (((toy_t *)c)->continuous) return 3; /* the standard: outside continuous-time mode only */
    for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i];
    return 0;
}
API int fmi2SetBoolean(void *c, const unsigned *vr, size_t n, const int *value) { return fmi2SetInteger(c, vr, n, value); }

/* model exchange: one state, theta */
typedef struct {
    int again, terminate, nominals_changed, states_changed, has_next;
    double next;
} event_t;

API int fmi2EnterEventMode(void *c) { return ((toy_t *)c)->continuous = 0; }
API int fmi2EnterContinuousTimeMode(void *c) {
    ((toy_t *)c)->continuous = 1;
    return 0;
}
API int fmi2NewDiscreteStates(void *c, event_t *event) {
    toy_t *toy = c;
    const int jumps = !strcmp(toy->kind, "event");
    *event = (event_t){.has_next = jumps && toy->t < 3.01 - 1e-9, .next = 3.01};
    toy->jump = jumps && !event->has_next ? 0.05 : 0.0;
    return 0;
}
API int fmi2CompletedIntegratorStep(void *c, int no_set, int *enter_event, int *terminate) { return *enter_event = *terminate = 0; }
API int fmi2SetTime(void *c, double t) {
    ((toy_t *)c)->t = t;
    return 0;
}
API int fmi2SetContinuousStates(void *c, const double *x, size_t n) {
    ((toy_t *)c)->r[10] = x[0];
    return 0;
}
API int fmi2GetContinuousStates(void *c, double *x, size_t n) {
    x[0] = ((toy_t *)c)->r[10];
    return 0;
}
API int fmi2GetDerivatives(void *c, double *dx, size_t n) { return fmi2GetReal(c, (unsigned[]){11}, 1, dx); }
API int fmi2GetEventIndicators(void *c, double *z, size_t n) { return 0; }
API int fmi2GetNominalsOfContinuousStates(void *c, double *x, size_t n) {
    x[0] = 1.0;
    return 0;
}
