/* Multilinear interpolation in a cell of a bundle: the one formula of table.c and evaluate.c.
 *
 * A bundle is taken four tables at a time.  The last four go beyond its width: they read the next node, or the SPILL
 * doubles after the last one, and write up to SPILL values that nobody reads. */
#ifndef AEROMATCH_INTERPOLATE_H
#define AEROMATCH_INTERPOLATE_H

#include "four.h"
#include "model.h"

/* Weights of the corners of a plane (the last two axes) that itself weighs w. */
static inline void weigh(double w, double f0, double f1, double to[4]) {
    const double low = w * (1.0 - f0), high = w * f0;
    to[0] = low * (1.0 - f1), to[1] = low * f1, to[2] = high * (1.0 - f1), to[3] = high * f1;
}

#define PLANE(n, s0, s1, w) \
    ((((w)[0] * AT(n)) + ((w)[1] * AT((n) + (s1)))) + (((w)[2] * AT((n) + (s0))) + ((w)[3] * AT((n) + (s0) + (s1)))))

/* n: lower corner of the cell; the fraction on axis i of the model stands at fraction[i * step]. */
__attribute__((always_inline)) static inline void interpolate(const bundle_t *bundle, const double *n, const double *fraction, size_t step, double *to) {
    const size_t *s = bundle->stride;
    const uint32_t *axis = bundle->axis, width = bundle->width;
    double w[4][4];
    if (bundle->axes == 0) {
        for (uint32_t k = 0; k < width; k += 4) PUT(to + k) = AT(n + k);
        return;
    }
    const double f0 = fraction[axis[0] * step], g0 = 1.0 - f0;
    if (bundle->axes == 1) {
        for (uint32_t k = 0; k < width; k += 4) PUT(to + k) = g0 * AT(n + k) + f0 * AT(n + s[0] + k);
        return;
    }
    const double f1 = fraction[axis[1] * step];
    if (bundle->axes == 2) {
        weigh(1.0, f0, f1, w[0]);
        for (uint32_t k = 0; k < width; k += 4) PUT(to + k) = PLANE(n + k, s[0], s[1], w[0]);
        return;
    }
    const double f2 = fraction[axis[2] * step], *m = n + s[0];
    if (bundle->axes == 3) {
        weigh(g0, f1, f2, w[0]), weigh(f0, f1, f2, w[1]);
        for (uint32_t k = 0; k < width; k += 4) PUT(to + k) = PLANE(n + k, s[1], s[2], w[0]) + PLANE(m + k, s[1], s[2], w[1]);
        return;
    }
    const double f3 = fraction[axis[3] * step], g1 = 1.0 - f1;
    weigh(g0 * g1, f2, f3, w[0]), weigh(g0 * f1, f2, f3, w[1]), weigh(f0 * g1, f2, f3, w[2]), weigh(f0 * f1, f2, f3, w[3]);
    for (uint32_t k = 0; k < width; k += 4)
        PUT(to + k) = (PLANE(n + k, s[2], s[3], w[0]) + PLANE(n + s[1] + k, s[2], s[3], w[1])) +
                      (PLANE(m + k, s[2], s[3], w[2]) + PLANE(m + s[1] + k, s[2], s[3], w[3]));
}

/* All bundles of a stage, in the cells that look_up has found. */
static inline void interpolate_stage(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    const uint32_t *corner = sim->corner;
    const double *node = m->node, *fraction = sim->fraction;
    double *slot = sim->slot;
    for (uint32_t i = m->first_bundle[stage], end = m->first_bundle[stage + 1]; i < end; i++)
        interpolate(&m->bundle[i], node + corner[i], fraction, 1, slot + m->bundle[i].slot);
}

#endif
