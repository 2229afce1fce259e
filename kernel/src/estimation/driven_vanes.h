/* What vanes of a driven path see, and how they lag behind it, compiled like normal_sums.h. */
#ifndef AEROMATCH_DRIVEN_VANES_H
#define AEROMATCH_DRIVEN_VANES_H

#include "flight_axes.h"
#include "four.h"
#include "kernel.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum {
    PATH_ROWS = 7, /* attitude, velocity, height */
    DRIVEN_VANES = 2,
    DRIVEN_STATES = PATH_ROWS + DRIVEN_VANES,
    DRIVEN_WIDE = (DRIVEN_STATES + AM_LAG + 1 + 3) / 4
        * 4 /* start and every input, vectors of four */
};

/* The angle that a vane without lag would see, and its derivatives. */
typedef struct {
    double angle;
    double by[6];       /* by phi, theta, psi, velocity north, east, down */
    double by_rates[3]; /* by the body rates */
} sight_t;

/* What vane number `vane` sees of the air velocity U, in body axes. */
static void see(const am_drive *d, size_t k, int vane, const double level[3][3], const double U[3],
                sight_t *s) {
    const int across = d->side[vane];
    const double *arm = d->vane_arm[vane];
    double local[3], axes[3][3], turn[3], row[3] = {0.0};
    vector_product(d->path.rates + 3 * k, arm, local);
    for (int i = 0; i < 3; i++) local[i] += U[i];
    const double square = local[0] * local[0] + local[across] * local[across];
    s->angle = am_atan2(local[across], local[0]);
    row[0] = -local[across] / (square > 1.0 ? square : 1.0);
    row[across] = local[0] / (square > 1.0 ? square : 1.0);
    angle_axes(level, axes);
    for (int i = 0; i < 3; i++) {
        vector_product(U, axes[i], turn);
        s->by[i] = row[0] * turn[0] + row[1] * turn[1] + row[2] * turn[2];
    }
    matrix_times_vector(level, row, s->by + 3);
    vector_product(arm, row, s->by_rates);
}

static void see_all(const am_drive *d, size_t k, const double *x, const double level[3][3],
                    sight_t *sight) {
    double air[3], U[3];
    for (int i = 0; i < 3; i++) {
        air[i] = x[3 + i] - d->wind[i];
        if (d->gusts) air[i] -= x[PATH_ROWS + d->vanes + i];
    }
    level_to_body(level, air, U);
    for (int i = 0; i < d->vanes; i++) see(d, k, i, level, U, sight + i);
}

/* The derivative of what a vane sees by a constant, the path unchanged. */
static double by_constant(const am_drive *d, size_t k, const sight_t *s, int input) {
    const int i = input % AM_SCALE;
    if (input >= AM_WIND) return input < AM_LAG ? -s->by[3 + input - AM_WIND] : 0.0;
    if (i >= 3) return 0.0;
    return -s->by_rates[i] * d->gain[i]
           * (input >= AM_SCALE ? d->path.rates[3 * k + (size_t)i] : 1.0);
}

/* The change of the angles by start and constants, of `wide` columns, vectors of four. */
static void see_change(const am_drive *d, size_t k, const sight_t *sight, int wide,
                       double X[][DRIVEN_WIDE], double seen[][DRIVEN_WIDE]) {
    for (int vane = 0; vane < d->vanes; vane++) {
        const sight_t *s = sight + vane;
        double *to = seen[vane];
        for (int j = 0; j < wide; j += 4) {
            four sum = s->by[0] * AT(X[0] + j);
            for (int i = 1; i < 6; i++) sum += s->by[i] * AT(X[i] + j);
            PUT(to + j) = sum;
        }
        for (int j = 0; j < d->inputs; j++) to[d->states + j] += by_constant(d, k, s, d->input[j]);
    }
}

/* The vanes' states after a step; sight before and after it. */
static void lag_vanes(const am_drive *d, sight_t sight[2][DRIVEN_VANES], const double *x,
                      double *next) {
    const double *lag = d->lag;
    for (int i = 0; i < d->vanes; i++) {
        next[PATH_ROWS + i] = lag[0] * x[PATH_ROWS + i] + lag[1] * sight[0][i].angle
                              + lag[2] * sight[1][i].angle;
    }
}

/* The change of the vanes' states over the step behind sample k: of X, which are those after it
 * but for the vanes; seen: before, then after. */
static void change_vanes(const am_drive *d, size_t k, sight_t sight[2][DRIVEN_VANES],
                         const double *x, int wide, double X[][DRIVEN_WIDE],
                         double seen[][DRIVEN_WIDE]) {
    const double *lag = d->lag;
    const double *by = d->lag_slope;
    double before[DRIVEN_VANES][DRIVEN_WIDE];
    memcpy(before, seen, sizeof before);
    see_change(d, k + 1, sight[1], wide, X, seen);
    for (int i = 0; i < d->vanes; i++) {
        double *to = X[PATH_ROWS + i];
        for (int j = 0; j < wide; j += 4)
            PUT(to + j) = lag[0] * AT(to + j) + lag[1] * AT(before[i] + j)
                          + lag[2] * AT(seen[i] + j);
        for (int j = 0; j < d->inputs; j++) {
            if (d->input[j] != AM_LAG) continue;
            to[d->states + j] += by[0] * x[PATH_ROWS + i] + by[1] * sight[0][i].angle
                                 + by[2] * sight[1][i].angle;
        }
    }
}

#endif
