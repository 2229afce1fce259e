/* Many runs of one record, each with its own parameters, as an estimation needs them: side by side
 * in the lanes of the processor where they keep step with each other, else one after the other. */
#include "control_drive.h"
#include "error.h"
#include "lanes.h"
#include "loops.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int am_lanes(const am_model *model) { return model->lanes; }

static const double *inputs_of(const am_batch_task *task, const am_model *m, size_t run) {
    return task->u + run * (task->each_inputs != 0) * task->samples * (size_t)m->count[AM_INPUT];
}

static bool loops_exist(const am_sim *sim, const am_batch_task *task) {
    const int *count = sim->model->count;
    if (task->loops > AM_MOST_LOOPS) return false;
    for (size_t i = 0; i < task->loops; i++) {
        const am_loop *loop = task->loop + i;
        if (loop->input < 0 || loop->input >= count[AM_INPUT]) return false;
        if (loop->output < 0 || loop->output >= count[AM_OUTPUT]) return false;
    }
    return true;
}

/* Outputs at a sample, and what the loops add to the inputs of the step from there. */
static int sample_with_loops(am_sim *sim, const am_batch_task *task, size_t run, size_t k,
                             loops_t *loops) {
    double *y = task->y + (run * task->samples + k) * task->outputs;
    double held[AM_MOST_LOOPS];
    const int status = am_outputs(sim, sim->y_work);
    if (status != AM_OK) return status;
    for (size_t i = 0; i < task->outputs; i++) y[i] = sim->y_work[task->output[i]];
    for (size_t i = 0; i < task->loops; i++) held[i] = sim->y_work[task->loop[i].output];
    close_loops(task, k, held, loops);
    return AM_OK;
}

/* u: memory for the inputs at both ends of a step. */
static int record_with_loops(am_sim *sim, const am_batch_task *task, size_t run, size_t samples,
                             double *u, size_t *done) {
    const size_t nu = (size_t)sim->model->count[AM_INPUT];
    const double *inputs = inputs_of(task, sim->model, run);
    loops_t loops = {0};
    int status = AM_OK;
    for (size_t k = 0; k < samples && status == AM_OK; k++) {
        if (k > 0) {
            memcpy(u, inputs + (k - 1) * nu, sizeof *u * 2 * nu);
            add_push(task, &loops, u);
            add_push(task, &loops, u + nu);
            status = am_step(sim, task->t[k - 1], task->t[k] - task->t[k - 1], u,
                             task->hold ? u : u + nu);
        }
        if (status == AM_OK) status = sample_with_loops(sim, task, run, k, &loops);
        if (status == AM_OK) *done = k + 1;
    }
    return status;
}

/* The samples up to `samples` of a simulation that stands at the start. */
static int record_one(am_sim *sim, const am_batch_task *task, size_t run, size_t samples,
                      size_t *done) {
    if (task->loops == 0) {
        return am_record(sim, samples, task->t, inputs_of(task, sim->model, run), task->hold,
                         task->output, task->outputs, task->y + run * task->samples * task->outputs,
                         NULL, done);
    }
    if (!loops_exist(sim, task)) {
        return fail(sim, AM_BAD_INDEX,
                    "a batch takes at most %d loops, of inputs and outputs that are there",
                    AM_MOST_LOOPS);
    }
    double *u = malloc(sizeof *u * 2 * (size_t)sim->model->count[AM_INPUT]);
    *done = 0;
    if (!u) return fail(sim, AM_NOT_READY, "no memory for the inputs of a step");
    const int status = record_with_loops(sim, task, run, samples, u, done);
    free(u);
    return status;
}

/* Parameters, start and the samples up to `samples`. */
static int fly_one(am_sim *sim, const am_batch_task *task, size_t run, size_t samples,
                   size_t *done) {
    if (task->samples == 0) {
        return fail(sim, AM_BAD_ARGUMENT, "a batch needs a record of at least one sample");
    }
    const double *values = task->values + run * task->parameters;
    const double *u = inputs_of(task, sim->model, run);
    for (size_t i = 0; i < task->parameters; i++) {
        const int status = am_set_parameter(sim, task->parameter[i], values[i]);
        if (status != AM_OK) return status;
    }
    int status = am_set_inputs(sim, u);
    if (status == AM_OK) status = am_initialize(sim, task->t[0]);
    if (status != AM_OK) return status;
    return record_one(sim, task, run, samples, done);
}

static void set_status(const am_sim *sim, const group_t *g, size_t run, int status) {
    g->status[run] = status;
    snprintf(g->text[run], AM_TEXT, "%s", status == AM_OK ? "" : am_error(sim));
}

static void alone(am_sim *sim, const am_sim *base, const group_t *g, size_t run, size_t samples) {
    am_copy(sim, base);
    g->done[run] = 0;
    set_status(sim, g, run, fly_one(sim, g->task, run, samples, &g->done[run]));
}

/* A simulation that has made its first sample. */
static void go_on(am_sim *sim, const group_t *g, size_t run) {
    set_status(sim, g, run, record_one(sim, g->task, run, g->task->samples, &g->done[run]));
}

/* ---- side by side ---------------------------------------------------------------------------- */

static bool finite_loops(const am_batch_task *task) {
    for (size_t i = 0; i < task->loops; i++) {
        const am_loop *loop = task->loop + i;
        const double numbers[] = {loop->gain, loop->integral, loop->limit};
        if (!all_finite(numbers, 3) || !all_finite(loop->target, task->samples)) return false;
    }
    return true;
}

/* Rising finite times, finite inputs and loops, so that only what a run computes can end it, and a
 * model whose equations have the same branches in every run. */
static bool regular(const am_sim *base, const am_batch_task *task, size_t first, size_t last) {
    const am_model *m = base->model;
    const size_t n = task->samples * (size_t)m->count[AM_INPUT];
    const size_t records = task->each_inputs ? last : first + 1;
    if (task->samples < 2 || (m->unknowns && m->late_force)) return false;
    for (size_t k = 0; k < task->samples; k++) {
        if (!(fabs(task->t[k]) <= LATEST) || (k && !(task->t[k] > task->t[k - 1]))) return false;
    }
    if (!finite_loops(task)) return false;
    for (size_t run = first; run < records; run++) {
        if (!all_finite(inputs_of(task, m, run), n)) return false;
    }
    return true;
}

/* Linkages with as many bodies, wheels steered by equations of the same order. */
static bool same_orders(const am_sim *a, const am_sim *b) {
    for (uint32_t i = 0; i < items(a->model, G_GEAR); i++) {
        const double order = par_of(a, G_GEAR, i)[P_STEERING_ORDER];
        if (par_of(b, G_GEAR, i)[P_STEERING_ORDER] != order) return false;
    }
    for (uint32_t i = 0; i < circuits(a); i++) {
        const double order = par_of(a, G_CIRCUIT, i)[P_CIRCUIT_ORDER];
        if (par_of(b, G_CIRCUIT, i)[P_CIRCUIT_ORDER] != order) return false;
    }
    return true;
}

/* The same modes, and steps that few enough make a sample. */
static bool fit_together(const am_sim *a, const am_sim *b, const am_batch_task *task) {
    const double step = a->par[P_STEP];
    for (size_t k = 1; k < task->samples; k++) {
        if (!((task->t[k] - task->t[k - 1]) / step <= 1e9)) return false;
    }
    return a->earth == b->earth && a->drive == b->drive && a->controls == b->controls
           && a->par[P_STEP] == b->par[P_STEP] && a->par[P_RATES] == b->par[P_RATES]
           && same_orders(a, b);
}

#if defined(__x86_64__) && !defined(AM_PLAIN)
static fly_t *fly_of(int lanes) { return lanes == 8 ? fly_8 : fly_4; }
#else
static bool fly_none(const group_t *group) {
    (void)group;
    return false;
}
static fly_t *fly_of(int lanes) {
    (void)lanes;
    return fly_none;
}
#endif

/* Runs from `run` on; those that failed at the start are done. */
static void side_by_side(am_sim **sim, const am_sim *base, group_t *g, size_t run, int runs,
                         int lanes) {
    g->runs = 0;
    for (int i = 0; i < runs; i++) {
        am_sim *here = g->sim[g->runs] = sim[g->runs];
        alone(here, base, g, run + (size_t)i, 1);
        if (g->status[run + (size_t)i] == AM_OK) g->run[g->runs++] = run + (size_t)i;
    }
    bool together = g->runs > 1;
    for (int i = 0; i < g->runs && together; i++) {
        together = fit_together(sim[0], sim[i], g->task);
    }
    for (int i = g->runs; i < lanes && together; i++) {
        g->sim[i] = sim[i];
        am_copy(sim[i], sim[0]);
    }
    if (together && fly_of(lanes)(g)) return;
    for (int i = 0; i < g->runs; i++) go_on(sim[i], g, g->run[i]);
}

static int new_sims(am_sim **sim, const am_model *m, int n) {
    for (int i = 0; i < n; i++) {
        if (!(sim[i] = am_new(m))) return i;
    }
    return n;
}

int am_batch(const am_sim *base, const am_batch_task *task, size_t first, size_t last, int *status,
             size_t *done, char (*text)[AM_TEXT]) {
    const int most = base->model->lanes;
    const int wanted = task->lanes > 0 && task->lanes < most ? task->lanes : most;
    const bool together = wanted >= 4 && last - first > 1 && regular(base, task, first, last);
    const int lanes = !together ? 1 : wanted >= 8 ? 8 : 4;
    am_sim *sim[MOST_LANES];
    group_t group = {.task = task, .status = status, .done = done, .text = text};
    const int made = new_sims(sim, base->model, lanes);
    for (size_t run = first; run < last && made == lanes;) {
        const size_t left = last - run;
        const int width = lanes == 8 && left <= 4 ? 4 : lanes;
        const int runs = left < (size_t)width ? (int)left : width;
        if (runs > 1) side_by_side(sim, base, &group, run, runs, width);
        else alone(sim[0], base, &group, run, task->samples);
        run += (size_t)runs;
    }
    for (int i = 0; i < made; i++) am_delete(sim[i]);
    return made == lanes ? AM_OK : AM_NOT_READY;
}
