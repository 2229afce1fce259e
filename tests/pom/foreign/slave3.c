/* A slave by the headers of FMI 3.0.  Float64: 1 elevator, 2 pitch, 3 pitch rate, 4 nz, 5 first pitch; Int64: 6 actuator (an enumeration). */
#include <stdlib.h>

#include "fmi3Functions.h"
#include "lag.h"

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)intermediate, (void)n;
    (void)environment, (void)log, (void)update;
    return calloc(1, sizeof(lag));
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean limited, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean ends,
                                       fmi3Float64 stop) {
    (void)limited, (void)tolerance, (void)start, (void)ends, (void)stop;
    return c ? fmi3OK : fmi3Error;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    ((lag *)c)->pitch = ((lag *)c)->first_pitch;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t count) {
    const lag *m = c;
    if (count != n) return fmi3Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < 1 || vr[i] > 5) return fmi3Error;
        value[i] = (const double[]){m->elevator, m->pitch, lag_rate(m, m->pitch), lag_nz(m), m->first_pitch}[vr[i] - 1];
    }
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[], size_t count) {
    lag *m = c;
    if (count != n) return fmi3Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == 1) m->elevator = value[i];
        else if (vr[i] == 5) m->first_pitch = value[i];
        else return fmi3Error;
    }
    return fmi3OK;
}
fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int64 value[], size_t count) {
    if (count != n) return fmi3Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != 6 || value[i] < 0 || value[i] > 1) return fmi3Error;
        ((lag *)c)->actuator = (int)value[i];
    }
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_set, fmi3Boolean *event, fmi3Boolean *ends,
                      fmi3Boolean *early, fmi3Float64 *reached) {
    (void)no_set;
    lag_advance(c, step);
    *event = *ends = *early = fmi3False;
    *reached = time + step;
    return fmi3OK;
}
