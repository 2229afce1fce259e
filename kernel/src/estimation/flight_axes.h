/* Axes of a flight path and products of three, compiled like normal_sums.h. */
#ifndef AEROMATCH_FLIGHT_AXES_H
#define AEROMATCH_FLIGHT_AXES_H

#include "elementary.h"

#include <math.h>
#include <string.h>

static void matrix_times_vector(const double matrix[3][3], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = matrix[i][0] * v[0] + matrix[i][1] * v[1] + matrix[i][2] * v[2];
    }
}

static void vector_product(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Level axes from body axes. */
static void level_axes(const double *x, double out[3][3]) {
    double sf, cf, st, ct, sp, cp;
    am_sincos(x[0], &sf, &cf);
    am_sincos(x[1], &st, &ct);
    am_sincos(x[2], &sp, &cp);
    const double rows[3][3] = {
        {ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp},
        {ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp},
        {-st, sf * ct, cf * ct},
    };
    memcpy(out, rows, sizeof rows);
}

/* Vectors of level axes, seen in body axes. */
static void level_to_body(const double level[3][3], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = level[0][i] * v[0] + level[1][i] * v[1] + level[2][i] * v[2];
    }
}

/* The axes of phi and theta in body axes; that of psi is the last row of `level`. */
static void angle_axes(const double level[3][3], double out[3][3]) {
    const double ct = sqrt(level[2][1] * level[2][1] + level[2][2] * level[2][2]);
    const double rows[3][3] = {{1.0, 0.0, 0.0},
                               {0.0, level[2][2] / ct, -level[2][1] / ct},
                               {level[2][0], level[2][1], level[2][2]}};
    memcpy(out, rows, sizeof rows);
}

#endif
