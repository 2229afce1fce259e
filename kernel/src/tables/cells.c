/* The cells that the axes of multilinear tables stand in: each axis is located once, tables over
 * the same axes lie side by side at every node. */
#include "cells.h"

#include "nodes.h"

#include <math.h>

/* The last cell that begins at or below x, whatever the present one is: a result must not depend
 * on history.  NaN goes to the first. */
uint32_t find_cell(const axis_t *axis, double x) {
    uint32_t low = 0;
    for (uint32_t n = axis->cells; n > 1;) {
        const uint32_t half = n / 2;
        /* a move, not a branch */
        low = __builtin_unpredictable(x >= axis->cell[low + half].from) ? low + half : low;
        n -= half;
    }
    return low;
}

uint32_t move_bench(am_sim *sim, uint32_t bench, double x[4]) {
    const am_model *m = sim->model;
    stand_t *stand = &sim->stand[bench];
    uint32_t moved = 0;
    sim->end_cells = RECOUNT;
    for (int k = 0; k < 4; k++) {
        const uint32_t i = m->bench[bench].axis[k];
        if (i == UINT32_MAX) {
            stand->from[k] = -INFINITY;
            stand->to[k] = INFINITY;
            continue;
        }
        x[k] = within_reach(x[k]);
        const uint32_t found = find_cell(&m->axis[i], x[k]);
        const cell_t *c = &m->axis[i].cell[found];
        moved |= (uint32_t)(found != sim->cell[i]) << k;
        sim->cell[i] = found;
        stand->from[k] = c[0].from;
        stand->to[k] = c[1].from;
        stand->point[k] = c->point;
        stand->per_step[k] = c->per_step;
        stand->start[k] = c->start;
    }
    return moved;
}

void find_corners(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    for (uint32_t i = m->first_bundle[stage]; i < m->first_bundle[stage + 1]; i++) {
        const bundle_t *bundle = &m->bundle[i];
        size_t corner = bundle->first;
        for (uint32_t k = 0; k < bundle->axes; k++) {
            corner += bundle->stride[k]
                      * lower_node(&m->axis[bundle->axis[k]], sim->cell[bundle->axis[k]]);
        }
        sim->corner[i] = (uint32_t)corner;
    }
}

/* At the start of a run: within the range of every table, so that one that is never looked up is
 * not counted as left. */
void reset_cells(am_sim *sim) {
    for (uint32_t i = 0; i < sim->model->axes; i++) sim->cell[i] = 1;
    restore_cells(sim);
}

/* After the cells came from outside. */
void restore_cells(am_sim *sim) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < m->axes; i++) {
        if (sim->cell[i] >= m->axis[i].cells) sim->cell[i] = 0;
    }
    for (int stage = 0; stage < STAGES; stage++) find_corners(sim, stage);
    sim->unknown = ~0u;
    sim->end_cells = RECOUNT;
}
