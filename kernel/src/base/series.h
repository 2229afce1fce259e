/* Arctangent, exponential and logarithm of as many numbers as there are lanes: the one formula of
 * elementary.c and elementary_real.h.
 *
 * A number that needs more than 53 bits is a pair: high + low, |low| <= ulp(high) / 2.  Taylor
 * coefficients throughout: the tables and reductions make the intervals short enough. */
#ifndef AEROMATCH_SERIES_H
#define AEROMATCH_SERIES_H

#include "elementary_tables.h"
#include "real.h"

typedef struct {
    real high, low;
} pair_t;

typedef struct {
    double high, low;
} constant_t;

/* adding and subtracting it rounds to an integer, |x| < 2^51 */
static const double TO_INTEGER = 0x1.8p52;
static const constant_t PI = {0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53};
/* high: multiple of 2^-42 */
static const constant_t LN2 = {0x1.62e42fefa3800p-1, 0x1.ef35793c76730p-45};

/* The leading 26 bits: products of two such numbers are exact. */
static inline real leading(real x) { return of_words(words_of(x) & ~(int64_t)0x7ffffff); }

/* a + b exactly; |a| >= |b| or a = 0 */
static inline pair_t sum(real a, real b) {
    const real s = a + b;
    return (pair_t){s, b - (s - a)};
}

/* a b exactly (Dekker 1971), unless a part of it underflows */
static inline pair_t product(real a, real b) {
    const real p = a * b;
    const real a1 = leading(a);
    const real a2 = a - a1;
    const real b1 = leading(b);
    const real b2 = b - b1;
    return (pair_t){p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2};
}

/* atan(n / d) for 0 <= n <= d, d normal and far from overflow: Taylor series about the nearest j
 * / 64, about 0 below 1/16. */
static inline pair_t arctangent(real n, real d) {
    const real t = n / d;
    const real inverse = 1.0 / d;
    const pair_t back = product(t, d);
    const real low = ((n - back.high) - back.low) * inverse; /* n / d = t + low */
    const mask_t small = t < 0x1p-4;
    pair_t near = {0.0, 0.0};
    if (ANY(small)) {
        const real z = t * t;
        const real z2 = z * z;
        const real a = 0x1.999999999999ap-3 - z * 0x1.2492492492492p-3;
        const real b = 0x1.c71c71c71c71cp-4 - z * 0x1.745d1745d1746p-4;
        /* 1/5 1/7, 1/9 1/11, 1/13 1/15 */
        const real c = 0x1.3b13b13b13b14p-4 - z * 0x1.1111111111111p-4;
        near = (pair_t){t, low - z * t * (0x1.5555555555555p-2 - z * (a + z2 * (b + z2 * c)))};
        if (EVERY(small)) return near;
    }
    const whole_t j = WHOLE(t * 64.0 + 0.5);
    const double *row = ARCTANGENT[0];
    const whole_t at = j * (int64_t)(sizeof ARCTANGENT[0] / sizeof(double));
    const real h = t - REAL(j) * 0x1p-6;
    const real h2 = h * h;
    const real second = (gather(row + 3, at) + h * gather(row + 4, at))
                        + h2
                              * ((gather(row + 5, at) + h * gather(row + 6, at))
                                 + h2
                                       * ((gather(row + 7, at) + h * gather(row + 8, at))
                                          + h2 * gather(row + 9, at)));
    const real high = gather(row, at);
    const real rest = gather(row + 1, at) + ((h + low) * gather(row + 2, at) + h2 * second);
    return (pair_t){PICK(small, near.high, high), PICK(small, near.low, rest)};
}

/* part of pi less an angle below it */
static inline pair_t rest_of(real part, pair_t angle) {
    const pair_t s = sum(part * PI.high, -angle.high);
    return (pair_t){s.high, s.low + (part * PI.low - angle.low)};
}

/* atan2 of y and x from n / d, the smaller of their sizes over the larger; steep: |y| > |x|. */
static inline real angle_of(real n, real d, mask_t steep, real y, real x) {
    pair_t angle = arctangent(n, d);
    if (ANY(steep)) {
        const pair_t rest = rest_of(0.5, angle);
        angle = (pair_t){PICK(steep, rest.high, angle.high), PICK(steep, rest.low, angle.low)};
    }
    const mask_t left = x < 0.0;
    if (ANY(left)) {
        const pair_t rest = rest_of(1.0, angle);
        angle = (pair_t){PICK(left, rest.high, angle.high), PICK(left, rest.low, angle.low)};
    }
    return with_sign(angle.high + angle.low, y);
}

/* e^(high + low) = value 2^e, |high| < 746 */
static inline real exponential_parts(real high, real low, whole_t *e) {
    const real n = (high * 0x1.71547652b82fep+6 + TO_INTEGER) - TO_INTEGER; /* of ln 2 / 64 */
    const whole_t k = WHOLE(n);
    *e = k >> 6;
    const real r = ((high - n * 0x1.62e42fefa0000p-7) - n * 0x1.cf79abc9e3b3ap-46) + low;
    const real r2 = r * r;
    /* 1/4! 1/5! 1/6! */
    const real fourth = 0x1.5555555555555p-5 + r * 0x1.1111111111111p-7
                        + r2 * 0x1.6c16c16c16c17p-10;
    const real more = r + r2 * ((0.5 + r * 0x1.5555555555555p-3) + r2 * fourth);
    const whole_t at = (k & 63) * 2;
    const real two = gather(POWER_OF_TWO[0], at);
    return two + (gather(POWER_OF_TWO[0] + 1, at) + two * more);
}

/* 2^e, -1022 ... 1023 */
static inline real powers_of_two(whole_t e) { return of_words((e + 1023) << 52); }

/* of a positive finite number times 2^e, not subnormal */
static inline pair_t logarithm_of(real x, whole_t e) {
    const whole_t bits = words_of(x);
    const whole_t j = ((bits >> 44 & 0xff) + 1) >> 1;
    const whole_t half = ONE_WHERE(j >= 54);
    e += (bits >> 52) - 1023 + half;
    const real m = of_words((bits & 0xfffffffffffff) | (1023 - half) << 52);
    const real m1 = leading(m);
    const whole_t at = j * 3;
    const real c = gather(LOGARITHM[0], at);
    const real n = REAL(e);
    /* m / c = 1 + r exactly; log x = e log 2 + log c + r - r^2 / 2 + ... */
    const pair_t r = sum(m1 * c - 1.0, (m - m1) * c);
    const pair_t r2 = product(r.high, r.high);
    const real h = r.high;
    const real h2 = r2.high;
    const real third =
        (0x1.5555555555555p-2 - h * 0.25)
        + h2
              * ((0x1.999999999999ap-3 - h * 0x1.5555555555555p-3)
                 + h2 * ((0x1.2492492492492p-3 - h * 0.125) + h2 * 0x1.c71c71c71c71cp-4));
    const pair_t s = sum(n * LN2.high + gather(LOGARITHM[0] + 1, at), h);
    const pair_t t = sum(s.high, -0.5 * h2);
    const real rest = (n * LN2.low + gather(LOGARITHM[0] + 2, at))
                      + ((r.low - h * r.low) - 0.5 * r2.low) + (s.low + t.low) + h * h2 * third;
    return sum(t.high, rest);
}

#endif
