/* Multilinear tables: each axis is located once, tables over the same axes lie side by side at
 * every node. */
#include "table.h"

#include "nodes.h"

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

/* Cells and fractions of the axes of a stage; true when a cell is another than before. */
static bool locate(am_sim *sim, uint32_t first, uint32_t end) {
    const axis_t *axes = sim->model->axis;
    const double *var = sim->var;
    uint32_t *cell = sim->cell;
    double *fraction = sim->fraction;
    bool moved = false;
    for (uint32_t i = first; i < end; i++) {
        double x = var[axes[i].variable];
        const cell_t *c = &axes[i].cell[cell[i]];
        if (!(x >= c[0].from && x < c[1].from)) {
            x = within_reach(x);
            const uint32_t found = find_cell(&axes[i], x);
            moved |= found != cell[i];
            cell[i] = found;
            c = &axes[i].cell[found];
        }
        fraction[i] = fraction_in(c, x);
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
    settle_cells(sim);
}

/* After the cells came from outside. */
void settle_cells(am_sim *sim) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < m->axes; i++) {
        if (sim->cell[i] >= m->axis[i].cells) sim->cell[i] = 0;
    }
    for (int stage = 0; stage < STAGES; stage++) find_corners(sim, stage);
}

void look_up(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    if (locate(sim, m->first_axis[stage], m->first_axis[stage + 1])) find_corners(sim, stage);
    m->versions.interpolate(sim, stage);
    if (sim->patches) apply_patches(sim, stage);
}
