/* Vectors and matrices of three, and what else every unit needs of arithmetic. */
#ifndef AEROMATCH_ALGEBRA_H
#define AEROMATCH_ALGEBRA_H

#include "real.h"

/* x, or the limit it lies beyond. */
static inline real clamp(real x, real low, real high) {
    return PICK(x < low, low, PICK(x > high, high, x));
}

/* 1, -1, or 0 for zero and NaN. */
static inline real sign_of(real x) { return PICK(x > 0.0, 1.0, PICK(x < 0.0, -1.0, 0.0)); }

static inline real dot(const real a[3], const real b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross(const real a[3], const real b[3], real c[3]) {
    const real x = a[1] * b[2] - a[2] * b[1];
    const real y = a[2] * b[0] - a[0] * b[2];
    const real z = a[0] * b[1] - a[1] * b[0];
    c[0] = x;
    c[1] = y;
    c[2] = z;
}

/* b = C a and a = C^T b; C turns reference to body axes, the two vectors must not be the same */
static inline void to_body(const real C[3][3], const real a[3], real b[3]) {
    for (int i = 0; i < 3; i++) b[i] = dot(C[i], a);
}

static inline void from_body(const real C[3][3], const real b[3], real a[3]) {
    for (int i = 0; i < 3; i++) a[i] = C[0][i] * b[0] + C[1][i] * b[1] + C[2][i] * b[2];
}

#endif
