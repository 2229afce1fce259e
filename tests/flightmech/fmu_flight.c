/* An importer in C: flies a record through an FMI 3.0 library and prints every output at every sample as the bits of a double.
 *
 *     fmu_flight LIBRARY RESOURCES TOKEN ARRAYS < PARAMETERS      PARAMETERS: lines of "reference value"
 * ARRAYS: samples, inputs, outputs as int64, then t and u as doubles.  Built for each platform, run under its emulator. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <windows.h>
static void *find(const char *library, const char *name) {
    static HMODULE handle;
    if (!handle) handle = LoadLibraryA(library);
    return handle ? (void *)GetProcAddress(handle, name) : NULL;
}
#else
#include <dlfcn.h>
static void *find(const char *library, const char *name) {
    static void *handle;
    if (!handle) handle = dlopen(library, RTLD_NOW);
    return handle ? dlsym(handle, name) : NULL;
}
#endif

typedef void *instance;
typedef const uint32_t *references;
enum { REPLAY_N = 70000, REPLAY_T, REPLAY_U, REPLAY_Y };

static void say(void *environment, int status, const char *category, const char *message) {
    (void)environment, (void)status, (void)category;
    fprintf(stderr, "%s\n", message);
}

static void need(int good, const char *what) {
    if (good) return;
    fprintf(stderr, "failed: %s\n", what);
    exit(1);
}

#define LOAD(type, name, ...) \
    type(*name)(__VA_ARGS__) = (type(*)(__VA_ARGS__))find(argv[1], #name); \
    need(name != NULL, #name)

int main(int argc, char **argv) {
    need(argc == 5, "arguments");
    LOAD(instance, fmi3InstantiateCoSimulation, const char *, const char *, const char *, bool, bool, bool, bool, references, size_t, void *,
         void (*)(void *, int, const char *, const char *), void *);
    LOAD(int, fmi3EnterConfigurationMode, instance);
    LOAD(int, fmi3ExitConfigurationMode, instance);
    LOAD(int, fmi3SetUInt64, instance, references, size_t, const uint64_t *, size_t);
    LOAD(int, fmi3SetFloat64, instance, references, size_t, const double *, size_t);
    LOAD(int, fmi3GetFloat64, instance, references, size_t, double *, size_t);
    LOAD(int, fmi3EnterInitializationMode, instance, bool, double, double, bool, double);
    LOAD(int, fmi3ExitInitializationMode, instance);
    LOAD(int, fmi3DoStep, instance, double, double, bool, bool *, bool *, bool *, double *);
    LOAD(void, fmi3FreeInstance, instance);

    FILE *file = fopen(argv[4], "rb");
    int64_t size[3];
    need(file && fread(size, sizeof size, 1, file) == 1, "sizes");
    const size_t n = (size_t)size[0], nu = n * (size_t)size[1], ny = n * (size_t)size[2];
    double *t = malloc((n + nu + ny) * sizeof *t), *u = t + n, *y = u + nu;
    need(t && fread(t, sizeof *t, n + nu, file) == n + nu, "arrays");

    instance f = fmi3InstantiateCoSimulation("flight", argv[3], argv[2], false, false, false, false, NULL, 0, NULL, say, NULL);
    need(f != NULL, "instance");
    const uint32_t arrays[] = {REPLAY_N, REPLAY_T, REPLAY_U, REPLAY_Y};
    const uint64_t count = n;
    need(fmi3EnterConfigurationMode(f) == 0 && fmi3SetUInt64(f, arrays, 1, &count, 1) == 0 && fmi3ExitConfigurationMode(f) == 0, "length");
    need(fmi3SetFloat64(f, arrays + 1, 1, t, n) == 0 && fmi3SetFloat64(f, arrays + 2, 1, u, nu) == 0, "record");
    uint32_t reference;
    double value, last;
    while (scanf("%u %lf", &reference, &value) == 2) need(fmi3SetFloat64(f, &reference, 1, &value, 1) == 0, "parameter");
    bool event, terminate, early;
    need(fmi3EnterInitializationMode(f, false, 0.0, t[0], false, 0.0) == 0 && fmi3ExitInitializationMode(f) == 0, "initialisation");
    need(fmi3DoStep(f, t[0], t[n - 1] - t[0], true, &event, &terminate, &early, &last) == 0, "step");
    need(fmi3GetFloat64(f, arrays + 3, 1, y, ny) == 0, "outputs");
    fmi3FreeInstance(f);
#ifdef _WIN32
    _setmode(_fileno(stdout), _O_BINARY);
#endif
    need(fwrite(y, sizeof *y, ny, stdout) == ny, "writing");
    free(t);
    return fclose(file);
}
