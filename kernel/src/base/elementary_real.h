/* The elementary functions of as many numbers as there are lanes. */
#ifndef AEROMATCH_ELEMENTARY_REAL_H
#define AEROMATCH_ELEMENTARY_REAL_H

#include "elementary.h"
#include "series.h"

#if LANES > 1

/* The functions of elementary.h, lane by lane where one of them is out of the ordinary. */
static inline real laned_atan2(real y, real x) {
    const real a = size_of(y);
    const real b = size_of(x);
    const mask_t steep = a > b;
    const real n = PICK(steep, b, a);
    const real d = PICK(steep, a, b);
    const mask_t plain = ((n >= 0x1p-500) | (n == 0.0)) & (d >= 0x1p-500) & (d <= 0x1p500);
    if (EVERY(plain)) return angle_of(n, d, steep, y, x);
    real to = 0.0;
    for (int i = 0; i < LANES; i++) to[i] = am_atan2(y[i], x[i]);
    return to;
}

static inline real laned_exp(real x) {
    if (EVERY(size_of(x) < 700.0)) {
        whole_t e;
        const real value = exponential_parts(x, (real)0.0, &e);
        return value * powers_of_two(e);
    }
    real to = 0.0;
    for (int i = 0; i < LANES; i++) to[i] = am_exp(x[i]);
    return to;
}

static inline real laned_log(real x) {
    if (EVERY((x >= 0x1p-1000) & (x < INFINITY))) return logarithm_of(x, (whole_t){0}).high;
    real to = 0.0;
    for (int i = 0; i < LANES; i++) to[i] = am_log(x[i]);
    return to;
}

static inline real laned_pow(real x, real y) {
    if (EVERY((x >= 0x1p-1000) & (x < INFINITY) & (size_of(y) < 1e6) & (y != 0.0))) {
        const pair_t l = logarithm_of(x, (whole_t){0});
        if (EVERY(size_of(l.high * y) < 700.0)) {
            whole_t e;
            const pair_t p = product(l.high, y);
            const real value = exponential_parts(p.high, p.low + l.low * y, &e);
            return value * powers_of_two(e);
        }
    }
    real to = 0.0;
    for (int i = 0; i < LANES; i++) to[i] = am_pow(x[i], y[i]);
    return to;
}

static inline void laned_sincos(real x, real *sine, real *cosine) {
    for (int i = 0; i < LANES; i++) {
        double s, c;
        am_sincos(x[i], &s, &c);
        (*sine)[i] = s;
        (*cosine)[i] = c;
    }
}

#define SINCOS laned_sincos
#define ATAN2 laned_atan2
#define EXP laned_exp
#define LOG laned_log
#define POW laned_pow

#else

#define SINCOS am_sincos
#define ATAN2 am_atan2
#define EXP am_exp
#define LOG am_log
#define POW am_pow

#endif

#endif
