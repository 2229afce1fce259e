/* The lag of toy.c as an FMI 3.0 slave and model: theta' = q,  q = (2 delta_e - theta) / 0.5,
 *   nz = 1 - 4 delta_e - 0.1 gear + 0.01 notch + 0.001 lever (direct feed-through)
 * References: 0 delta_e (Float32), 1 thrust (Float64), 2 gear (Boolean), 3 notch (Int8), 4 lever (Enumeration); 10 theta, 11 q, 12 nz;
 * 100 ... parameters, 101 is init.theta.  The tests add the rest of the standard as functions that fail. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#define API __attribute__((visibility("default")))
#define TAU 0.5

typedef struct {
    double r[256];
} toy_t;

API const char *fmi3GetVersion(void) { return "3.0"; }
API void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *place, bool visible, bool logging, bool events,
                                      bool early, const uint32_t *vr, size_t n, void *environment, void *log, void *update) {
    return calloc(1, sizeof(toy_t));
}
API void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *place, bool visible, bool logging,
                                       void *environment, void *log) {
    return calloc(1, sizeof(toy_t));
}
API void fmi3FreeInstance(void *c) { free(c); }
API int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) { return 0; }
API int fmi3ExitInitializationMode(void *c) {
    ((toy_t *)c)->r[10] = ((toy_t *)c)->r[101];
    return 0;
}
API int fmi3Terminate(void *c) { return 0; }

API int fmi3GetFloat64(void *c, const uint32_t *vr, size_t n, double *value, size_t count) {
    toy_t *toy = c;
    toy->r[11] = (2.0 * toy->r[0] - toy->r[10]) / TAU;
    toy->r[12] = 1.0 - 4.0 * toy->r[0] - 0.1 * toy->r[2] + 0.01 * toy->r[3] + 0.001 * toy->r[4];
    for (size_t i = 0; i < n; i++) value[i] = toy->r[vr[i]];
    return 0;
}
#define SETTER(name, type) \
    API int name(void *c, const uint32_t *vr, size_t n, const type *value, size_t count) { \
        for (size_t i = 0; i < n; i++) ((toy_t *)c)->r[vr[i]] = value[i]; \
        return 0; \
    }
SETTER(fmi3SetFloat64, double)
SETTER(fmi3SetFloat32, float)
SETTER(fmi3SetInt8, int8_t)
SETTER(fmi3SetInt64, int64_t)
SETTER(fmi3SetBoolean, bool)

API int fmi3DoStep(void *c, double t, double h, bool no_set, bool *event, bool *terminate, bool *early, double *last) {
    toy_t *toy = c;
    const double e = exp(-h / TAU);
    toy->r[10] = toy->r[10] * e + 2.0 * toy->r[0] * (1.0 - e);
    *event = *terminate = *early = false;
    return 0;
}

API int fmi3EnterEventMode(void *c) { return 0; }
API int fmi3EnterContinuousTimeMode(void *c) { return 0; }
API int fmi3UpdateDiscreteStates(void *c, bool *again, bool *terminate, bool *nominals, bool *states, bool *has_next, double *next) {
    *again = *terminate = *nominals = *states = *has_next = false;
    return 0;
}
API int fmi3CompletedIntegratorStep(void *c, bool no_set, bool *event, bool *terminate) { return *event = *terminate = false; }
API int fmi3SetTime(void *c, double t) { return 0; }
API int fmi3SetContinuousStates(void *c, const double *x, size_t n) {
    ((toy_t *)c)->r[10] = x[0];
    return 0;
}
API int fmi3GetContinuousStates(void *c, double *x, size_t n) {
    x[0] = ((toy_t *)c)->r[10];
    return 0;
}
API int fmi3GetContinuousStateDerivatives(void *c, double *dx, size_t n) { return fmi3GetFloat64(c, (uint32_t[]){11}, 1, dx, 1); }
API int fmi3GetEventIndicators(void *c, double *z, size_t n) { return 0; }
API int fmi3GetNominalsOfContinuousStates(void *c, double *x, size_t n) {
    x[0] = 1.0;
    return 0;
}
