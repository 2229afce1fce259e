/* Reading and setting what a model and a simulation hold: catalogue, parameters, inputs, state. */
#include "access.h"

#include "error.h"
#include "nodes.h"

#include <math.h>
#include <string.h>

/* ---- the model ------------------------------------------------------------------------------- */

int am_format(void) { return AM_FORMAT; }

const char *am_title(const am_model *model) { return model->title; }

const char *am_meta(const am_model *model) { return model->meta; }

static bool is_catalogued(am_kind kind) {
    return (int)kind >= AM_INPUT && (int)kind <= AM_AXIS && kind != AM_TARGET;
}

int am_count(const am_model *model, am_kind kind) {
    return is_catalogued(kind) ? model->count[kind] : 0;
}

int am_entry_at(const am_model *model, am_kind kind, int i, am_entry *entry) {
    if (!is_catalogued(kind) || i < 0 || i >= model->count[kind]) return AM_BAD_INDEX;
    *entry = model->entry[kind][i];
    return AM_OK;
}

int am_find(const am_model *model, am_kind kind, const char *name) {
    for (int i = 0; i < am_count(model, kind); i++) {
        if (strcmp(model->entry[kind][i].name, name) == 0) return i;
    }
    return kind == AM_PARAMETER ? find_table_parameter(model, name) : -1;
}

int am_state_count(const am_model *model) { return model->count[AM_STATE]; }

/* ---- the simulation -------------------------------------------------------------------------- */

const char *am_error(const am_sim *sim) { return sim->text; }

double am_time(const am_sim *sim) { return sim->time; }

void store_inputs(am_sim *sim, const double *u) {
    memcpy(sim->u, u, sizeof(double) * (size_t)sim->model->count[AM_INPUT]);
    sim->fresh = false;
}

static int refuse_value(am_sim *sim, am_kind kind, int i, double value) {
    return fail(sim, AM_NOT_FINITE, "%s is %g; it must be finite", sim->model->entry[kind][i].name,
                value);
}

int am_set_parameter(am_sim *sim, int i, double value) {
    if (i < 0) return fail(sim, AM_BAD_INDEX, "there is no parameter %d", i);
    const bool catalogued = i < sim->model->count[AM_PARAMETER];
    if (!isfinite(value) && catalogued) return refuse_value(sim, AM_PARAMETER, i, value);
    if (!isfinite(value)) {
        return fail(sim, AM_NOT_FINITE,
                    "a node, scale or offset of a table is %g; it must be finite", value);
    }
    if (catalogued) {
        sim->par[i] = value;
    } else {
        const int status = set_table_parameter(sim, (uint32_t)i, value);
        if (status != AM_OK) return status;
    }
    sim->prepared = sim->fresh = false;
    return AM_OK;
}

int am_get_parameter(const am_sim *sim, int i, double *value) {
    if (i < 0) return AM_BAD_INDEX;
    if (i >= sim->model->count[AM_PARAMETER]) return get_table_parameter(sim, (uint32_t)i, value);
    *value = sim->par[i];
    return AM_OK;
}

int am_set_input(am_sim *sim, int i, double value) {
    if (i < 0 || i >= sim->model->count[AM_INPUT]) {
        return fail(sim, AM_BAD_INDEX, "there is no input %d", i);
    }
    if (!isfinite(value)) return refuse_value(sim, AM_INPUT, i, value);
    /* the same bits again: what has been found stays */
    if (memcmp(&sim->u[i], &value, sizeof value) == 0) return AM_OK;
    sim->u[i] = value;
    sim->fresh = false;
    return AM_OK;
}

int am_get_input(const am_sim *sim, int i, double *value) {
    if (i < 0 || i >= sim->model->count[AM_INPUT]) return AM_BAD_INDEX;
    *value = sim->u[i];
    return AM_OK;
}

int am_set_inputs(am_sim *sim, const double *u) {
    for (int i = 0; i < sim->model->count[AM_INPUT]; i++) {
        if (!isfinite(u[i])) return refuse_value(sim, AM_INPUT, i, u[i]);
    }
    store_inputs(sim, u);
    return AM_OK;
}

int am_get_inputs(const am_sim *sim, double *u) {
    memcpy(u, sim->u, sizeof(double) * (size_t)sim->model->count[AM_INPUT]);
    return AM_OK;
}

int am_get_state(const am_sim *sim, double *x) {
    memcpy(x, sim->x, sizeof(double) * (size_t)am_state_count(sim->model));
    return AM_OK;
}

int am_set_state(am_sim *sim, const double *x) {
    for (int i = 0; i < am_state_count(sim->model); i++) {
        if (!isfinite(x[i])) return refuse_value(sim, AM_STATE, i, x[i]);
    }
    memcpy(sim->x, x, sizeof(double) * (size_t)am_state_count(sim->model));
    sim->fresh = false;
    return AM_OK;
}

int am_out_of_range(const am_sim *sim, double *below, double *above) {
    memcpy(below, sim->below, sizeof(double) * sim->model->axes);
    memcpy(above, sim->above, sizeof(double) * sim->model->axes);
    return AM_OK;
}
