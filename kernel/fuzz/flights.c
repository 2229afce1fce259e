/* Every model in every mode, through a whole flight; a thousand simulations at once; simulations
 * in threads.  For the sanitizers. */
#include "drive.h"

#include "image.h"
#include "simulation.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { THREADS = 4, CROWD = 1000, FLIGHTS = 6, CALLS = 3000 };

typedef struct {
    const char *name;
    double value;
} setting_t;

static void set(const am_model *m, am_sim *sim, const char *name, double value) {
    const int input = am_find(m, AM_INPUT, name);
    const int parameter = am_find(m, AM_PARAMETER, name);
    if (input >= 0) promise(am_set_input(sim, input, value) == AM_OK, name);
    else if (parameter >= 0) promise(am_set_parameter(sim, parameter, value) == AM_OK, name);
}

/* Starts in the air, on approach with the wheels out, standing, rolling, at 90 and at 180
 * degrees, at rest in the air, under the ground. */
static const setting_t START[][6] = {
    {{"init.V", 80.0}, {"init.h", 1000.0}, {"engine1.throttle", 0.6}},
    {{"init.V", 55.0},
     {"init.h", 2.0},
     {"gear", 1.0},
     {"init.gamma", -0.05},
     {"init.theta", 0.02},
     {"brake_left", 0.5}},
    {{"init.V", 0.0},
     {"init.h", 0.415},
     {"gear", 1.0},
     {"init.theta", 0.065},
     {"brake_left", 1.0},
     {"brake_right", 1.0}},
    {{"init.V", 20.0},
     {"init.h", 0.415},
     {"gear", 1.0},
     {"init.theta", 0.065},
     {"delta_nw", 0.2},
     {"runway.condition", 1.0}},
    {{"init.V", 60.0},
     {"init.h", 1000.0},
     {"init.alpha", 1.5707963267948966},
     {"init.theta", 1.5707963267948966}},
    {{"init.V", 60.0}, {"init.h", 1000.0}, {"init.alpha", 3.141592653589793}},
    {{"init.V", 0.0}, {"init.h", 1000.0}},
    {{"init.V", 50.0}, {"init.h", -100.0}, {"gear", 1.0}},
};
static const setting_t WEATHER[] = {{"turbulence.mode", 1.0},     {"turbulence.W20", 15.0},
                                    {"turbulence.severity", 5.0}, {"wind.W20", 10.0},
                                    {"gust.peak_w", 8.0},         {"wind_n", 5.0}};
enum { STARTS = sizeof START / sizeof *START, WINDS = sizeof WEATHER / sizeof *WEATHER };

static am_sim *made(const am_model *m, int start, int earth, int engine, int controls,
                    int weather) {
    am_sim *sim = am_new(m);
    promise(sim != NULL, "memory");
    for (size_t i = 0; i < 6 && START[start][i].name; i++) {
        set(m, sim, START[start][i].name, START[start][i].value);
    }
    for (int i = 0; weather && i < WINDS; i++) set(m, sim, WEATHER[i].name, WEATHER[i].value);
    set(m, sim, "mode.earth", earth);
    set(m, sim, "mode.engine", engine);
    set(m, sim, "mode.controls", controls);
    return sim;
}

/* Half a second with the controls moved; the fuel cut and the starter on towards the end. */
static int fly(const am_model *m, am_sim *sim, double *last) {
    const size_t nu = (size_t)am_count(m, AM_INPUT);
    const size_t ny = (size_t)am_count(m, AM_OUTPUT);
    double *u0 = room(nu);
    double *u1 = room(nu);
    double *y = room(ny);
    int status = am_initialize(sim, 0.0);
    for (int k = 0; k < 25 && status == AM_OK; k++) {
        am_get_inputs(sim, u0);
        memcpy(u1, u0, nu * sizeof *u1);
        for (size_t i = 0; i < nu && i < 3; i++) u1[i] = 0.1 * (k % 5 - 2);
        if (k == 15 && am_find(m, AM_INPUT, "engine1.cutoff") >= 0) {
            u1[am_find(m, AM_INPUT, "engine1.cutoff")] = 1.0;
        }
        if (k == 20 && am_find(m, AM_INPUT, "engine1.starter") >= 0) {
            u1[am_find(m, AM_INPUT, "engine1.starter")] = 1.0;
        }
        status = am_step(sim, am_time(sim), 0.02, u0, u1);
        if (status == AM_OK) status = am_outputs(sim, y);
    }
    if (status != AM_OK) promise(am_error(sim)[0] != 0, "a failure has a text");
    for (size_t i = 0; status == AM_OK && i < ny; i++) promise(isfinite(y[i]), am_error(sim));
    if (last) *last = status == AM_OK ? y[0] : -1.0;
    free(u0);
    free(u1);
    free(y);
    return status == AM_OK;
}

/* Returns how many came to their end; the others have an engine or a gear driven that is not
 * there, or diverge. */
static int flights(const am_model *m) {
    int flown = 0;
    for (int start = 0; start < STARTS; start++) {
        for (int modes = 0; modes < 4 * 3 * 3; modes++) {
            const int earth = modes % 4;
            const int engine = modes / 4 % 3;
            const int controls = modes / 12;
            am_sim *sim = made(m, start, earth, engine, controls, (start + modes) % 2);
            flown += fly(m, sim, NULL);
            am_delete(sim);
        }
    }
    return flown;
}

static void trims(const am_model *m) {
    for (int mode = 1; mode <= 3; mode++) {
        for (int start = 0; start < 4; start++) {
            am_sim *sim = made(m, start, start % 2, 0, start % 3, 0);
            set(m, sim, "mode.trim", mode);
            fly(m, sim, NULL);
            am_delete(sim);
        }
    }
}

/* Images of a flight with one double of the memory of a submodel changed, at the places where
 * counts and indices stand. */
static void changed_images(const am_model *m) {
    static const double VALUE[] = {-1e300, -1e9, -1.0, 0.0, 0.5, 600.0, 1e9, 1e300};
    const size_t n = image_size(m);
    const size_t nu = (size_t)am_count(m, AM_INPUT);
    am_sim *sim = made(m, 0, 1, 0, 1, 1);
    am_sim *other = am_new(m);
    char *image = malloc(n);
    double *u = room(nu);
    promise(image && other && am_initialize(sim, 0.0) == AM_OK, "a start in the air");
    am_get_inputs(sim, u);
    for (int group = 0; group < GROUPS; group++) {
        for (uint32_t i = m->first_memory[group]; i < m->first_memory[group] + 4 && i < m->memories;
             i++) {
            for (size_t k = 0; k < sizeof VALUE / sizeof *VALUE; k++) {
                image_save(sim, image);
                memcpy(image + ((const char *)(sim->memory + i) - (const char *)&sim->now),
                       &VALUE[k], sizeof VALUE[k]);
                if (image_restore(other, image) != 0) continue;
                for (int step = 0; step < 3; step++) am_step(other, am_time(other), 0.01, u, u);
            }
        }
    }
    am_delete(sim);
    am_delete(other);
    free(image);
    free(u);
}

static void any_calls(const am_model *m, uint32_t seed) {
    static uint8_t choices[CALLS * 24];
    for (size_t i = 0; i < sizeof choices; i++) {
        seed = seed * 1664525u + 1013904223u;
        choices[i] = (uint8_t)(seed >> 24);
    }
    bytes_t bytes = {choices, sizeof choices};
    am_sim *sim = made(m, 0, 1, 0, 0, 0);
    am_initialize(sim, 0.0);
    for (int k = 0; k < CALLS; k++) {
        call_kernel(m, sim, &bytes);
        if (k % 40 == 0) {
            am_delete(sim);
            sim = made(m, 0, 1, 0, 0, 0);
            am_initialize(sim, 0.0);
        }
    }
    am_delete(sim);
}

static void crowd(const am_model *m) {
    static am_sim *sim[CROWD];
    const size_t nu = (size_t)am_count(m, AM_INPUT);
    double *u = room(nu);
    double *y = room((size_t)am_count(m, AM_OUTPUT));
    double first = 0.0;
    for (int i = 0; i < CROWD; i++) {
        sim[i] = made(m, 0, 1, 0, 0, 0);
        promise(am_initialize(sim[i], 0.0) == AM_OK, "a start in the air");
    }
    for (int i = 0; i < CROWD; i++) {
        am_get_inputs(sim[i], u);
        promise(am_step(sim[i], 0.0, 0.01, u, u) == AM_OK && am_outputs(sim[i], y) == AM_OK,
                "a step in the air");
        if (i == 0) first = y[0];
        promise(y[0] == first, "a thousand simulations fly alike");
    }
    for (int i = 0; i < CROWD; i++) am_delete(sim[i]);
    free(u);
    free(y);
}

typedef struct {
    const am_model *model;
    double last[FLIGHTS];
} worker_t;

static void *work(void *argument) {
    worker_t *worker = argument;
    for (int i = 0; i < FLIGHTS; i++) {
        am_sim *sim = made(worker->model, i % STARTS, i % 4, 0, i % 3, 1);
        fly(worker->model, sim, &worker->last[i]);
        am_delete(sim);
    }
    return NULL;
}

/* One model shared by threads: every one sees the same flights. */
static void threads(const am_model *m) {
    pthread_t thread[THREADS];
    worker_t worker[THREADS];
    worker_t alone = {.model = m};
    work(&alone);
    for (int i = 0; i < THREADS; i++) {
        worker[i].model = m;
        promise(pthread_create(&thread[i], NULL, work, &worker[i]) == 0, "a thread");
    }
    for (int i = 0; i < THREADS; i++) pthread_join(thread[i], NULL);
    for (int i = 0; i < THREADS; i++) {
        promise(memcmp(worker[i].last, alone.last, sizeof alone.last) == 0,
                "threads give the bits of one");
    }
}

int main(int argc, char **argv) {
    const int only_threads = argc > 1 && strcmp(argv[1], "threads") == 0;
    int flown = 0;
    for (int k = 0; folder_of_model(k); k++) {
        am_model *m = model_of_folder(k);
        threads(m);
        if (!only_threads) {
            flown += flights(m);
            trims(m);
            crowd(m);
            changed_images(m);
            any_calls(m, 1u + (uint32_t)k);
        }
        am_free(m);
    }
    printf("%d flights to the end, threads alike\n", flown);
    return 0;
}
