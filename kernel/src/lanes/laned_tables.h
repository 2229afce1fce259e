/* Look-up of the tables of a stage for all lanes: axes are searched only in lanes that have left
 * their cell; the tables of a bundle lie side by side, so that each lane interpolates several at
 * once (interpolate.h), and the results are turned into lanes. */
#ifndef AEROMATCH_LANED_TABLES_H
#define AEROMATCH_LANED_TABLES_H

#include "interpolate.h"
#include "laned.h"
#include "nodes.h"
#include "table.h"

/* As locate of table.c for one lane: the cell that holds x, which comes within reach. */
static bool settle(flight_t *f, uint32_t i, int l, real *x) {
    const axis_t *axis = &f->lane[l]->model->axis[i];
    cells_r *at = &f->cells[i];
    uint32_t *cell = &f->lane[l]->cell[i];
    (*x)[l] = within_reach((*x)[l]);
    const uint32_t found = find_cell(axis, (*x)[l]);
    const bool moved = found != *cell;
    const cell_t *c = &axis->cell[found];
    *cell = found;
    at->from[l] = c[0].from;
    at->to[l] = c[1].from;
    at->point[l] = c->point;
    at->per_step[l] = c->per_step;
    at->start[l] = c->start;
    return moved;
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
            if (!in[l] && settle(f, i, l, &x)) any = moved[l] = true;
        }
        f->fraction[i] = c->start + (x - c->point) * c->per_step;
    }
    for (int l = 0; l < LANES && any; l++) {
        if (moved[l]) find_corners(f->lane[l], stage);
    }
}

static void change_tables(flight_t *f, int stage, int l) {
    am_sim *sim = f->lane[l];
    if (!sim->patches) return;
    give(f->fraction, f->model->axes, l, sim->fraction);
    apply_patches(sim, stage);
}

void look_up(flight_t *f, int stage) {
    const am_model *m = f->model;
    const uint32_t first = m->first_bundle[stage];
    const uint32_t end = m->first_bundle[stage + 1];
    if (first == end) return;
    locate_lanes(f, stage);
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        const double *node = sim->model->node;
        for (uint32_t b = first; b < end; b++) {
            interpolate(&m->bundle[b], node + sim->corner[b], (const double *)f->fraction + l,
                        LANES, sim->slot + m->bundle[b].slot);
        }
        change_tables(f, stage, l);
    }
    const uint32_t last = m->bundle[end - 1].slot + m->bundle[end - 1].width;
    const double *from[LANES];
    for (int l = 0; l < LANES; l++) from[l] = f->lane[l]->slot;
    for (uint32_t s = m->bundle[first].slot; s < last; s++) {
        real value = 0.0;
        for (int l = 0; l < LANES; l++) value[l] = from[l][s];
        f->slot[s] = value;
    }
}

#endif
