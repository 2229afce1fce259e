/* A first-order lag as an FMI 2.0 slave, and its bad brothers, chosen by the guid: crash, hang, error, nan.
 *   theta' = q,  q = (2 delta_e - theta) / 0.5,  nz = 1 - 4 delta_e (direct feed-through)
 * References: 0 delta_e, 1 thrust; 10 theta, 11 q, 12 nz; 100 ... parameters, 101 is init.theta.
 * The lag is solved exactly for inputs that are linear inside a step (derivatives given) or held. */
#include <math.h>
#include <signal.h>
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
    double r[256], slope;
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
    toy->r[11] = (2.0 * toy->r[0] - toy->r[10]) / TAU;
    toy->r[12] = 1.0 - 4.0 * toy->r[0];
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
STUB(fmi2GetInteger) STUB(fmi2GetBoolean) STUB(fmi2GetString) STUB(fmi2SetBoolean) STUB(fmi2SetString)
STUB(fmi2GetFMUstate) STUB(fmi2SetFMUstate) STUB(fmi2FreeFMUstate) STUB(fmi2SerializedFMUstateSize) STUB(fmi2SerializeFMUstate)
STUB(fmi2DeSerializeFMUstate) STUB(fmi2GetDirectionalDerivative) STUB(fmi2GetRealOutputDerivatives) STUB(fmi2CancelStep)
STUB(fmi2GetStatus) STUB(fmi2GetRealStatus) STUB(fmi2GetIntegerStatus) STUB(fmi2GetBooleanStatus) STUB(fmi2GetStringStatus)
API int fmi2SetInteger(void *c, const unsigned *vr, size_t n, const int *value) {
    for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i];
    return 0;
}
