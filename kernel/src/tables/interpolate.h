/* Multilinear interpolation in a cell of a bundle: the one formula of flights (locate.h) and of
 * many rows (block.h).
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

/* ---- packets of a flight --------------------------------------------------------------------- */

/* The same operations in the same order: a corner weighs the product over the axes, first axis
 * first, and the corners are added in pairs. */
#define CORNERS (1 << MAX_AXES)

__attribute__((always_inline)) static inline void weigh_corners(uint32_t axes, const four *f,
                                                                four *w) {
    w[0] = (four){1.0, 1.0, 1.0, 1.0};
    for (uint32_t k = 0; k < axes; k++) {
        for (uint32_t i = 1u << k; i-- > 0;) {
            const four whole = w[i];
            w[2 * i] = whole * (1.0 - f[k]);
            w[2 * i + 1] = whole * f[k];
        }
    }
}

__attribute__((always_inline)) static inline four add_corners(uint32_t axes, const four *w,
                                                              const double *corner) {
    four value[CORNERS];
    if (axes == 0) return AT(corner);
    for (uint32_t i = 0; i < 1u << axes; i++) value[i] = w[i] * AT(corner + 4 * i);
    for (uint32_t n = 1u << axes; n > 1; n /= 2) {
        for (uint32_t i = 0; i < n / 2; i++) value[i] = value[2 * i] + value[2 * i + 1];
    }
    return value[0];
}

/* Packets of one way that an axis of `changed` leads through. */
__attribute__((always_inline)) static inline void interpolate_way(am_sim *sim, int stage,
                                                                  uint32_t axes, bool mixed,
                                                                  uint64_t changed) {
    const am_model *m = sim->model;
    const uint32_t *first = m->first_packet + (uint32_t)stage * WAYS + 2 * axes + !mixed;
    const double *fraction = sim->fraction;
    double *slot = sim->slot;
    for (uint32_t i = first[0], end = first[1]; i < end; i++) {
        const packet_t *packet = &m->packet[i];
        const double *corner = sim->packed + packet->corner;
        four f[MAX_AXES], w[CORNERS];
        if (!(sim->wake[i] & changed)) continue;
        for (uint32_t k = 0; k < axes; k++) {
            const uint32_t *at = packet->fraction[k];
            if (mixed) {
                f[k] = (four){fraction[at[0]], fraction[at[1]], fraction[at[2]], fraction[at[3]]};
            } else {
                const double one = fraction[at[0]];
                f[k] = (four){one, one, one, one};
            }
        }
        weigh_corners(axes, f, w);
        if (mixed) {
            const four value = add_corners(axes, w, corner);
            for (int t = 0; t < 4; t++) slot[packet->slot[t]] = value[t];
            continue;
        }
        double *to = slot + packet->slot[0];
        for (const double *last = corner + packet->vectors * (4ull << axes); corner < last;
             corner += 4ull << axes, to += 4) {
            PUT(to) = add_corners(axes, w, corner);
        }
    }
}

static inline void interpolate_stage(am_sim *sim, int stage, uint64_t changed) {
    if (changed & ALL_AXES) interpolate_way(sim, stage, 0, false, changed);
    interpolate_way(sim, stage, 1, true, changed);
    interpolate_way(sim, stage, 1, false, changed);
    interpolate_way(sim, stage, 2, true, changed);
    interpolate_way(sim, stage, 2, false, changed);
    interpolate_way(sim, stage, 3, true, changed);
    interpolate_way(sim, stage, 3, false, changed);
    interpolate_way(sim, stage, 4, true, changed);
    interpolate_way(sim, stage, 4, false, changed);
}

#endif
