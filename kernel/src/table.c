/* Multilinear tables: each axis is located once, tables over the same axes lie side by side at every node. */
#include "model.h"

#include <string.h>

/* Largest i with point[i] <= x, in 0 ... count - 2, whatever the hint: the result must not depend on history. */
static uint32_t cell_of(const axis_t *axis, double x, uint32_t hint) {
    const double *p = axis->point;
    if (hint + 1 < axis->count && x >= p[hint] && x < p[hint + 1]) return hint;
    uint32_t low = 0;
    for (uint32_t n = axis->count - 1; n > 1;) {
        const uint32_t half = n / 2;
        low += x >= p[low + half] ? half : 0;
        n -= half;
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

/* Along one axis; the loop runs over the tables of the bundle. */
static void line(double *restrict to, const double *restrict node, size_t stride, double f, uint32_t width) {
    const double *restrict next = node + stride;
    const double w0 = 1.0 - f;
    for (uint32_t k = 0; k < width; k++) to[k] = w0 * node[k] + f * next[k];
}

/* Over the four corners of the last two axes, weighed by w, put or added to the values. */
static void plane(double *restrict to, const double *restrict n0, const size_t stride[2], const double f[2], double w, uint32_t width,
                  bool add) {
    const double *restrict n1 = n0 + stride[1], *restrict n2 = n0 + stride[0], *restrict n3 = n2 + stride[1];
    const double low = w * (1.0 - f[0]), high = w * f[0];
    const double w0 = low * (1.0 - f[1]), w1 = low * f[1], w2 = high * (1.0 - f[1]), w3 = high * f[1];
    if (add)
        for (uint32_t k = 0; k < width; k++) to[k] += (w0 * n0[k] + w1 * n1[k]) + (w2 * n2[k] + w3 * n3[k]);
    else
        for (uint32_t k = 0; k < width; k++) to[k] = (w0 * n0[k] + w1 * n1[k]) + (w2 * n2[k] + w3 * n3[k]);
}

static void interpolate(am_sim *sim, const bundle_t *bundle) {
    const double *node = bundle->node;
    double f[MAX_AXES], *value = sim->slot + bundle->slot;
    const uint32_t axes = bundle->axes, outer = axes > 2 ? axes - 2 : 0;
    for (uint32_t k = 0; k < axes; k++) {
        f[k] = sim->fraction[bundle->axis[k]];
        node += bundle->stride[k] * sim->cell[bundle->axis[k]];
    }
    if (axes == 0) memcpy(value, node, sizeof(double) * bundle->width);
    else if (axes == 1) line(value, node, bundle->stride[0], f[0], bundle->width);
    else
        for (uint32_t corner = 0; corner < 1u << outer; corner++) {
            const double *at = node;
            double w = 1.0;
            for (uint32_t k = 0; k < outer; k++) {
                const bool far = corner >> k & 1;
                at += far ? bundle->stride[k] : 0;
                w *= far ? f[k] : 1.0 - f[k];
            }
            plane(value, at, bundle->stride + outer, f + outer, w, bundle->width, corner > 0);
        }
}

void look_up(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    for (uint32_t i = m->first_axis[stage]; i < m->first_axis[stage + 1]; i++) locate(sim, i);
    for (uint32_t i = m->first_bundle[stage]; i < m->first_bundle[stage + 1]; i++) interpolate(sim, &m->bundle[i]);
}
