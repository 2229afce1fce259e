/* libFuzzer: functions of FMI 2.0 and 3.0 in any order on instances of both kinds, and stored
 * states that were changed and sealed anew. */
#include "drive.h"

#include "fmu.h"
#include "resource.h"
#include "sha256.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    MOST_CALLS = 60,
    INSTANCES = 2,
    MOST_VALUES = 64,
    MOST_SAMPLES = 5,
    DIGEST = 64,
    PROTECTED = 128
};

/* The functions are those of the standards; their prototypes stand in fmi2.c and fmi3.c. */
typedef struct {
    void *logger, *allocate, *release, *finished, *environment;
} callbacks_t;
fmu *fmi2Instantiate(const char *, int, const char *, const char *, const callbacks_t *, int, int);
fmu *fmi3InstantiateCoSimulation(const char *, const char *, const char *, bool, bool, bool, bool,
                                 const uint32_t *, size_t, void *, void *, void *);
fmu *fmi3InstantiateModelExchange(const char *, const char *, const char *, bool, bool, void *,
                                  void *);
int fmi2SetupExperiment(fmu *, int, double, double, int, double),
    fmi2EnterInitializationMode(fmu *), fmi2ExitInitializationMode(fmu *);
int fmi2Terminate(fmu *), fmi2Reset(fmu *), fmi2GetReal(fmu *, const uint32_t *, size_t, double *),
    fmi2SetReal(fmu *, const uint32_t *, size_t, const double *);
int fmi2GetInteger(fmu *, const uint32_t *, size_t, int *),
    fmi2SetInteger(fmu *, const uint32_t *, size_t, const int *);
int fmi2SetRealInputDerivatives(fmu *, const uint32_t *, size_t, const int *, const double *),
    fmi2DoStep(fmu *, double, double, int);
int fmi2EnterEventMode(fmu *), fmi2EnterContinuousTimeMode(fmu *),
    fmi2NewDiscreteStates(fmu *, void *), fmi2CompletedIntegratorStep(fmu *, int, int *, int *);
int fmi2SetTime(fmu *, double), fmi2SetContinuousStates(fmu *, const double *, size_t),
    fmi2GetContinuousStates(fmu *, double *, size_t);
int fmi2GetDerivatives(fmu *, double *, size_t),
    fmi2GetNominalsOfContinuousStates(fmu *, double *, size_t);
int fmi3EnterInitializationMode(fmu *, bool, double, double, bool, double),
    fmi3ExitInitializationMode(fmu *);
int fmi3EnterConfigurationMode(fmu *), fmi3ExitConfigurationMode(fmu *),
    fmi3SetUInt64(fmu *, const uint32_t *, size_t, const uint64_t *, size_t);
int fmi3GetFloat64(fmu *, const uint32_t *, size_t, double *, size_t),
    fmi3SetFloat64(fmu *, const uint32_t *, size_t, const double *, size_t);
int fmi3GetInt64(fmu *, const uint32_t *, size_t, int64_t *, size_t),
    fmi3SetInt64(fmu *, const uint32_t *, size_t, const int64_t *, size_t);
int fmi2GetDirectionalDerivative(fmu *, const uint32_t *, size_t, const uint32_t *, size_t,
                                 const double *, double *);
int fmi3GetDirectionalDerivative(fmu *, const uint32_t *, size_t, const uint32_t *, size_t,
                                 const double *, size_t, double *, size_t),
    fmi3GetAdjointDerivative(fmu *, const uint32_t *, size_t, const uint32_t *, size_t,
                             const double *, size_t, double *, size_t);
int fmi3DoStep(fmu *, double, double, bool, bool *, bool *, bool *, double *);
int fmi3UpdateDiscreteStates(fmu *, bool *, bool *, bool *, bool *, bool *, double *),
    fmi3CompletedIntegratorStep(fmu *, bool, bool *, bool *);
int fmi2GetFMUstate(fmu *, fmu_state **), fmi2SetFMUstate(fmu *, fmu_state *),
    fmi2FreeFMUstate(fmu *, fmu_state **);
int fmi2SerializedFMUstateSize(fmu *, fmu_state *, size_t *),
    fmi2SerializeFMUstate(fmu *, fmu_state *, char *, size_t);
int fmi2DeSerializeFMUstate(fmu *, const char *, size_t, fmu_state **);

typedef struct {
    fmu *instance;
    fmu_state *state;
    const am_model *model; /* the same block, for its numbers */
    int second;            /* FMI 2.0 */
} slave_t;

static am_model *model[MODELS];
static char token[MODELS][65];

static void logger2(void *environment, const char *instance, int status, const char *category,
                  const char *message, ...) {
    (void)environment;
    (void)instance;
    (void)category;
    promise(status == FMU_ERROR && message[0], "a message has a text");
}

static void logger3(void *environment, int status, const char *category, const char *message) {
    (void)environment;
    (void)category;
    promise(status == FMU_ERROR && message[0], "a message has a text");
}

static void load_models(void) {
    for (int k = 0; k < MODELS && !model[k]; k++) {
        char path[4200];
        const char *why;
        size_t n;
        snprintf(path, sizeof path, "%s/model.bin", folder_of_model(k));
        unsigned char *bytes = resource_read(path, &n, &why);
        promise(bytes != NULL, path);
        sha256_hex(bytes, n, token[k]);
        free(bytes);
        model[k] = model_of_folder(k);
    }
}

static slave_t open_slave(bytes_t *bytes) {
    const int k = take_byte(bytes) % MODELS;
    const int kind = take_byte(bytes) % 4;
    const callbacks_t callbacks = {.logger = (void *)logger2};
    slave_t slave = {.model = model[k], .second = kind < 2};
    char uri[4200];
    snprintf(uri, sizeof uri, "file://%s", folder_of_model(k));
    if (slave.second) {
        slave.instance = fmi2Instantiate("x", kind, token[k], uri, &callbacks, 0, 0);
    } else if (kind == 2) {
        slave.instance = fmi3InstantiateCoSimulation("x", token[k], folder_of_model(k), false,
                                                     false, false, false, NULL, 0, NULL,
                                                     (void *)logger3, NULL);
    } else {
        slave.instance = fmi3InstantiateModelExchange("x", token[k], folder_of_model(k), false,
                                                      false, NULL, (void *)logger3);
    }
    promise(slave.instance != NULL, "a good FMU can be instantiated");
    return slave;
}

static void expect(int status) {
    promise(status == FMU_OK || status == FMU_DISCARD || status == FMU_ERROR,
            "a status is one of both standards");
}

/* Value references of one variable each; sometimes one that is none. */
static size_t take_references(const slave_t *slave, bytes_t *bytes, uint32_t vr[4]) {
    static const struct {
        uint32_t base;
        int kind;
    } GROUP[] = {{FMU_INPUTS, AM_INPUT},         {FMU_OUTPUTS, AM_OUTPUT},
                 {FMU_PARAMETERS, AM_PARAMETER}, {FMU_STATES, AM_STATE},
                 {FMU_DERIVATIVES, AM_STATE},    {FMU_REPLAY_T, AM_INPUT}};
    const size_t n = take_byte(bytes) % 4;
    for (size_t i = 0; i < n; i++) {
        const int g = take_byte(bytes) % 7;
        vr[i] = g == 6
                    ? take_byte(bytes)
                    : GROUP[g].base
                          + take_number(
                              bytes, (uint32_t)am_count(slave->model, (am_kind)GROUP[g].kind) + 1);
    }
    return n;
}

static void get_and_set(slave_t *slave, bytes_t *bytes) {
    uint32_t vr[4];
    int integers[4] = {0};
    int64_t longs[4] = {0};
    const size_t n = take_references(slave, bytes, vr);
    const size_t values = slave->second || take_byte(bytes) % 4 ? n
                                                                : take_byte(bytes) % MOST_VALUES;
    double *to = room(values > n ? values : n);
    for (size_t i = 0; i < (values > n ? values : n); i++) to[i] = take_value(bytes);
    for (int i = 0; i < 4; i++) {
        integers[i] = take_byte(bytes) % 5;
        longs[i] = integers[i];
    }
    switch (take_byte(bytes) % 6 + (slave->second ? 0 : 6)) {
    case 0:
    case 1:
        expect(fmi2GetReal(slave->instance, vr, n, to));
        break;
    case 2:
    case 3:
        expect(fmi2SetReal(slave->instance, vr, n, to));
        break;
    case 4:
        expect(fmi2SetInteger(slave->instance, vr, n, integers));
        expect(fmi2GetInteger(slave->instance, vr, n, integers));
        break;
    case 5: {
        const int order[4] = {1, 1, 1, take_byte(bytes) % 3};
        expect(fmi2SetRealInputDerivatives(slave->instance, vr, n, order, to));
        break;
    }
    case 6:
    case 7:
        expect(fmi3GetFloat64(slave->instance, vr, n, to, values));
        break;
    case 8:
    case 9:
        expect(fmi3SetFloat64(slave->instance, vr, n, to, values));
        break;
    default:
        expect(fmi3SetInt64(slave->instance, vr, n, longs, n));
        expect(fmi3GetInt64(slave->instance, vr, n, longs, n));
    }
    free(to);
}

/* Unknowns, knowns and seeds of any kind; of both kinds there are at most four. */
static void partials(const slave_t *slave, bytes_t *bytes) {
    uint32_t unknowns[4], knowns[4];
    double seed[4], to[4];
    const size_t nu = take_references(slave, bytes, unknowns);
    const size_t nk = take_references(slave, bytes, knowns);
    for (int i = 0; i < 4; i++) seed[i] = take_value(bytes);
    if (slave->second) {
        expect(fmi2GetDirectionalDerivative(slave->instance, unknowns, nu, knowns, nk, seed, to));
        return;
    }
    expect(fmi3GetDirectionalDerivative(slave->instance, unknowns, nu, knowns, nk, seed, nk, to,
                                        take_byte(bytes) % 4 ? nu : nk));
    expect(fmi3GetAdjointDerivative(slave->instance, unknowns, nu, knowns, nk, seed, nu, to, nk));
}

static double short_time(bytes_t *bytes) {
    const double dt = take_value(bytes);
    return dt > 0.05 ? 0.05 : dt;
}

/* mode.step keeps its start value often enough; a small one makes a step long. */
static void guard_step(slave_t *slave) {
    const uint32_t vr = FMU_PARAMETERS + (uint32_t)am_find(slave->model, AM_PARAMETER, "mode.step");
    const double step = 0.01;
    double now = step;
    if (fmu_get(slave->instance, &vr, 1, &now, 1) == FMU_OK && !(now >= 1e-3)) {
        fmu_set(slave->instance, &vr, 1, &step, 1);
    }
    if (fmu_get(slave->instance, &vr, 1, &now, 1) == FMU_OK && !(now >= 1e-3)) {
        fmu_reset(slave->instance);
    }
}

static void replay(slave_t *slave, bytes_t *bytes) {
    const uint32_t n = FMU_REPLAY_N;
    const uint32_t vr = FMU_REPLAY_T + take_byte(bytes) % 2;
    const uint64_t samples = take_byte(bytes) % 8 ? 1 + take_byte(bytes) % MOST_SAMPLES
                                                  : UINT64_MAX >> take_byte(bytes) % 64;
    /* as large as requested: memory of the importer */
    if (samples > MOST_SAMPLES && samples <= 10000000) return;
    const size_t values = samples
                          * (vr == FMU_REPLAY_T ? 1 : (size_t)am_count(slave->model, AM_INPUT));
    expect(fmi3EnterConfigurationMode(slave->instance));
    expect(fmi3SetUInt64(slave->instance, &n, 1, &samples, 1));
    expect(fmi3ExitConfigurationMode(slave->instance));
    if (samples > MOST_SAMPLES) return;
    double *to = room(values);
    for (size_t k = 0; k < values; k++) {
        to[k] = vr == FMU_REPLAY_T && take_byte(bytes) % 8 ? 0.02 * (double)k : take_value(bytes);
    }
    expect(fmi3SetFloat64(slave->instance, &vr, 1, to, values));
    free(to);
}

static void exchange(slave_t *slave, bytes_t *bytes) {
    const size_t states = (size_t)am_count(slave->model, AM_STATE);
    const size_t n = take_byte(bytes) % 8 ? states : states + 1;
    double *x = room(n);
    double next, info[8];
    int event, end;
    bool flag[5];
    for (size_t i = 0; i < n; i++) x[i] = 0.0;
    if (take_byte(bytes) % 2) expect(fmi2GetContinuousStates(slave->instance, x, n));
    switch (take_byte(bytes) % 8) {
    case 0:
        expect(fmi2EnterEventMode(slave->instance));
        break;
    case 1:
        expect(fmi2EnterContinuousTimeMode(slave->instance));
        break;
    case 2:
        expect(slave->second ? fmi2NewDiscreteStates(slave->instance, info)
                             : fmi3UpdateDiscreteStates(slave->instance, flag, flag + 1, flag + 2,
                                                        flag + 3, flag + 4, &next));
        break;
    case 3:
        expect(slave->second ? fmi2CompletedIntegratorStep(slave->instance, 1, &event, &end)
                             : fmi3CompletedIntegratorStep(slave->instance, true, flag, flag + 1));
        break;
    case 4:
        expect(fmi2SetTime(slave->instance, fmu_time(slave->instance) + short_time(bytes)));
        break;
    case 5:
        x[take_number(bytes, (uint32_t)n)] = take_value(bytes);
        expect(fmi2SetContinuousStates(slave->instance, x, n));
        break;
    case 6:
        expect(fmi2GetDerivatives(slave->instance, x, n));
        break;
    default:
        expect(fmi2GetNominalsOfContinuousStates(slave->instance, x, n));
    }
    free(x);
}

/* The bytes of a state, changed where the choices demand it, with the digest of the result. */
static void restore(slave_t *slave, bytes_t *bytes) {
    char digest[65], *image;
    size_t n;
    if (!slave->state || fmi2SerializedFMUstateSize(slave->instance, slave->state, &n) != FMU_OK
        || !(image = malloc(n))) {
        return;
    }
    expect(fmi2SerializeFMUstate(slave->instance, slave->state, image, n));
    for (int i = take_byte(bytes) % 8; i > 0; i--) {
        const double value = take_value(bytes);
        const size_t at = PROTECTED
                          + 8
                                * (size_t)take_number(bytes, take_byte(bytes) % 4
                                                                 ? (uint32_t)(n - PROTECTED) / 8 - 1
                                                                 : 8);
        memcpy(image + at, &value, sizeof value);
    }
    for (int i = take_byte(bytes) % 4; i > 0; i--) {
        image[PROTECTED + take_number(bytes, (uint32_t)(n - PROTECTED))] = (char)take_byte(bytes);
    }
    sha256_hex((const unsigned char *)image + PROTECTED, n - PROTECTED, digest);
    memcpy(image + DIGEST, digest, 64);
    expect(fmi2DeSerializeFMUstate(slave->instance, image,
                                   take_byte(bytes) % 8 ? n : take_number(bytes, (uint32_t)n),
                                   &slave->state));
    free(image);
}

static void call(slave_t *slave, slave_t *other, bytes_t *bytes) {
    fmu *f = slave->instance;
    bool flag[3];
    double end;
    switch (take_byte(bytes) % 16) {
    case 0:
        expect(slave->second ? fmi2SetupExperiment(f, 0, 0.0, take_value(bytes), 0, 0.0)
                             : fmi2Reset(f));
        break;
    case 1:
        expect(slave->second ? fmi2EnterInitializationMode(f)
                             : fmi3EnterInitializationMode(
                                   f, false, 0.0, take_byte(bytes) % 4 ? 0.0 : take_value(bytes),
                                   false, 0.0));
        break;
    case 2:
        expect(slave->second ? fmi2ExitInitializationMode(f) : fmi3ExitInitializationMode(f));
        break;
    case 3:
        expect(take_byte(bytes) % 4 ? fmi2Reset(f) : fmi2Terminate(f));
        break;
    case 4:
    case 5:
    case 6:
        get_and_set(slave, bytes);
        break;
    case 7:
    case 8: {
        const double t = take_byte(bytes) % 4 ? fmu_time(f) : take_value(bytes);
        const double dt = short_time(bytes);
        guard_step(slave);
        expect(slave->second ? fmi2DoStep(f, t, dt, 1)
                             : fmi3DoStep(f, t, dt, true, flag, flag + 1, flag + 2, &end));
        break;
    }
    case 9:
        replay(slave, bytes);
        break;
    case 10:
        expect(fmi2GetFMUstate(f, &slave->state));
        break;
    case 11:
        if (slave->state) expect(fmi2SetFMUstate(f, slave->state));
        break;
    case 12:
        if (other->state) expect(fmi2SetFMUstate(f, other->state));
        break;
    case 13:
        restore(slave, bytes);
        break;
    case 14:
        partials(slave, bytes);
        break;
    default:
        exchange(slave, bytes);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n) {
    bytes_t bytes = {data, n};
    slave_t slave[INSTANCES];
    load_models();
    for (int i = 0; i < INSTANCES; i++) slave[i] = open_slave(&bytes);
    for (int k = 0; k < MOST_CALLS && bytes.left; k++) {
        const int i = take_byte(&bytes) % INSTANCES;
        call(&slave[i], &slave[1 - i], &bytes);
    }
    for (int i = 0; i < INSTANCES; i++) {
        fmi2FreeFMUstate(slave[i].instance, &slave[i].state);
        fmu_close(slave[i].instance);
    }
    return 0;
}
