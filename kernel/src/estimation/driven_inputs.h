/* Gyros and accelerometers that drive a path, compiled like normal_sums.h. */
#ifndef AEROMATCH_DRIVEN_INPUTS_H
#define AEROMATCH_DRIVEN_INPUTS_H

#include "flight_axes.h"
#include "kernel.h"

#include <stdbool.h>
#include <stddef.h>

/* dt^2 times the second derivative in the middle of the step between b and c, from the samples of
 * the window alone. */
static double bend(bool first, bool last, double a, double b, double c, double d) {
    const double before = (c - b) - (b - a);
    const double after = (d - c) - (c - b);
    if (first) return last ? 0.0 : after;
    return last ? before : (before + after) / 2.0;
}

/* The change of rates and specific force, in body axes, by the constant `input` of the inertial
 * unit at a sample. */
static void by_input(const am_drive *d, size_t k, int input, double rates[3], double force[3]) {
    const bool scaled = input >= AM_SCALE;
    const int i = scaled ? input - AM_SCALE : input;
    const double *omega = d->path.rates + 3 * k;
    double lever[3], across[3], axis[3] = {0.0};
    for (int j = 0; j < 3; j++) rates[j] = force[j] = 0.0;
    if (i >= 3) {
        force[i - 3] = -d->gain[i] * (scaled ? d->sensed[3 * k + (size_t)i - 3] : 1.0);
        return;
    }
    rates[i] = -d->gain[i] * (scaled ? omega[i] : 1.0);
    axis[i] = rates[i]; /* of omega x (omega x arm), which is taken off */
    vector_product(omega, d->arm, lever);
    vector_product(lever, axis, force);
    vector_product(d->arm, axis, lever);
    vector_product(omega, lever, across);
    for (int j = 0; j < 3; j++) force[j] += across[j];
}

#endif
