/* Multilinear tables: each axis is located once, tables over the same axes lie side by side at every node. */
#include "model.h"

/* Largest i with point[i] <= x, in 0 ... count - 2, whatever the hint: the result must not depend on history. */
static uint32_t cell_of(const axis_t *axis, double x, uint32_t hint) {
    const double *p = axis->point;
    if (hint + 1 < axis->count && x >= p[hint] && x < p[hint + 1]) return hint;
    uint32_t low = 0, high = axis->count - 1;
    while (high - low > 1) {
        const uint32_t middle = (low + high) / 2;
        if (x >= p[middle]) low = middle;
        else high = middle;
    }
    return low;
}

static void locate(am_sim *sim, uint32_t i) {
    const axis_t *axis = &sim->model->axis[i];
    const double x = sim->var[axis->variable], *p = axis->point;
    sim->outside[i] = (int8_t)((x > p[axis->count - 1]) - (x < p[0]));
    if (axis->count == 1) {
        sim->cell[i] = 0, sim->fraction[i] = 0.0;
        return;
    }
    const uint32_t cell = cell_of(axis, x, sim->cell[i]);
    double f = (x - p[cell]) / (p[cell + 1] - p[cell]);
    if (!axis->linear) f = f < 0.0 ? 0.0 : f > 1.0 ? 1.0 : f;
    sim->cell[i] = cell;
    sim->fraction[i] = f;
}

static void interpolate(am_sim *sim, const bundle_t *bundle) {
    const double *node[1 << MAX_AXES] = {bundle->node};
    double weight[1 << MAX_AXES] = {1.0};
    uint32_t corners = 1;
    for (uint32_t k = 0; k < bundle->axes; k++) {
        const uint32_t axis = bundle->axis[k];
        const size_t stride = bundle->stride[k];
        const double f = sim->fraction[axis];
        for (uint32_t c = 0; c < corners; c++) {
            node[c] += stride * sim->cell[axis];
            node[corners + c] = node[c] + stride;
            weight[corners + c] = weight[c] * f;
            weight[c] *= 1.0 - f;
        }
        corners *= 2;
    }
    double *value = sim->slot + bundle->slot;
    uint32_t k = 0;
    for (; k + 4 <= bundle->width; k += 4) {
        double a[4] = {0.0, 0.0, 0.0, 0.0};
        for (uint32_t c = 0; c < corners; c++)
            for (int lane = 0; lane < 4; lane++) a[lane] += weight[c] * node[c][k + (uint32_t)lane];
        for (int lane = 0; lane < 4; lane++) value[k + (uint32_t)lane] = a[lane];
    }
    for (; k < bundle->width; k++) {
        double a = 0.0;
        for (uint32_t c = 0; c < corners; c++) a += weight[c] * node[c][k];
        value[k] = a;
    }
}

void look_up(am_sim *sim, int group) {
    const am_model *m = sim->model;
    for (uint32_t i = m->first_axis[group]; i < m->first_axis[group + 1]; i++) locate(sim, i);
    for (uint32_t i = m->first_bundle[group]; i < m->first_bundle[group + 1]; i++) interpolate(sim, &m->bundle[i]);
}
