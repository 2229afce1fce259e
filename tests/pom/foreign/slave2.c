/* A slave by the headers of FMI 2.0.  Reals: 1 elevator, 2 pitch, 3 pitch rate, 4 nz, 5 first pitch; Integer: 6 actuator (an enumeration). */
#include <stdlib.h>

#include "fmi2Functions.h"
#include "lag.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)guid, (void)resources, (void)functions, (void)visible, (void)logging;
    return type == fmi2CoSimulation ? calloc(1, sizeof(lag)) : NULL;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean limited, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends, fmi2Real stop) {
    (void)c, (void)limited, (void)tolerance, (void)start, (void)ends, (void)stop;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    ((lag *)c)->pitch = ((lag *)c)->first_pitch;
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    const lag *m = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 1 || vr[i] > 5) return fmi2Error;
        value[i] = (const double[]){m->elevator, m->pitch, lag_rate(m, m->pitch), lag_nz(m), m->first_pitch}[vr[i] - 1];
    }
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    lag *m = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == 1) m->elevator = value[i];
        else if (vr[i] == 5) m->first_pitch = value[i];
        else return fmi2Error;
    }
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != 6 || value[i] < 0 || value[i] > 1) return fmi2Error;
        ((lag *)c)->actuator = value[i];
    }
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set) {
    (void)time, (void)no_set;
    lag_advance(c, step);
    return fmi2OK;
}
