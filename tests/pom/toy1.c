/* The lag of toy.c as an FMI 1.0 slave and model, in degrees and with a nose-down elevator:
 *   theta' = q,  q = (-2 elevator - theta) / 0.5,  nz = 1 + 4 elevator [rad] - 0.1 down + 0.01 notch + 0.001 lever
 * References: 0 elevator [deg], 1 thrust; 2 down, 4 lever (Boolean), 3 notch (Integer); 10 theta [deg], 11 q [deg/s], 12 nz; 100 ...
 * parameters, 101 is the first theta.  The guid "error" stops after a second, "refuse" at the initialisation. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define API __attribute__((visibility("default")))
#define NAME(name) toy_##name
#define TAU 0.5
#define RAD (3.14159265358979323846 / 180.0)

typedef struct {
    void *logger, *allocate, *release, *finished;
} callbacks_t;
typedef void (*logger_t)(void *, const char *, int, const char *, const char *, ...);

typedef struct {
    double r[256], slope, t;
    char kind[16];
    logger_t logger;
} toy_t;

typedef struct {
    char converged, references_changed, states_changed, terminate, has_next;
    double next;
} event_t;

static void *made(const char *guid, callbacks_t functions) {
    toy_t *toy = calloc(1, sizeof *toy);
    strncpy(toy->kind, guid, sizeof toy->kind - 1);
    toy->logger = (logger_t)functions.logger;
    return toy;
}

API const char *NAME(fmiGetVersion)(void) { return "1.0"; }
API const char *NAME(fmiGetTypesPlatform)(void) { return "standard32"; }
API const char *NAME(fmiGetModelTypesPlatform)(void) { return "standard32"; }
API int NAME(fmiSetDebugLogging)(void *c, char on) { return 0; }

API void *NAME(fmiInstantiateSlave)(const char *name, const char *guid, const char *place, const char *mime, double timeout, char visible,
                                    char interactive, callbacks_t functions, char logging) {
    return made(guid, functions);
}
API void *NAME(fmiInstantiateModel)(const char *name, const char *guid, callbacks_t functions, char logging) { return made(guid, functions); }
API void NAME(fmiFreeSlaveInstance)(void *c) { free(c); }
API void NAME(fmiFreeModelInstance)(void *c) { free(c); }

API int NAME(fmiGetReal)(void *c, const unsigned *vr, size_t n, double *value) {
    toy_t *toy = c;
    toy->r[11] = (-2.0 * toy->r[0] - toy->r[10]) / TAU;
    toy->r[12] = 1.0 + 4.0 * RAD * toy->r[0] - 0.1 * toy->r[2] + 0.01 * toy->r[3] + 0.001 * toy->r[4];
    for (size_t i = 0; i < n; i++) value[i] = toy->r[vr[i]];
    return 0;
}
API int NAME(fmiSetReal)(void *c, const unsigned *vr, size_t n, const double *value) {
    for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i];
    ((toy_t *)c)->slope = 0.0;
    return 0;
}
API int NAME(fmiSetInteger)(void *c, const unsigned *vr, size_t n, const int *value) {
    for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i];
    return 0;
}
API int NAME(fmiSetBoolean)(void *c, const unsigned *vr, size_t n, const char *value) {
    for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i];
    return 0;
}
API int NAME(fmiSetRealInputDerivatives)(void *c, const unsigned *vr, size_t n, const int *order, const double *value) {
    for (size_t i = 0; i < n; i++)
        if (vr[i] == 0) ((toy_t *)c)->slope = value[i];
    return 0;
}
static int start(toy_t *toy) {
    toy->r[10] = toy->r[101];
    return !strcmp(toy->kind, "refuse") ? 3 : 0;
}
API int NAME(fmiInitializeSlave)(void *c, double t, char has_stop, double stop) { return start(c); }
API int NAME(fmiDoStep)(void *c, double t, double h, char new_step) {
    toy_t *toy = c;
    if (!strcmp(toy->kind, "error") && t > 0.99) {
        toy->logger(c, "toy", 3, "error", "flap %d has left the %s", 2, "wing");
        return 3;
    }
    const double u = -toy->r[0], s = -toy->slope, e = exp(-h / TAU);
    toy->r[10] = toy->r[10] * e + 2.0 * (u - s * TAU) * (1.0 - e) + 2.0 * s * h;
    toy->r[0] = -(u + s * h);
    return 0;
}
API int NAME(fmiTerminateSlave)(void *c) { return 0; }
API int NAME(fmiTerminate)(void *c) { return 0; }

API int NAME(fmiSetTime)(void *c, double t) { return 0; }
API int NAME(fmiInitialize)(void *c, char controlled, double tolerance, event_t *event) {
    *event = (event_t){.converged = 1};
    return start(c);
}
API int NAME(fmiEventUpdate)(void *c, char intermediate, event_t *event) {
    *event = (event_t){.converged = 1};
    return 0;
}
API int NAME(fmiCompletedIntegratorStep)(void *c, char *event) { return *event = 0; }
API int NAME(fmiSetContinuousStates)(void *c, const double *x, size_t n) {
    ((toy_t *)c)->r[10] = x[0];
    return 0;
}
API int NAME(fmiGetContinuousStates)(void *c, double *x, size_t n) {
    x[0] = ((toy_t *)c)->r[10];
    return 0;
}
API int NAME(fmiGetNominalContinuousStates)(void *c, double *x, size_t n) {
    x[0] = 1.0;
    return 0;
}
API int NAME(fmiGetDerivatives)(void *c, double *dx, size_t n) { return NAME(fmiGetReal)(c, (unsigned[]){11}, 1, dx); }
API int NAME(fmiGetEventIndicators)(void *c, double *z, size_t n) { return 0; }

#define STUB(name) \
    API int NAME(name)(void) { return 3; }
STUB(fmiGetInteger) STUB(fmiGetBoolean) STUB(fmiGetString) STUB(fmiSetString) STUB(fmiResetSlave) STUB(fmiGetRealOutputDerivatives)
STUB(fmiCancelStep) STUB(fmiGetStatus) STUB(fmiGetRealStatus) STUB(fmiGetIntegerStatus) STUB(fmiGetBooleanStatus) STUB(fmiGetStringStatus)
STUB(fmiGetStateValueReferences)
