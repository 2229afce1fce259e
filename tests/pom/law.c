/* A control law as an FMI 2.0 slave: elevator = -1.2 rad/m column + 0.1 s q, worked out in the step and at the start only.
 * References: 0 column [m], 1 q [rad/s], 2 delta_e [rad], 3 gain [s]; with the guid "degrees" q is in deg/s and delta_e in deg.
 * With the guid "broken" the second step fails. */
#include <stdlib.h>
#include <string.h>

#define API __attribute__((visibility("default")))
#define DEGREE 0.017453292519943295

typedef struct {
    double r[4];
    int degrees, broken, steps;
} law_t;

static void compute(law_t *law) {
    const double unit = law->degrees ? DEGREE : 1.0;
    law->r[2] = (-1.2 * law->r[0] + law->r[3] * law->r[1] * unit) / unit;
}

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *category) { return 0; }
API void *fmi2Instantiate(const char *name, int type, const char *guid, const char *place, const void **callbacks, int visible, int logging) {
    law_t *law = calloc(1, sizeof *law);
    law->degrees = !strcmp(guid, "degrees");
    law->broken = !strcmp(guid, "broken");
    law->r[3] = 0.1;
    return law;
}
API void fmi2FreeInstance(void *c) { free(c); }
API int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop) { return 0; }
API int fmi2EnterInitializationMode(void *c) { return 0; }
API int fmi2ExitInitializationMode(void *c) {
    compute(c);
    return 0;
}
API int fmi2Terminate(void *c) { return 0; }
API int fmi2Reset(void *c) { return 0; }
API int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *value) {
    for (size_t i = 0; i < n; i++) value[i] = ((law_t *)c)->r[vr[i]];
    return 0;
}
API int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *value) {
    for (size_t i = 0; i < n; i++) ((law_t *)c)->r[vr[i]] = value[i];
    return 0;
}
API int fmi2DoStep(void *c, double t, double h, int no_set) {
    law_t *law = c;
    if (law->broken && law->steps++) return 3;
    compute(law);
    return 0;
}

#define STUB(name) \
    API int name(void) { return 3; }
STUB(fmi2GetInteger) STUB(fmi2GetBoolean) STUB(fmi2GetString) STUB(fmi2SetString) STUB(fmi2SetInteger) STUB(fmi2SetBoolean)
STUB(fmi2GetFMUstate) STUB(fmi2SetFMUstate) STUB(fmi2FreeFMUstate) STUB(fmi2SerializedFMUstateSize) STUB(fmi2SerializeFMUstate)
STUB(fmi2DeSerializeFMUstate) STUB(fmi2GetDirectionalDerivative) STUB(fmi2SetRealInputDerivatives) STUB(fmi2GetRealOutputDerivatives)
STUB(fmi2CancelStep) STUB(fmi2GetStatus) STUB(fmi2GetRealStatus) STUB(fmi2GetIntegerStatus) STUB(fmi2GetBooleanStatus)
STUB(fmi2GetStringStatus)
