/* Look-up of the tables of a stage for all lanes.
 *
 * Axes are searched only in lanes that have left their cell, and the weights of the corners are
 * found in lanes.  A bundle whose lanes are all in one cell goes on in lanes.  Else each lane takes
 * four tables of its cell at a time, and four lanes of them are turned. */
#ifndef AEROMATCH_LANED_TABLES_H
#define AEROMATCH_LANED_TABLES_H

#include "four.h"
#include "laned.h"
#include "laned_patches.h"
#include "cells.h"
#include "look_up.h"

/* As move_bench of cells.c for one lane: the cell that holds x, which comes within reach. */
static bool move_to_cell_of(flight_t *f, uint32_t i, int l, real *x) {
    const axis_t *axis = &f->lane[l]->model->axis[i];
    cells_r *at = &f->cells[i];
    uint32_t *cell = &f->lane[l]->cell[i];
    (*x)[l] = within_reach((*x)[l]);
    const uint32_t found = find_cell(axis, (*x)[l]);
    const bool moved = found != *cell;
    f->lane[l]->end_cells = RECOUNT;
    const cell_t *c = &axis->cell[found];
    *cell = found;
    at->from[l] = c[0].from;
    at->to[l] = c[1].from;
    at->point[l] = c->point;
    at->per_step[l] = c->per_step;
    at->start[l] = c->start;
    return moved;
}

/* Whether all lanes look at the same corner of the same tables. */
static void find_shared(flight_t *f, int stage) {
    const am_model *m = f->model;
    for (uint32_t b = m->first_bundle[stage]; b < m->first_bundle[stage + 1]; b++) {
        f->shared[b] = true;
        for (int l = 1; l < LANES; l++) {
            f->shared[b] &= f->lane[l]->corner[b] == f->lane[0]->corner[b]
                            && f->lane[l]->model->node == f->lane[0]->model->node;
        }
    }
}

static void locate_lanes(flight_t *f, int stage) {
    const am_model *m = f->model;
    bool moved[LANES] = {false};
    bool any = false;
    for (uint32_t i = m->first_axis[stage]; i < m->first_axis[stage + 1]; i++) {
        const cells_r *c = &f->cells[i];
        real x = f->var[m->axis[i].variable];
        const mask_t in = (x >= c->from) & (x < c->to);
        for (int l = 0; l < LANES && !EVERY(in); l++) {
            if (!in[l] && move_to_cell_of(f, i, l, &x)) any = moved[l] = true;
        }
        f->fraction[i] = c->start + (x - c->point) * c->per_step;
    }
    if (!any) return;
    for (int l = 0; l < LANES; l++) {
        if (moved[l]) find_corners(f->lane[l], stage);
    }
    find_shared(f, stage);
}

/* ---- interpolation --------------------------------------------------------------------------- */

/* The operations of interpolate.h: a corner weighs the product over the axes, first axis first,
 * and the corners are added in pairs. */
#define CORNERS (1 << MAX_AXES)

typedef struct {
    real weight[CORNERS];
    size_t offset[CORNERS]; /* of a corner from the first */
} corners_t;

__attribute__((always_inline)) static inline void find_weights(const flight_t *f,
                                                               const bundle_t *bundle,
                                                               uint32_t axes, corners_t *c) {
    c->weight[0] = 1.0;
    c->offset[0] = 0;
    for (uint32_t k = 0; k < axes; k++) {
        const real x = f->fraction[bundle->axis[k]];
        for (uint32_t i = 1u << k; i-- > 0;) {
            const real w = c->weight[i];
            const size_t o = c->offset[i];
            c->weight[2 * i] = w * (1.0 - x);
            c->weight[2 * i + 1] = w * x;
            c->offset[2 * i] = o;
            c->offset[2 * i + 1] = o + bundle->stride[k];
        }
    }
}

#define ADD_PAIRS(value, axes)                          \
    for (uint32_t n = 1u << (axes); n > 1; n /= 2) {    \
        for (uint32_t i = 0; i < n / 2; i++) {          \
            value[i] = value[2 * i] + value[2 * i + 1]; \
        }                                               \
    }

/* All lanes in one cell. */
__attribute__((always_inline)) static inline void interpolate_shared(const double *node,
                                                                     const bundle_t *bundle,
                                                                     uint32_t axes,
                                                                     const corners_t *c, real *to) {
    for (uint32_t t = 0; t < bundle->width; t++, node++) {
        real value[CORNERS];
        for (uint32_t i = 0; i < 1u << axes; i++) value[i] = c->weight[i] * node[c->offset[i]];
        ADD_PAIRS(value, axes)
        to[t] = value[0];
    }
}

/* Four tables of one lane. */
__attribute__((always_inline)) static inline four four_tables(const double *node, uint32_t axes,
                                                              const corners_t *c, int l) {
    four value[CORNERS];
    for (uint32_t i = 0; i < 1u << axes; i++) {
        value[i] = c->weight[i][l] * AT(node + c->offset[i]);
    }
    ADD_PAIRS(value, axes)
    return value[0];
}

/* From tables in each lane to lanes in each table. */
static inline void turn(const four from[4], four to[4]) {
    const four a = __builtin_shufflevector(from[0], from[1], 0, 4, 2, 6);
    const four b = __builtin_shufflevector(from[0], from[1], 1, 5, 3, 7);
    const four c = __builtin_shufflevector(from[2], from[3], 0, 4, 2, 6);
    const four d = __builtin_shufflevector(from[2], from[3], 1, 5, 3, 7);
    to[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
    to[1] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
    to[2] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
    to[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

__attribute__((always_inline)) static inline void interpolate_apart(const double *const node[LANES],
                                                                    const bundle_t *bundle,
                                                                    uint32_t axes,
                                                                    const corners_t *c, real *to) {
    for (int l = 0; l < LANES; l += 4) {
        for (uint32_t t = 0; t < bundle->width; t += 4) {
            four value[4], turned[4];
            for (int i = 0; i < 4; i++) value[i] = four_tables(node[l + i] + t, axes, c, l + i);
            turn(value, turned);
            for (uint32_t i = 0; i < 4 && t + i < bundle->width; i++) {
                PUT((double *)(to + t + i) + l) = turned[i];
            }
        }
    }
}

/* A table that is alone. */
__attribute__((always_inline)) static inline real interpolate_alone(const double *const node[LANES],
                                                                    uint32_t axes,
                                                                    const corners_t *c) {
    real value[CORNERS];
    for (uint32_t i = 0; i < 1u << axes; i++) {
        real corner = 0.0;
        for (int l = 0; l < LANES; l++) corner[l] = node[l][c->offset[i]];
        value[i] = c->weight[i] * corner;
    }
    ADD_PAIRS(value, axes)
    return value[0];
}

/* The compiler unrolls each number of axes. */
__attribute__((always_inline)) static inline void interpolate_lanes(const flight_t *f, uint32_t b,
                                                                    uint32_t axes) {
    const bundle_t *bundle = &f->model->bundle[b];
    real *to = f->slot + bundle->slot;
    const double *node[LANES];
    corners_t corners;
    find_weights(f, bundle, axes, &corners);
    for (int l = 0; l < LANES; l++) node[l] = f->lane[l]->model->node + f->lane[l]->corner[b];
    if (f->shared[b]) interpolate_shared(node[0], bundle, axes, &corners, to);
    else if (bundle->width == 1) *to = interpolate_alone(node, axes, &corners);
    else interpolate_apart(node, bundle, axes, &corners, to);
}

static void interpolate_bundle(const flight_t *f, uint32_t b) {
    const uint32_t axes = f->model->bundle[b].axes;
    if (axes == 0) interpolate_lanes(f, b, 0);
    else if (axes == 1) interpolate_lanes(f, b, 1);
    else if (axes == 2) interpolate_lanes(f, b, 2);
    else if (axes == 3) interpolate_lanes(f, b, 3);
    else interpolate_lanes(f, b, 4);
}

void look_up(flight_t *f, int stage) {
    const am_model *m = f->model;
    const uint32_t first = m->first_bundle[stage];
    const uint32_t end = m->first_bundle[stage + 1];
    if (first == end) return;
    locate_lanes(f, stage);
    for (uint32_t b = first; b < end; b++) interpolate_bundle(f, b);
    change_tables(f, stage);
}

#endif
