/* Changed nodes, scales and offsets of tables, as apply_patches of nodes.c.  The runs of a batch
 * change the same ones, each to values of its own. */
#ifndef AEROMATCH_LANED_PATCHES_H
#define AEROMATCH_LANED_PATCHES_H

#include "laned.h"
#include "cells.h"

/* A lane that later repeats another one repeats its values. */
static void load_patches(flight_t *f) {
    for (int l = 0; l < LANES; l++) {
        const am_sim *sim = f->lane[l];
        for (uint32_t i = 0; i < sim->patches; i++) f->change[i][l] = sim->patch[i].value;
    }
}

static inline double weight_along(const axis_t *axis, uint32_t cell, uint32_t at, double x) {
    const uint32_t lower = lower_node(axis, cell);
    return at == lower ? 1.0 - x : at == lower + 1 ? x : 0.0;
}

/* Of a node along an axis. */
static real laned_weight(const flight_t *f, uint32_t i, uint32_t at, bool shared) {
    const axis_t *axis = &f->model->axis[i];
    const real x = f->fraction[i];
    if (shared) {
        const uint32_t lower = lower_node(axis, f->lane[0]->cell[i]);
        return at == lower ? 1.0 - x : at == lower + 1 ? x : (real)0.0;
    }
    real w = 0.0;
    for (int l = 0; l < LANES; l++) w[l] = weight_along(axis, f->lane[l]->cell[i], at, x[l]);
    return w;
}

static real node_weight(const flight_t *f, const patch_t *patch) {
    const bundle_t *bundle = &f->model->bundle[patch->bundle];
    real w = 1.0;
    for (uint32_t k = 0; k < bundle->axes; k++) {
        w *= laned_weight(f, bundle->axis[k], patch->at[k], f->shared[patch->bundle]);
    }
    return w;
}

/* In the tables of a stage, which have been looked up. */
static void change_tables(flight_t *f, int stage) {
    const am_sim *any = f->lane[0];
    for (uint32_t i = 0; i < any->patches; i++) {
        const patch_t *patch = &any->patch[i];
        if (patch->stage != (uint32_t)stage) continue;
        real *value = &f->slot[patch->slot];
        if (patch->kind == PATCH_NODE) *value += f->change[i] * node_weight(f, patch);
        else if (patch->kind == PATCH_SCALE) *value *= f->change[i];
        else *value += f->change[i];
    }
}

#endif
