/* Multilinear interpolation in a cell of a bundle: the one formula of table.c and evaluate.c.
 *
 * A bundle is taken four tables at a time.  The last four go beyond its width: they read the
 * next node, or the SPILL doubles after the last one, and write up to SPILL values that nobody
 * reads. */
#ifndef AEROMATCH_INTERPOLATE_H
#define AEROMATCH_INTERPOLATE_H

#include "four.h"
#include "simulation.h"

/* Weights of the corners of a plane (the last two axes) that itself weighs w. */
static inline void weigh(double w, double f0, double f1, double to[4]) {
    const double low = w * (1.0 - f0);
    const double high = w * f0;
    to[0] = low * (1.0 - f1);
    to[1] = low * f1;
    to[2] = high * (1.0 - f1);
    to[3] = high * f1;
}

#define PLANE(VALUE, n, s0, s1, w)                        \
    ((((w)[0] * VALUE(n)) + ((w)[1] * VALUE((n) + (s1)))) \
     + (((w)[2] * VALUE((n) + (s0))) + ((w)[3] * VALUE((n) + (s0) + (s1)))))
#define ALONE(p) (*(p))

/* To all tables of a bundle: VALUE and WRITE are those of four tables, or of one that is alone. */
#define TABLES(VALUE, WRITE, step)                                                                 \
    for (uint32_t k = 0; k < width; k += step) {                                                   \
        const double *l = n + k, *h = l + s[0];                                                    \
        if (axes == 0) WRITE(to + k) = VALUE(l);                                                   \
        else if (axes == 1) WRITE(to + k) = (1.0 - f[0]) * VALUE(l) + f[0] * VALUE(h);             \
        else if (axes == 2) WRITE(to + k) = PLANE(VALUE, l, s[0], s[1], w[0]);                     \
        else if (axes == 3)                                                                        \
            WRITE(to + k) = PLANE(VALUE, l, s[1], s[2], w[0]) + PLANE(VALUE, h, s[1], s[2], w[1]); \
        else                                                                                       \
            WRITE(to + k) =                                                                        \
                (PLANE(VALUE, l, s[2], s[3], w[0]) + PLANE(VALUE, l + s[1], s[2], s[3], w[1]))     \
                + (PLANE(VALUE, h, s[2], s[3], w[2]) + PLANE(VALUE, h + s[1], s[2], s[3], w[3]));  \
    }

__attribute__((always_inline)) static inline void interpolate_over(uint32_t axes, uint32_t width,
                                                                   const bundle_t *bundle,
                                                                   const double *n,
                                                                   const double *fraction,
                                                                   size_t step, double *to) {
    const size_t *s = bundle->stride;
    double f[MAX_AXES], w[4][4];
    for (uint32_t k = 0; k < axes; k++) f[k] = fraction[bundle->axis[k] * step];
    if (axes == 2) weigh(1.0, f[0], f[1], w[0]);
    if (axes == 3) {
        weigh(1.0 - f[0], f[1], f[2], w[0]);
        weigh(f[0], f[1], f[2], w[1]);
    }
    if (axes == 4) {
        const double g0 = 1.0 - f[0];
        const double g1 = 1.0 - f[1];
        weigh(g0 * g1, f[2], f[3], w[0]);
        weigh(g0 * f[1], f[2], f[3], w[1]);
        weigh(f[0] * g1, f[2], f[3], w[2]);
        weigh(f[0] * f[1], f[2], f[3], w[3]);
    }
    if (width == 1) TABLES(ALONE, ALONE, 1)
    else TABLES(AT, PUT, 4)
}

/* The compiler unrolls each number of axes.  n: lower corner of the cell; the fraction on axis i of
 * the model stands at fraction[i * step]. */
__attribute__((always_inline)) static inline void interpolate(const bundle_t *bundle,
                                                              const double *n,
                                                              const double *fraction, size_t step,
                                                              double *to) {
    const uint32_t width = bundle->width;
    if (bundle->axes == 0) interpolate_over(0, width, bundle, n, fraction, step, to);
    else if (bundle->axes == 1) interpolate_over(1, width, bundle, n, fraction, step, to);
    else if (bundle->axes == 2) interpolate_over(2, width, bundle, n, fraction, step, to);
    else if (bundle->axes == 3) interpolate_over(3, width, bundle, n, fraction, step, to);
    else interpolate_over(4, width, bundle, n, fraction, step, to);
}

/* One way: its bundles that an axis of `changed` leads through, in the cells that look_up has
 * found. */
__attribute__((always_inline)) static inline void interpolate_way(uint32_t axes, bool alone,
                                                                  const bundle_t *from,
                                                                  const bundle_t *end, am_sim *sim,
                                                                  uint64_t changed) {
    const uint32_t *corner = sim->corner;
    const double *node = sim->model->node;
    const double *fraction = sim->fraction;
    double *slot = sim->slot;
    for (const bundle_t *b = from; b < end; b++) {
        if (!(b->marks & changed)) continue;
        interpolate_over(axes, alone ? 1 : b->width, b, node + corner[b->index], fraction, 1,
                         slot + b->slot);
    }
}

static inline void interpolate_stage(am_sim *sim, int stage, uint64_t changed) {
    const bundle_t *sorted = sim->model->sorted;
    const bundle_t *at = sorted + sim->model->first_bundle[stage];
    const bundle_t *last = sorted + sim->model->first_bundle[stage + 1];
    const uint32_t *end = sim->model->end_of_way[stage];
    while (at < last) {
        const uint32_t way = way_of(at);
        const bundle_t *next = sorted + end[way];
        switch (way) {
        case 0:
            interpolate_way(0, true, at, next, sim, changed);
            break;
        case 1:
            interpolate_way(0, false, at, next, sim, changed);
            break;
        case 2:
            interpolate_way(1, true, at, next, sim, changed);
            break;
        case 3:
            interpolate_way(1, false, at, next, sim, changed);
            break;
        case 4:
            interpolate_way(2, true, at, next, sim, changed);
            break;
        case 5:
            interpolate_way(2, false, at, next, sim, changed);
            break;
        case 6:
            interpolate_way(3, true, at, next, sim, changed);
            break;
        case 7:
            interpolate_way(3, false, at, next, sim, changed);
            break;
        case 8:
            interpolate_way(4, true, at, next, sim, changed);
            break;
        default:
            interpolate_way(4, false, at, next, sim, changed);
        }
        at = next;
    }
}

#endif
