/* The path that gyros and accelerometers drive from its start (am_follow), compiled like
 * normal_sums.h.
 *
 * In level axes attitudes are products of the turns between samples, velocity and height are sums
 * over them.  A small change of attitude, written as a turn delta about the level axes, obeys
 *
 *     delta' = -R (change of rates), v' = delta x R a + R (change of a), h' = -v_down
 *
 * Rates and accelerations are cubics between samples; attitude takes the fourth-order Magnus step,
 * velocity Simpson's rule over it, height and sensitivities the trapezoidal rule. */
#ifndef AEROMATCH_DRIVEN_PATH_H
#define AEROMATCH_DRIVEN_PATH_H

#include "driven_inputs.h"
#include "driven_vanes.h"
#include "flight_axes.h"
#include "four.h"
#include "kernel.h"

#include <math.h>

/* What drives the path at one sample. */
typedef struct {
    double rates[3]; /* against level axes, in body axes */
    double force[3];
    double pull[3]; /* gravity and Coriolis acceleration, level axes */
} drive_t;

/* The path at one sample. */
typedef struct {
    double turned[4]; /* quaternion of the turn since the start */
    double first[3][3];
    double level[3][3]; /* level axes from body axes */
    double gain[3];     /* specific force in level axes */
} place_t;

/* The derivatives at one sample by start and constants. */
typedef struct {
    int wide;
    double delta[3][DRIVEN_WIDE]; /* turn about the level axes */
    double slope[3][DRIVEN_WIDE]; /* acceleration */
    double X[DRIVEN_STATES][DRIVEN_WIDE];
    double seen[DRIVEN_VANES][DRIVEN_WIDE]; /* angles at the vanes */
} change_t;

static void find_drive(const am_drive *d, size_t k, drive_t *out) {
    const am_path *path = &d->path;
    const double *x = path->x + k * d->states;
    double level[3][3], carried[3], turning[3];
    level_axes(x, level);
    matrix_times_vector(path->transport, x + 3, carried);
    for (int i = 0; i < 3; i++) turning[i] = 2.0 * path->spin[i] + carried[i];
    vector_product(x + 3, turning, out->pull);
    out->pull[2] += path->gravity - path->fall * (x[6] - path->level);
    for (int i = 0; i < 3; i++) {
        double turn = 0.0;
        for (int j = 0; j < 3; j++) turn += level[j][i] * (carried[j] + path->sensed[j]);
        out->rates[i] = path->rates[3 * k + (size_t)i] - turn;
        out->force[i] = path->force[3 * k + (size_t)i];
    }
}

static void quaternion(const double turn[3], double q[4]) {
    double sine;
    const double angle = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    am_sincos(angle / 2.0, &sine, q);
    const double part = angle > 0.0 ? sine / angle : 0.5;
    for (int i = 0; i < 3; i++) q[1 + i] = part * turn[i];
}

/* a = a b, of unit length */
static void turn_on(double a[4], const double b[4]) {
    const double c[4] = {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                         a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                         a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                         a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
    const double size = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2] + c[3] * c[3]);
    for (int i = 0; i < 4; i++) a[i] = c[i] / size;
}

static void matrix_of(const double q[4], double out[3][3]) {
    const double s = q[0];
    const double a = q[1];
    const double b = q[2];
    const double c = q[3];
    const double rows[3][3] = {
        {1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - s * c), 2.0 * (a * c + s * b)},
        {2.0 * (a * b + s * c), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - s * a)},
        {2.0 * (a * c - s * b), 2.0 * (b * c + s * a), 1.0 - 2.0 * (a * a + b * b)},
    };
    memcpy(out, rows, sizeof rows);
}

static void matrix_product(const double a[3][3], const double b[3][3], double out[3][3]) {
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
    }
}

/* phi, theta, psi of the axes; psi within half a turn of `heading`. */
static void find_angles(const double level[3][3], double heading, double x[3]) {
    const double turn = 6.283185307179586;
    const double sine = -level[2][0];
    x[0] = am_atan2(level[2][1], level[2][2]);
    x[1] = am_asin(sine > 1.0 ? 1.0 : sine < -1.0 ? -1.0 : sine);
    x[2] = am_atan2(level[1][0], level[0][0]);
    x[2] += turn * floor((heading - x[2]) / turn + 0.5);
}

/* From the second of four samples to the third: states x to next, and the turn. */
static void follow_step(double dt, bool first, bool last, const drive_t a[4], place_t *p,
                        const double *x, double *next, double turn[3]) {
    double half[3], halfway[3], middle[3], rotation[3][3], q[4];
    vector_product(a[1].rates, a[2].rates, turn);
    for (int i = 0; i < 3; i++) {
        const double w = a[1].rates[i];
        const double v = a[2].rates[i];
        const double curve = bend(first, last, a[0].rates[i], w, v, a[3].rates[i]);
        const double rise = bend(first, last, a[0].force[i], a[1].force[i], a[2].force[i],
                                 a[3].force[i]);
        turn[i] = dt * ((w + v) / 2.0 - curve / 12.0) + dt * dt / 12.0 * turn[i];
        half[i] = turn[i] / 2.0 - dt / 8.0 * (v - w);
        halfway[i] = (a[1].force[i] + a[2].force[i]) / 2.0 - rise / 8.0;
    }
    quaternion(half, q);
    matrix_of(q, rotation);
    matrix_times_vector(rotation, halfway, middle);
    matrix_times_vector(p->level, middle, halfway);
    quaternion(turn, q);
    turn_on(p->turned, q);
    matrix_of(p->turned, rotation);
    matrix_product(p->first, rotation, p->level);
    matrix_times_vector(p->level, a[2].force, middle);
    for (int i = 0; i < 3; i++) {
        next[3 + i] = x[3 + i] + dt / 6.0 * (p->gain[i] + 4.0 * halfway[i] + middle[i])
                      + dt / 2.0 * (a[1].pull[i] + a[2].pull[i]);
        p->gain[i] = middle[i];
    }
    next[6] = x[6] - dt / 2.0 * (x[5] + next[5]);
    find_angles(p->level, x[2], next);
}

/* W^-1 R', W of the rates of the angles: what small turns about the level axes do to the angles. */
static void angle_changes(const double level[3][3], double by[3][3]) {
    const double ct = sqrt(level[2][1] * level[2][1] + level[2][2] * level[2][2]);
    const double sf = level[2][1] / ct;
    const double cf = level[2][2] / ct;
    for (int j = 0; j < 3; j++) {
        by[2][j] = (sf * level[j][1] + cf * level[j][2]) / ct;
        by[1][j] = cf * level[j][1] - sf * level[j][2];
        by[0][j] = level[j][0] - level[2][0] * by[2][j];
    }
}

static void change_attitude(const double level[3][3], change_t *c) {
    double by[3][3];
    angle_changes(level, by);
    for (int j = 0; j < c->wide; j += 4) {
        const four x = AT(c->delta[0] + j);
        const four y = AT(c->delta[1] + j);
        const four z = AT(c->delta[2] + j);
        for (int i = 0; i < 3; i++) PUT(c->X[i] + j) = by[i][0] * x + by[i][1] * y + by[i][2] * z;
    }
}

/* Acceleration by start and constants: delta x R a + R (change of a). */
static void change_slope(const am_drive *d, size_t k, const place_t *p, change_t *c) {
    const double *g = p->gain;
    for (int j = 0; j < c->wide; j += 4) {
        const four x = AT(c->delta[0] + j);
        const four y = AT(c->delta[1] + j);
        const four z = AT(c->delta[2] + j);
        PUT(c->slope[0] + j) = y * g[2] - z * g[1];
        PUT(c->slope[1] + j) = z * g[0] - x * g[2];
        PUT(c->slope[2] + j) = x * g[1] - y * g[0];
    }
    for (int j = 0; j < d->inputs; j++) {
        double rates[3], force[3], level[3];
        if (d->input[j] >= AM_WIND) continue;
        by_input(d, k, d->input[j], rates, force);
        matrix_times_vector(p->level, force, level);
        for (int i = 0; i < 3; i++) c->slope[i][d->states + j] += level[i];
    }
}

/* delta += dt R J (mean change of rates): J is the derivative of a turn by its vector, to third
 * order. */
static void change_turn(const am_drive *d, size_t k, const double turn[3], const double level[3][3],
                        change_t *c) {
    for (int j = 0; j < d->inputs; j++) {
        const int input = d->input[j] % AM_SCALE;
        double before[3], after[3], force[3], once[3], twice[3];
        if (d->input[j] >= AM_WIND || input >= 3) continue;
        by_input(d, k, d->input[j], before, force);
        by_input(d, k + 1, d->input[j], after, force);
        for (int i = 0; i < 3; i++) before[i] = (before[i] + after[i]) / 2.0;
        vector_product(turn, before, once);
        vector_product(turn, once, twice);
        for (int i = 0; i < 3; i++) before[i] += twice[i] / 6.0 - once[i] / 2.0;
        matrix_times_vector(level, before, after);
        for (int i = 0; i < 3; i++) c->delta[i][d->states + j] += d->path.dt * after[i];
    }
}

static void change_path(const am_drive *d, size_t k, const double turn[3], const place_t *p,
                        change_t *c) {
    const double half = d->path.dt / 2.0;
    double before[3][DRIVEN_WIDE];
    change_turn(d, k, turn, p->level, c);
    memcpy(before, c->slope, sizeof before);
    change_slope(d, k + 1, p, c);
    for (int j = 0; j < c->wide; j += 4) {
        const four down = AT(c->X[5] + j);
        for (int i = 0; i < 3; i++)
            PUT(c->X[3 + i] + j) += half * (AT(before[i] + j) + AT(c->slope[i] + j));
        PUT(c->X[6] + j) -= half * (down + AT(c->X[5] + j));
    }
    change_attitude(p->level, c);
}

static void begin_path(const am_drive *d, const double *start, place_t *p, change_t *c) {
    const double ct = am_cos(start[1]);
    memset(c, 0, sizeof *c);
    c->wide = (d->states + d->inputs + 3) / 4 * 4;
    p->turned[0] = 1.0;
    for (int i = 0; i < 3; i++) p->turned[1 + i] = 0.0;
    level_axes(start, p->first);
    memcpy(p->level, p->first, sizeof p->level);
    matrix_times_vector(p->level, d->path.force, p->gain);
    for (int i = 0; i < 3; i++) {
        /* the axes of phi, theta, psi in level axes: R W */
        c->delta[i][0] = p->level[i][0];
        c->delta[i][1] = (p->level[2][2] * p->level[i][1] - p->level[2][1] * p->level[i][2]) / ct;
        c->delta[i][2] = i == 2 ? 1.0 : 0.0;
    }
    for (int i = 3; i < d->states; i++) c->X[i][i] = 1.0;
}

static void store_change(const am_drive *d, size_t k, const change_t *c, double *X) {
    const size_t columns = (size_t)(d->states + d->inputs);
    double *to = X + k * columns * (size_t)d->states;
    for (int i = 0; i < d->states; i++, to += columns) memcpy(to, c->X[i], sizeof *to * columns);
}

static void follow_path(const am_drive *d, size_t samples, const double *start, double *x,
                        double *X) {
    place_t p;
    change_t c;
    sight_t sight[2][DRIVEN_VANES];
    drive_t a[4];
    double turn[3];
    begin_path(d, start, &p, &c);
    memcpy(x, start, sizeof *x * (size_t)d->states);
    find_drive(d, 0, a + 1);
    if (samples > 1) find_drive(d, 1, a + 2);
    a[0] = a[1];
    see_all(d, 0, x, p.level, sight[0]);
    if (X) {
        change_attitude(p.level, &c);
        change_slope(d, 0, &p, &c);
        see_change(d, 0, sight[0], c.wide, c.X, c.seen);
        store_change(d, 0, &c, X);
    }
    for (size_t k = 0; k + 1 < samples; k++) {
        const bool last = k + 2 == samples;
        double *next = x + d->states;
        if (last) a[3] = a[2];
        else find_drive(d, k + 2, a + 3);
        follow_step(d->path.dt, k == 0, last, a, &p, x, next, turn);
        see_all(d, k + 1, next, p.level, sight[1]);
        lag_vanes(d, sight, x, next);
        if (X) {
            change_path(d, k, turn, &p, &c);
            change_vanes(d, k, sight, x, c.wide, c.X, c.seen);
            store_change(d, k + 1, &c, X);
        }
        memcpy(sight[0], sight[1], sizeof *sight);
        memmove(a, a + 1, 3 * sizeof *a);
        x = next;
    }
}

#endif
