#include "drive.h"

#include "drive_circuit.h"
#include "drive_path.h"
#include "image.h"
#include "simulation.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LONGEST 0.1   /* of a step, so that no input takes more than seconds [s] */
#define MOST_STEPS 50 /* of mode.step in one call */
#define SAMPLES 4
#define RUNS 6 /* more than four: two groups of lanes */

static void all_finite_or_die(const double *values, size_t n, const char *words) {
    for (size_t i = 0; i < n; i++) promise(isfinite(values[i]), words);
}

/* A status, and after a failure a sentence. */
static int checked(const am_sim *sim, int status) {
    promise(status >= AM_OK && status <= AM_NOT_READY, "a status is one of kernel.h");
    promise(status == AM_OK || am_error(sim)[0], "a failure has a text");
    promise(strlen(am_error(sim)) < AM_TEXT, "a text ends");
    return status;
}

/* ---- one function each ----------------------------------------------------------------------- */

static size_t count(const am_model *m, am_kind kind) { return (size_t)am_count(m, kind); }

static double *values(bytes_t *bytes, size_t n) {
    double *to = room(n);
    const int plain = take_byte(bytes) % 2;
    for (size_t i = 0; i < n; i++) to[i] = plain ? 0.0 : take_value(bytes);
    return to;
}

/* Most that a step may take without requiring more than MOST_STEPS. */
static double short_step(const am_model *m, const am_sim *sim, double dt) {
    double step = 0.01;
    am_get_parameter(sim, am_find(m, AM_PARAMETER, "mode.step"), &step);
    const double most = fmin(LONGEST, MOST_STEPS * step);
    return dt > most ? most : dt;
}

static void set_parameter(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const int i = (int)take_number(bytes, (uint32_t)am_count(m, AM_PARAMETER) + 300) - 1;
    const double value = take_value(bytes);
    double back;
    if (checked(sim, am_set_parameter(sim, i, value)) != AM_OK) return;
    promise(isfinite(value), "a parameter that is not finite is refused");
    promise(am_get_parameter(sim, i, &back) == AM_OK, "a parameter that was set can be read");
}

static void set_named(const am_model *m, am_sim *sim, bytes_t *bytes) {
    static const char *const NAME[] = {"mode.earth",     "mode.engine",     "mode.controls",
                                       "mode.rates",     "mode.trim",       "turbulence.mode",
                                       "steering.order", "runway.condition"};
    const int i = am_find(m, AM_PARAMETER, NAME[take_byte(bytes) % (sizeof NAME / sizeof *NAME)]);
    checked(sim, am_set_parameter(sim, i, take_byte(bytes) % 7));
}

static void set_inputs(const am_model *m, am_sim *sim, bytes_t *bytes) {
    double *u = values(bytes, count(m, AM_INPUT));
    checked(sim, am_set_inputs(sim, u));
    am_get_inputs(sim, u);
    all_finite_or_die(u, count(m, AM_INPUT), "inputs stay finite");
    checked(sim, am_set_input(sim, (int)take_number(bytes, (uint32_t)count(m, AM_INPUT) + 2) - 1,
                              take_value(bytes)));
    free(u);
}

/* A trim on the ground that finds nothing takes a second, so the next start has none. */
static void start(const am_model *m, am_sim *sim, bytes_t *bytes) {
    checked(sim, am_initialize(sim, take_byte(bytes) % 4 ? 0.0 : take_value(bytes)));
    am_set_parameter(sim, am_find(m, AM_PARAMETER, "mode.trim"), 0.0);
}

static void outputs(const am_model *m, am_sim *sim) {
    double *y = room(count(m, AM_OUTPUT));
    if (checked(sim, am_outputs(sim, y)) == AM_OK) {
        all_finite_or_die(y, count(m, AM_OUTPUT), "outputs are finite or an error");
    }
    free(y);
}

static void step(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const size_t nx = count(m, AM_STATE);
    double *u0 = values(bytes, count(m, AM_INPUT));
    double *u1 = values(bytes, count(m, AM_INPUT));
    double *x = room(nx);
    const double t = take_byte(bytes) % 4 ? am_time(sim) : take_value(bytes);
    const int status = checked(sim, am_step(sim, t, short_step(m, sim, take_value(bytes)), u0,
                                            take_byte(bytes) % 2 ? u1 : u0));
    am_get_state(sim, x);
    if (status == AM_OK) all_finite_or_die(x, nx, "a state after a good step is finite");
    free(u0);
    free(u1);
    free(x);
}

static void complete_step(const am_model *m, am_sim *sim, bytes_t *bytes) {
    checked(sim, am_complete_step(sim, am_time(sim) + short_step(m, sim, take_value(bytes))));
}

static void slope(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const size_t nx = count(m, AM_STATE);
    double *x = values(bytes, nx);
    double *dx = room(nx);
    double *u = values(bytes, count(m, AM_INPUT));
    if (take_byte(bytes) % 2) am_get_state(sim, x);
    if (checked(sim, am_derivative(sim, x, u, dx)) == AM_OK) {
        all_finite_or_die(dx, nx, "a derivative is finite or an error");
    }
    free(x);
    free(dx);
    free(u);
}

static void set_state(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const size_t nx = count(m, AM_STATE);
    double *x = room(nx);
    am_get_state(sim, x);
    if (nx) x[take_number(bytes, (uint32_t)nx)] = take_value(bytes);
    checked(sim, am_set_state(sim, x));
    free(x);
}

static void trim_for(const am_model *m, am_sim *sim, bytes_t *bytes) {
    enum { MOST = 6 };
    am_mover mover[MOST];
    double found[MOST], low[MOST], high[MOST], size[MOST], wanted[MOST], left[MOST],
        jacobian[MOST * MOST];
    int goal[MOST];
    const int unknowns = 1 + take_byte(bytes) % MOST;
    const int goals = 1 + take_byte(bytes) % unknowns;
    for (int i = 0; i < MOST; i++) {
        const int kind = take_byte(bytes) % 4;
        mover[i] = (am_mover){kind,
                              (int)take_number(bytes, (uint32_t)am_count(m, (am_kind)kind) + 2) - 1,
                              take_byte(bytes) % unknowns};
        found[i] = take_byte(bytes) % 2 ? NAN : take_value(bytes);
        low[i] = take_byte(bytes) % 4 ? -1.0 : take_value(bytes);
        high[i] = take_byte(bytes) % 4 ? 1.0 : take_value(bytes);
        size[i] = take_byte(bytes) % 4 ? 1.0 : take_value(bytes);
        wanted[i] = take_byte(bytes) % 4 ? 0.0 : take_value(bytes);
        goal[i] = (int)take_number(bytes, (uint32_t)am_count(m, AM_OUTPUT) + 3) - 2;
    }
    const am_trim_task task = {.path = take_byte(bytes) % 4,
                               .movers = unknowns,
                               .unknowns = unknowns,
                               .goals = goals,
                               .mover = mover,
                               .low = low,
                               .high = high,
                               .size = size,
                               .goal = goal,
                               .wanted = wanted};
    double *y = room(count(m, AM_OUTPUT));
    if (checked(sim, am_trim_for(sim, &task, found, y, left, jacobian)) == AM_OK) {
        all_finite_or_die(y, count(m, AM_OUTPUT), "outputs of a trim are finite or an error");
        all_finite_or_die(found, (size_t)unknowns, "what a trim found is finite or an error");
    }
    free(y);
}

static void evaluate(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const size_t n = take_byte(bytes) % 2 ? 3 : 70; /* one by one, and in blocks of 64 */
    double *v = values(bytes, n * count(m, AM_VARIABLE));
    double *c = room(6 * n);
    double *terms = room(n * count(m, AM_TERM));
    checked(sim, am_evaluate(sim, n, v, take_byte(bytes) % 4 ? c : NULL,
                             take_byte(bytes) % 4 ? terms : NULL));
    free(v);
    free(c);
    free(terms);
}

static void rise(double *t, const am_model *m, const am_sim *sim, bytes_t *bytes) {
    t[0] = take_byte(bytes) % 8 ? am_time(sim) : take_value(bytes);
    for (int k = 1; k < SAMPLES; k++) t[k] = t[k - 1] + short_step(m, sim, take_value(bytes));
}

static void record(const am_model *m, am_sim *sim, bytes_t *bytes) {
    double t[SAMPLES];
    double *u = values(bytes, SAMPLES * count(m, AM_INPUT));
    const int output[] = {0, (int)take_number(bytes, (uint32_t)am_count(m, AM_OUTPUT) + 2) - 1};
    const int some = take_byte(bytes) % 2;
    const size_t outputs = some ? 2 : count(m, AM_OUTPUT);
    double *y = room(SAMPLES * outputs);
    double *terms = room(SAMPLES * count(m, AM_TERM));
    size_t done = 0;
    rise(t, m, sim, bytes);
    const int hold = take_byte(bytes) % 2;
    if (!some && take_byte(bytes) % 2) checked(sim, am_run(sim, SAMPLES, t, u, hold, y, &done));
    else {
        checked(sim, am_record(sim, SAMPLES, t, u, hold, some ? output : NULL, 2, y,
                               take_byte(bytes) % 2 ? terms : NULL, &done));
    }
    promise(done <= SAMPLES, "no more rows are done than requested");
    all_finite_or_die(y, done * outputs, "recorded outputs are finite");
    free(u);
    free(y);
    free(terms);
}

/* A loop around any output and input, most of them of moderate size. */
static am_loop take_loop(const am_model *m, const double *target, bytes_t *bytes) {
    const int tame = take_byte(bytes) % 2;
    return (am_loop){.input = (int)take_number(bytes, (uint32_t)am_count(m, AM_INPUT)),
                     .output = (int)take_number(bytes, (uint32_t)am_count(m, AM_OUTPUT)),
                     .turns = take_byte(bytes) % 2,
                     .gain = tame ? take_byte(bytes) / 256.0 - 0.5 : take_value(bytes),
                     .integral = tame ? take_byte(bytes) / 256.0 - 0.5 : take_value(bytes),
                     .limit = tame ? take_byte(bytes) / 2560.0 : fabs(take_value(bytes)),
                     .target = target};
}

static void batch(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const int parameter[] = {(int)take_number(bytes, (uint32_t)am_count(m, AM_PARAMETER) + 40),
                             am_find(m, AM_PARAMETER, "init.V")};
    const int output[] = {0, 5};
    double t[SAMPLES];
    double *u = values(bytes, SAMPLES * count(m, AM_INPUT));
    double changed[RUNS * 2], y[RUNS * SAMPLES * 2], alone[RUNS * SAMPLES * 2];
    int status[RUNS];
    size_t done[RUNS];
    char text[RUNS][AM_TEXT];
    rise(t, m, sim, bytes);
    for (int i = 0; i < RUNS * 2; i++) changed[i] = take_value(bytes);
    const size_t most = am_count(m, AM_INPUT) ? AM_MOST_LOOPS : 0;
    const size_t loops = take_byte(bytes) % 2 ? take_byte(bytes) % (most + 1) : 0;
    double *target = values(bytes, SAMPLES * loops);
    am_loop loop[AM_MOST_LOOPS];
    for (size_t i = 0; i < loops; i++) loop[i] = take_loop(m, target + SAMPLES * i, bytes);
    am_batch_task task = {.samples = SAMPLES - (take_byte(bytes) % 8 == 0 ? SAMPLES : 0),
                          .parameters = 2,
                          .outputs = 2,
                          .t = t,
                          .u = u,
                          .parameter = parameter,
                          .values = changed,
                          .output = output,
                          .y = y,
                          .hold = take_byte(bytes) % 2,
                          .loops = loops,
                          .loop = loop};
    promise(am_batch(sim, &task, 0, RUNS, status, done, text) == AM_OK,
            "a batch states per run what went wrong");
    for (int i = 0; i < RUNS; i++) {
        promise((status[i] == AM_OK) == !text[i][0], "a run that failed has a text");
        all_finite_or_die(y + (size_t)i * SAMPLES * 2, 2 * done[i],
                          "outputs of a batch are finite");
    }
    /* one after the other: the same bits */
    task.lanes = 1;
    task.y = alone;
    memset(alone, 0, sizeof alone);
    promise(am_batch(sim, &task, 0, RUNS, status, done, text) == AM_OK, "as well alone");
    for (int i = 0; i < RUNS; i++) {
        const size_t first = (size_t)i * SAMPLES * 2;
        promise(memcmp(y + first, alone + first, sizeof *y * 2 * done[i]) == 0,
                "runs side by side have the bits of runs alone");
    }
    free(u);
    free(target);
}

static void copy(const am_model *m, am_sim *sim) {
    am_sim *copy = am_new(m);
    if (!copy) exit(0);
    promise(am_copy(copy, sim) == AM_OK && am_copy(sim, copy) == AM_OK,
            "a simulation can be copied and back");
    outputs(m, copy);
    am_delete(copy);
}

/* Where a double may be changed in an image: anywhere, or at the beginning of the memory of a
 * submodel, where counts and indices stand. */
static size_t take_place(const am_model *m, const am_sim *sim, size_t n, bytes_t *bytes) {
    if (take_byte(bytes) % 2) return 8 * (size_t)take_number(bytes, (uint32_t)(n / 8));
    const uint32_t first = m->first_memory[take_byte(bytes) % GROUPS] + take_byte(bytes) % 4;
    return first < m->memories
               ? (size_t)((const char *)(sim->memory + first) - (const char *)&sim->now)
               : 0;
}

/* Bytes of a simulation, some of them changed, into another one that then takes the place of the
 * first. */
static void image(const am_model *m, am_sim *sim, bytes_t *bytes) {
    const size_t n = image_size(m);
    uint8_t *stored = malloc(n);
    am_sim *other = am_new(m);
    if (!stored || !other) exit(0);
    image_save(sim, stored);
    for (int i = take_byte(bytes) % 8; i > 0; i--) {
        const double value = take_value(bytes);
        memcpy(stored + take_place(m, sim, n, bytes), &value, sizeof value);
    }
    for (int i = take_byte(bytes) % 8; i > 0; i--) {
        stored[take_number(bytes, (uint32_t)n)] = take_byte(bytes);
    }
    if (image_restore(other, stored) == 0) am_copy(sim, other);
    am_delete(other);
    free(stored);
}

static void query(const am_model *m, const am_sim *sim, bytes_t *bytes) {
    double *below = room(count(m, AM_AXIS));
    double *above = room(count(m, AM_AXIS));
    am_entry entry;
    const am_kind kind = (am_kind)(take_byte(bytes) % 9);
    const int i = (int)take_number(bytes, 600) - 1;
    am_out_of_range(sim, below, above);
    promise((am_entry_at(m, kind, i, &entry) == AM_OK) == (i >= 0 && i < am_count(m, kind)),
            "the catalogue has as many rows as it states");
    am_known(kind, i);
    am_known_group(kind, i);
    am_known_stage(kind, i);
    am_group(i);
    promise(am_title(m) != NULL && am_meta(m) != NULL, "a model has texts");
    promise(am_state_count(m) == am_count(m, AM_STATE), "each state has a name");
    promise(am_lanes(m) >= 1 && am_lanes(m) <= 8, "runs side by side");
    double value;
    promise((am_get_input(sim, i, &value) == AM_OK) == (i >= 0 && i < am_count(m, AM_INPUT)),
            "an input that there is can be read");
    free(below);
    free(above);
}

void call_kernel(const am_model *m, am_sim *sim, bytes_t *bytes) {
    switch (take_byte(bytes) % 20) {
    case 0:
    case 1:
        set_parameter(m, sim, bytes);
        break;
    case 2:
    case 3:
        set_named(m, sim, bytes);
        break;
    case 4:
        set_inputs(m, sim, bytes);
        break;
    case 5:
    case 6:
        start(m, sim, bytes);
        break;
    case 7:
    case 8:
        step(m, sim, bytes);
        break;
    case 9:
        outputs(m, sim);
        break;
    case 10:
        slope(m, sim, bytes);
        break;
    case 11:
        set_state(m, sim, bytes);
        break;
    case 12:
        evaluate(m, sim, bytes);
        break;
    case 13:
        record(m, sim, bytes);
        break;
    case 14:
        batch(m, sim, bytes);
        break;
    case 15:
        copy(m, sim);
        complete_step(m, sim, bytes);
        break;
    case 16:
        image(m, sim, bytes);
        break;
    case 17:
        call_estimation(bytes);
        break;
    case 18:
        call_circuit(bytes);
        break;
    default:
        if (take_byte(bytes) % 8 == 0) trim_for(m, sim, bytes);
        else if (take_byte(bytes) % 8 == 0) checked(sim, am_trim(sim, take_byte(bytes) % 5));
        else query(m, sim, bytes);
    }
}

/* ---- models ---------------------------------------------------------------------------------- */

uint32_t crc32(const uint8_t *bytes, size_t n) {
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < n; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
    }
    return ~crc;
}

const char *folder_of_model(int k) {
    static const char *const NAME[] = {"whole",    "plain",     "bare",   "empty",   "fed",
                                       "stalling", "supported", "piston", "electric"};
    static char path[MODELS][4000];
    const char *folder = getenv("AEROMATCH_MODELS");
    promise(folder != NULL,
            "AEROMATCH_MODELS names the folder of the models; run kernel/fuzz/check.py");
    if (k >= MODELS) return NULL;
    snprintf(path[k], sizeof path[k], "%s/%s", folder, NAME[k]);
    return path[k];
}

am_model *model_of_folder(int k) {
    char path[4100], text[300];
    static uint8_t bytes[1 << 20];
    if (!folder_of_model(k)) return NULL;
    snprintf(path, sizeof path, "%s/model.bin", folder_of_model(k));
    FILE *file = fopen(path, "rb");
    promise(file != NULL, path);
    const size_t n = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    am_model *m = am_load(bytes, n, text, sizeof text);
    promise(m != NULL, text);
    return m;
}
