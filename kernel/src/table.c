/* Multilinear tables: each axis is located once, tables over the same axes lie side by side at every node. */
#include "model.h"

#include <string.h>

/* Tables side by side are taken four at a time.  The last four of a bundle go beyond its width: they read the next node, or
 * the SPILL doubles after the last one, and write slots that the next bundle writes again or that are a gap between stages. */
typedef double four __attribute__((vector_size(32), aligned(8), may_alias));
#define AT(p) (*(const four *)(p))

/* The last cell that begins at or below x, whatever the present one is: a result must not depend on history.  NaN goes to the first. */
static uint32_t find_cell(const axis_t *axis, double x) {
    uint32_t low = 0;
    for (uint32_t n = axis->cells; n > 1;) {
        const uint32_t half = n / 2;
        low += x >= axis->cell[low + half].from ? half : 0;
        n -= half;
    }
    return low;
}

static double inside_range(double x) { return x > FARTHEST ? FARTHEST : x < -FARTHEST ? -FARTHEST : x; }

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
            x = inside_range(x);
            const uint32_t found = find_cell(&axes[i], x);
            moved |= found != cell[i];
            cell[i] = found, c = &axes[i].cell[found];
        }
        fraction[i] = c->start + (x - c->point) * c->per_step;
    }
    return moved;
}

/* First node of the present cell of every bundle of a stage. */
static void find_corners(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    for (uint32_t i = m->first_bundle[stage]; i < m->first_bundle[stage + 1]; i++) {
        const bundle_t *bundle = &m->bundle[i];
        size_t corner = bundle->first;
        for (uint32_t k = 0; k < bundle->axes; k++) corner += bundle->stride[k] * lower_node(&m->axis[bundle->axis[k]], sim->cell[bundle->axis[k]]);
        sim->corner[i] = (uint32_t)corner;
    }
}

/* After the cells came from outside, or at the start. */
void settle_cells(am_sim *sim) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < m->axes; i++)
        if (sim->cell[i] >= m->axis[i].cells) sim->cell[i] = 0;
    for (int stage = 0; stage < STAGES; stage++) find_corners(sim, stage);
}

/* Weights of the corners of a plane (the last two axes) that itself weighs w. */
static inline void weigh(double w, double f0, double f1, double to[4]) {
    const double low = w * (1.0 - f0), high = w * f0;
    to[0] = low * (1.0 - f1), to[1] = low * f1, to[2] = high * (1.0 - f1), to[3] = high * f1;
}

#define PLANE(n, s0, s1, w) \
    ((((w)[0] * AT(n)) + ((w)[1] * AT((n) + (s1)))) + (((w)[2] * AT((n) + (s0))) + ((w)[3] * AT((n) + (s0) + (s1)))))

static inline void interpolate(const bundle_t *bundle, const double *n, const double *fraction, double *slot) {
    const size_t *s = bundle->stride;
    const uint32_t *axis = bundle->axis, width = bundle->width;
    double w[4][4], *to = slot + bundle->slot;
    if (bundle->axes == 0) {
        memcpy(to, n, sizeof(double) * width);
        return;
    }
    const double f0 = fraction[axis[0]], g0 = 1.0 - f0;
    if (bundle->axes == 1) {
        for (uint32_t k = 0; k < width; k += 4) *(four *)(to + k) = g0 * AT(n + k) + f0 * AT(n + s[0] + k);
        return;
    }
    const double f1 = fraction[axis[1]];
    if (bundle->axes == 2) {
        weigh(1.0, f0, f1, w[0]);
        for (uint32_t k = 0; k < width; k += 4) *(four *)(to + k) = PLANE(n + k, s[0], s[1], w[0]);
        return;
    }
    const double f2 = fraction[axis[2]], *m = n + s[0];
    if (bundle->axes == 3) {
        weigh(g0, f1, f2, w[0]), weigh(f0, f1, f2, w[1]);
        for (uint32_t k = 0; k < width; k += 4) *(four *)(to + k) = PLANE(n + k, s[1], s[2], w[0]) + PLANE(m + k, s[1], s[2], w[1]);
        return;
    }
    const double f3 = fraction[axis[3]], g1 = 1.0 - f1;
    weigh(g0 * g1, f2, f3, w[0]), weigh(g0 * f1, f2, f3, w[1]), weigh(f0 * g1, f2, f3, w[2]), weigh(f0 * f1, f2, f3, w[3]);
    for (uint32_t k = 0; k < width; k += 4)
        *(four *)(to + k) = (PLANE(n + k, s[2], s[3], w[0]) + PLANE(n + s[1] + k, s[2], s[3], w[1])) +
                            (PLANE(m + k, s[2], s[3], w[2]) + PLANE(m + s[1] + k, s[2], s[3], w[3]));
}

void look_up(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    if (locate(sim, m->first_axis[stage], m->first_axis[stage + 1])) find_corners(sim, stage);
    const uint32_t *corner = sim->corner;
    const double *node = m->node, *fraction = sim->fraction;
    double *slot = sim->slot;
    for (uint32_t i = m->first_bundle[stage], end = m->first_bundle[stage + 1]; i < end; i++)
        interpolate(&m->bundle[i], node + corner[i], fraction, slot);
    if (sim->patches) apply_patches(sim, stage);
}
