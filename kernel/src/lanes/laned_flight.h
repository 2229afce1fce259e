/* The flight of LANES runs side by side: arrays, steps, outputs and the end of each run. */
#ifndef AEROMATCH_LANED_FLIGHT_H
#define AEROMATCH_LANED_FLIGHT_H

#include "control_step.h"
#include "control_outputs.h"
#include "engine.h"
#include "error.h"
#include "laned_linkage.h"
#include "laned_parts.h"
#include "laned_tables.h"
#include "lanes.h"
#include "loops.h"
#include "one_step.h"
#include "outputs.h"
#include "runge_kutta.h"
#include "separation.h"
#include "spool.h"
#include "terms.h"

#include <stdlib.h>
#include <string.h>

/* ---- arrays ---------------------------------------------------------------------------------- */

static real *next_lane_array(real **at, size_t n) {
    real *from = *at;
    *at += n;
    return from;
}

static size_t reals(const am_model *m) {
    return (size_t)m->count[AM_PARAMETER] + 5 * (size_t)m->count[AM_INPUT]
           + (size_t)m->count[AM_OUTPUT] + 6 * (size_t)am_state_count(m) + m->total[AM_VARIABLE]
           + values_of(m) + m->total[AM_TARGET] + LAST_POWER + m->axes + m->memories + m->works
           + sizeof(cells_r) / sizeof(real) * m->axes;
}

/* From par to fraction, and from now to omega: all that a derivative changes but for the cells, of
 * which the next look-up takes care. */
#define OWN ((offsetof(flight_t, omega) - offsetof(flight_t, now)) / sizeof(real))

static size_t changed(const flight_t *f) { return (size_t)(f->fraction - f->par); }

/* at: aligned memory of reals(m), and of what changes once more. */
static void lay_out_lanes(flight_t *f, const am_model *m, real *at) {
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t nx = (size_t)am_state_count(m);
    f->model = m;
    f->par = next_lane_array(&at, (size_t)m->count[AM_PARAMETER]);
    f->u = next_lane_array(&at, nu);
    f->u_work = next_lane_array(&at, nu);
    f->u_end = next_lane_array(&at, nu);
    f->u0 = next_lane_array(&at, nu);
    f->u1 = next_lane_array(&at, nu);
    f->y_work = next_lane_array(&at, (size_t)m->count[AM_OUTPUT]);
    f->x = next_lane_array(&at, nx);
    f->x_work = next_lane_array(&at, nx);
    f->k = next_lane_array(&at, 4 * nx);
    f->var = next_lane_array(&at, m->total[AM_VARIABLE]);
    f->slot = next_lane_array(&at, values_of(m));
    f->sum = next_lane_array(&at, m->total[AM_TARGET]);
    f->memory = next_lane_array(&at, m->memories);
    f->work = next_lane_array(&at, m->works);
    f->last_power = next_lane_array(&at, LAST_POWER);
    f->fraction = next_lane_array(&at, m->axes);
    f->cells = (cells_r *)next_lane_array(&at, sizeof(cells_r) / sizeof(real) * m->axes);
    f->before = next_lane_array(&at, changed(f) + OWN);
    f->lists = lay_lists(m, (uint32_t *)at);
    f->shared = (bool *)((uint32_t *)at + LIST_WORDS(m));
    f->scale = f->par + m->total[AM_PARAMETER];
    f->exponent = f->scale + m->terms;
}

/* A simulation that stands at the first sample, its outputs found. */
static void load_lane(flight_t *f, int l, am_sim *sim) {
    const am_model *m = f->model;
    const size_t nx = (size_t)am_state_count(m);
    f->lane[l] = sim;
    copy_to_lane(sim->par, (size_t)m->count[AM_PARAMETER], l, f->par);
    copy_to_lane(sim->u, (size_t)m->count[AM_INPUT], l, f->u);
    copy_to_lane(sim->x, nx, l, f->x);
    copy_to_lane(sim->k, nx, l, f->k);
    copy_to_lane(sim->var, m->total[AM_VARIABLE], l, f->var);
    copy_to_lane(sim->slot, values_of(m), l, f->slot);
    copy_to_lane(sim->sum, m->total[AM_TARGET], l, f->sum);
    const uint32_t own = m->first_memory[G_FUEL];
    copy_to_lane(sim->memory + own, m->memories - own, l, f->memory + own);
    copy_to_lane(sim->work, m->works, l, f->work);
    copy_to_lane(sim->last_power, LAST_POWER, l, f->last_power);
    copy_to_lane((const double *)&sim->now, sizeof(now_t) / sizeof(double), l, (real *)&f->now);
    copy_to_lane((const double *)&sim->atmosphere, 2 * LAYERS, l, (real *)&f->atmosphere);
    copy_to_lane((const double *)&sim->standard, 2 * LAYERS, l, (real *)&f->standard);
    copy_to_lane((const double *)&sim->anchor, sizeof(anchor_t) / sizeof(double), l,
                 (real *)&f->anchor);
    copy_to_lane((const double *)&sim->trim, sizeof(trim_t) / sizeof(double), l, (real *)&f->trim);
    copy_to_lane(work_of(sim, G_WEATHER, 0) + W_WIND, 3, l, f->wind);
    copy_to_lane(work_of(sim, G_WEATHER, 0) + W_GUST, 3, l, f->gust);
    f->reach[l] = sim->reach;
    f->fresh[l] = sim->fresh ? -1 : 0;
    for (uint32_t i = 0; i < m->axes; i++) f->cells[i].from[l] = INFINITY; /* to be found */
    f->windy = f->windy || sim->windy;
    f->rotors |= sim->rotors;
}

/* A lane without a run repeats another, so that no number that is not finite slows all down. */
static void repeat(flight_t *f, int from, int to) {
    real *at = f->par;
    real *now = (real *)&f->now;
    for (size_t i = 0, n = reals(f->model); i < n; i++) at[i][to] = at[i][from];
    for (size_t i = 0; i < OWN; i++) now[i][to] = now[i][from];
    am_copy(f->lane[to], f->lane[from]);
    for (int stage = 0; stage < STAGES; stage++) find_shared(f, stage);
}

/* ---- a step ---------------------------------------------------------------------------------- */

/* Lanes whose last call left the derivative at the inputs u. */
static mask_t laned_can_reuse(const flight_t *f, const real *u) {
    mask_t reuse = f->fresh;
    for (int i = 0; i < f->model->count[AM_INPUT]; i++)
        reuse &= words_of(u[i]) == words_of(f->u[i]);
    return reuse;
}

static void restore_lanes(mask_t reuse, const real *before, size_t n, real *now) {
    for (size_t i = 0; i < n; i++) now[i] = PICK(reuse, before[i], now[i]);
}

/* As in control_step.c; lanes whose last call left the derivative keep it. */
static void laned_find_start(flight_t *f, double t, const real *u0) {
    const size_t n = changed(f);
    real *now = (real *)&f->now;
    const mask_t reuse = laned_can_reuse(f, u0);
    if (EVERY(reuse)) return;
    const bool some = ANY(reuse);
    const bool off_ground = f->off_ground;
    if (some) {
        memcpy(f->before, f->par, sizeof(real) * n);
        memcpy(f->before + n, now, sizeof(real) * OWN);
    }
    f->part = 0.0;
    f->clock = t;
    derivative(f, f->x, u0, f->k);
    if (some) {
        restore_lanes(reuse, f->before, n, f->par);
        restore_lanes(reuse, f->before + n, OWN, now);
    }
    f->off_ground = f->off_ground && (off_ground || !some); /* of all lanes */
    f->fresh &= reuse;
}

static void advance_levers(flight_t *f, double t, double h, const real *u0, const real *u1) {
    for (uint32_t i = 0; i < items(f->model, G_SPOOL); i++) {
        const real from = input_of(f, u0, G_ENGINE, i)[U_THROTTLE];
        const real to = input_of(f, u1, G_ENGINE, i)[U_THROTTLE];
        for (int l = 0; l < LANES; l++) {
            am_sim *sim = f->lane[l];
            sim->fresh = f->fresh[l];
            spool_advance(sim, i, t, h, from[l], to[l]);
            f->fresh[l] = sim->fresh ? -1 : 0;
        }
    }
}

static void advance_weather(flight_t *f, double t, double h, const real *u0, const real *u1) {
    const size_t nu = (size_t)f->model->count[AM_INPUT];
    for (int l = 0; l < LANES && f->windy; l++) {
        am_sim *sim = f->lane[l];
        copy_from_lane(f->x, (size_t)am_state_count(f->model), l, sim->x);
        weather_advance(sim, t, h, copy_from_lane(u0, nu, l, sim->u_work),
                        copy_from_lane(u1, nu, l, sim->u_end));
    }
}

static void laned_advance_parts(flight_t *f, double t, double h, const real *u0, const real *u1) {
    advance_weather(f, t, h, u0, u1);
    advance_levers(f, t, h, u0, u1);
    control_advance(f, t, h, u0, u1);
}

/* Lanes whose last call left their slope keep it, and its anchor: wind at the end of a step and at
 * the start of the next one is the same but for rounding. */
static void laned_first_slope(flight_t *f, double t, double h, const real *u, mask_t reuse) {
    const int n = am_state_count(f->model);
    reuse &= f->fresh;
    f->fresh = 0;
    if (EVERY(reuse)) return;
    real *k = f->k;
    real *before = f->k + n; /* the slope to come */
    const anchor_r stood = f->anchor;
    real power[A_POWER];
    memcpy(before, k, sizeof *k * (size_t)n);
    memcpy(power, f->last_power + A_POWER, sizeof power);
    slope(f, t, h, 0.0, f->x, u, k);
    restore_lanes(reuse, before, (size_t)n, k);
    keep_anchor(f, f->x);
    restore_lanes(reuse, (const real *)&stood, sizeof stood / sizeof(real), (real *)&f->anchor);
    restore_lanes(reuse, power, A_POWER, f->last_power + A_POWER);
}

static void laned_count_steps_outside(flight_t *f, mask_t counts) {
    for (int l = 0; l < LANES; l++) {
        if (counts[l]) count_outside(f->lane[l]);
    }
}

/* ---- outputs --------------------------------------------------------------------------------- */

static real laned_steps_outside(const flight_t *f) {
    real steps = 0.0;
    for (int l = 0; l < LANES; l++) {
        const am_sim *sim = f->lane[l];
        for (uint32_t i = 0; i < f->model->axes; i++) steps[l] += sim->below[i] + sim->above[i];
    }
    return steps;
}

static void laned_part_outputs(flight_t *f, real *y) {
    air_outputs(&f->now, f->wind, f->gust, output_of(f, y, G_WEATHER, 0));
    fuel_outputs(f, y);
    engine_outputs(f, y);
    gear_outputs(f, y);
    control_outputs(f, y);
    separation_outputs(f, y);
}

static void refresh_lanes(flight_t *f) {
    f->clock = f->time;
    f->part = 1.0;
    derivative(f, f->x, f->u, f->k);
    keep_anchor(f, f->x);
    f->fresh = -1;
}

/* ---- runs ------------------------------------------------------------------------------------ */

typedef struct {
    const group_t *group;
    bool flies[LANES];
    int flying; /* how many */
    loops_t loops[LANES];
} course_t;

/* Ends the runs with a number that is not finite, each with its text. */
static void end_runs(flight_t *f, course_t *course, am_kind kind, const real *values) {
    const group_t *g = course->group;
    const size_t n = (size_t)f->model->count[kind];
    real nothing = 0.0;
    for (size_t i = 0; i < n; i++) nothing += values[i] * 0.0;
    if (EVERY(nothing == 0.0)) return;
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        if (nothing[l] == 0.0 || !course->flies[l]) continue;
        sim->time = f->time;
        const size_t run = g->run[l];
        g->status[run] = check_finite(
            sim, kind, copy_from_lane(values, n, l, kind == AM_STATE ? sim->x_work : sim->y_work));
        memcpy(g->text[run], sim->text, AM_TEXT);
        course->flies[l] = false;
        course->flying--;
    }
    int good = 0;
    while (good < LANES && !course->flies[good]) good++;
    for (int l = 0; l < LANES && good < LANES; l++) {
        if (course->flies[l]) continue;
        repeat(f, good, l);
        course->loops[l] = course->loops[good];
    }
}

static void load_inputs(const flight_t *f, const course_t *course, size_t k, real *u) {
    const am_batch_task *task = course->group->task;
    const size_t nu = (size_t)f->model->count[AM_INPUT];
    for (int l = 0; l < LANES; l++) {
        const size_t run = course->group->run[l < course->group->runs ? l : 0];
        copy_to_lane(task->u + (run * (task->each_inputs != 0) * task->samples + k) * nu, nu, l, u);
    }
}

/* Inputs at both ends of the step from sample k - 1, with what the loops add. */
static void load_with_loops(const flight_t *f, course_t *course, size_t k, real *u0, real *u1) {
    const am_batch_task *task = course->group->task;
    load_inputs(f, course, k - 1, u0);
    load_inputs(f, course, k, u1);
    for (int l = 0; l < LANES; l++) {
        const am_sim *sim = f->lane[l < course->group->runs ? l : 0];
        loops_t *loops = course->loops + l;
        double held[AM_MOST_LOOPS];
        for (size_t i = 0; i < task->loops; i++) {
            const int output = task->loop[i].output;
            held[i] = k == 1 ? sim->y_work[output] : f->y_work[output][l];
        }
        close_loops(task, k - 1, held, loops);
        for (size_t i = 0; i < task->loops; i++) {
            if (first_loop(task, i) != i) continue;
            u0[task->loop[i].input][l] += loops->push[i];
            u1[task->loop[i].input][l] += loops->push[i];
        }
    }
}

static void store_outputs(const flight_t *f, const course_t *course, size_t k) {
    const group_t *g = course->group;
    const am_batch_task *task = g->task;
    for (int l = 0; l < g->runs; l++) {
        if (!course->flies[l]) continue;
        double *y = task->y + (g->run[l] * task->samples + k) * task->outputs;
        for (size_t i = 0; i < task->outputs; i++) y[i] = f->y_work[task->output[i]][l];
        g->done[g->run[l]] = k + 1;
    }
}

/* As am_step; false when no run is left. */
static bool step(flight_t *f, course_t *course, double t, double dt, const real *u0,
                 const real *u1) {
    const size_t nx = (size_t)am_state_count(f->model);
    const double parts = ceil(dt / f->lane[0]->par[P_STEP] - 1e-9);
    const long n = parts < 1.0 ? 1 : (long)parts;
    for (long i = 0; i < n; i++) {
        const double s0 = (double)i / (double)n;
        const double s1 = (double)(i + 1) / (double)n;
        runge_kutta(f, t + dt * s0, dt / (double)n, u0, u1, s0, s1);
        f->time = t + dt * s1;
        end_runs(f, course, AM_STATE, f->x_work);
        if (!course->flying) return false;
        memcpy(f->x, f->x_work, sizeof(real) * nx);
    }
    memcpy(f->u, u1, sizeof(real) * (size_t)f->model->count[AM_INPUT]);
    f->fresh = 0;
    return true;
}

static void fly_record(flight_t *f, course_t *course) {
    const am_batch_task *task = course->group->task;
    const double *t = task->t;
    load_inputs(f, course, 0, f->u1);
    for (size_t k = 1; k < task->samples && course->flying; k++) {
        real *u0 = f->u1;
        real *u1 = f->u0;
        f->u0 = u0;
        f->u1 = u1;
        if (task->loops) load_with_loops(f, course, k, u0, u1);
        else load_inputs(f, course, k, u1);
        if (!step(f, course, t[k - 1], t[k] - t[k - 1], u0, task->hold ? u0 : u1)) return;
        refresh_lanes(f);
        write_outputs(f, f->y_work);
        end_runs(f, course, AM_OUTPUT, f->y_work);
        store_outputs(f, course, k);
    }
}

bool LANED(fly)(const group_t *g) {
    const am_model *m = g->sim[0]->model;
    course_t course = {.group = g, .flying = g->runs};
    const size_t bytes = sizeof(flight_t) + sizeof(real) * (2 * reals(m) + OWN + 1)
                         + sizeof(uint32_t) * LIST_WORDS(m) + m->bundles;
    char *memory = calloc(1, bytes);
    if (!memory) return false;
    const uintptr_t over = (uintptr_t)memory % sizeof(real);
    flight_t *f = (flight_t *)(memory + (over ? sizeof(real) - over : 0));
    lay_out_lanes(f, m, (real *)(f + 1));
    for (int l = 0; l < LANES; l++) {
        course.flies[l] = l < g->runs;
        load_lane(f, l, g->sim[l]);
    }
    load_patches(f);
    for (int stage = 0; stage < STAGES; stage++) find_shared(f, stage);
    list_terms(f);
    const am_sim *first = g->sim[0];
    f->omega = first->omega;
    f->time = first->time;
    f->earth = first->earth;
    f->drive = first->drive;
    f->controls = first->controls;
    fly_record(f, &course);
    free(memory);
    return true;
}

#endif
