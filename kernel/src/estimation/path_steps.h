/* Residuals of the steps of a flight path (am_drive of a group), compiled like normal_sums.h.
 *
 * Each step is written in the axes of the instruments at its middle: what gyros and accelerometers
 * would have to be wrong by, and the height that does not follow the vertical velocity; then what
 * the vanes miss of their lag behind the angles that they see. */
#ifndef AEROMATCH_PATH_STEPS_H
#define AEROMATCH_PATH_STEPS_H

#include "driven_inputs.h"
#include "driven_vanes.h"
#include "elementary.h"
#include "flight_axes.h"
#include "kernel.h"
#include "normal_sums.h"

enum { STEP_STATES = DRIVEN_STATES + 3 }; /* gusts included */

/* The middle of a step. */
typedef struct {
    double change[PATH_ROWS]; /* of the states over the step, per second */
    double middle[PATH_ROWS];
    double body[3][3]; /* body axes from north-east-down */
    double axis[3][3]; /* body axes (rows) of the turns phi, theta, psi (columns) */
    double sf, cf, st, ct;
} middle_t;

static void find_middle(const double *before, const double *after, double dt, middle_t *m) {
    double sp, cp;
    for (int i = 0; i < PATH_ROWS; i++) {
        m->change[i] = (after[i] - before[i]) / dt;
        m->middle[i] = (after[i] + before[i]) / 2.0;
    }
    am_sincos(m->middle[0], &m->sf, &m->cf);
    am_sincos(m->middle[1], &m->st, &m->ct);
    am_sincos(m->middle[2], &sp, &cp);
    const double body[3][3] = {
        {m->ct * cp, m->ct * sp, -m->st},
        {m->sf * m->st * cp - m->cf * sp, m->sf * m->st * sp + m->cf * cp, m->sf * m->ct},
        {m->cf * m->st * cp + m->sf * sp, m->cf * m->st * sp - m->sf * cp, m->cf * m->ct},
    };
    const double axis[3][3] = {
        {1.0, 0.0, -m->st}, {0.0, m->cf, m->sf * m->ct}, {0.0, -m->sf, m->cf * m->ct}};
    memcpy(m->body, body, sizeof body);
    memcpy(m->axis, axis, sizeof axis);
}

/* Residuals r, and the specific force that the step needs, in body axes. */
static void path_residuals(const am_path *path, const double mean[6], const middle_t *m,
                           double r[PATH_ROWS], double needed[3]) {
    double carried[3], turning[3], shown[3], coriolis[3], rates[3], level[3];
    matrix_times_vector(path->transport, m->middle + 3, carried);
    for (int i = 0; i < 3; i++) {
        turning[i] = 2.0 * path->spin[i] + carried[i];
        shown[i] = carried[i] + path->sensed[i];
    }
    vector_product(turning, m->middle + 3, coriolis);
    for (int i = 0; i < 3; i++) coriolis[i] += m->change[3 + i];
    coriolis[2] -= path->gravity - path->fall * (m->middle[6] - path->level);
    matrix_times_vector(m->body, coriolis, needed);
    matrix_times_vector(m->axis, m->change, rates);
    matrix_times_vector(m->body, shown, level);
    for (int i = 0; i < 3; i++) {
        r[i] = rates[i] + level[i] - mean[i];
        r[3 + i] = needed[i] - mean[3 + i];
    }
    r[6] = m->change[6] + m->middle[5];
}

/* Add to A and B the derivatives by the middle (half of each) and the change of one unknown. */
static inline void add_unknown(double by_middle, double by_change, double dt, double *A,
                               double *B) {
    *A = by_middle / 2.0 - by_change / dt;
    *B = by_middle / 2.0 + by_change / dt;
}

/* Derivatives of the residuals by the states before, A, and after, B; what is zero stays.  A
 * vector of the level axes that is seen in body axes changes with an angle as its cross product
 * with the axis of this angle. */
static void path_derivatives(const am_path *path, const middle_t *m, const double needed[3],
                             double A[][STEP_STATES], double B[][STEP_STATES]) {
    const double dt = path->dt;
    const double psi_dot = m->change[2];
    double rates[3];
    matrix_times_vector(m->axis, m->change, rates);
    const double change[3][2] = {{0.0, -m->ct * psi_dot},
                                 {rates[2], -m->sf * m->st * psi_dot},
                                 {-rates[1], -m->cf * m->st * psi_dot}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const double axis[3] = {m->axis[0][j], m->axis[1][j], m->axis[2][j]};
            double turn[3];
            vector_product(needed, axis, turn);
            add_unknown(j < 2 ? change[i][j] : 0.0, m->axis[i][j], dt, &A[i][j], &B[i][j]);
            add_unknown(turn[i], 0.0, dt, &A[3 + i][j], &B[3 + i][j]);
            add_unknown(0.0, m->body[i][j], dt, &A[3 + i][3 + j], &B[3 + i][3 + j]);
        }
        add_unknown(path->fall * m->body[i][2], 0.0, dt, &A[3 + i][6], &B[3 + i][6]);
    }
    add_unknown(1.0, 0.0, dt, &A[6][5], &B[6][5]);
    add_unknown(0.0, 1.0, dt, &A[6][6], &B[6][6]);
}

/* Means of rates and specific force over a step, cubics between samples. */
static void find_means(const am_path *path, size_t k, bool first, bool last, double mean[6]) {
    for (int i = 0; i < 6; i++) {
        const double *from = (i < 3 ? path->rates : path->force) + 3 * k + (size_t)(i % 3);
        const double a = first ? 0.0 : from[-3];
        const double d = last ? 0.0 : from[6];
        const double curve = bend(first, last, a, from[0], from[3], d);
        mean[i] = (from[0] + from[3]) / 2.0 - curve / 12.0;
    }
}

/* What stands behind the steps at one sample. */
typedef struct {
    sight_t sight[DRIVEN_VANES];
    double by[AM_LAG + 1][6]; /* rates and specific force by the inputs */
} behind_t;

static void find_behind(const am_drive *d, size_t k, behind_t *b) {
    const double *x = d->path.x + k * (size_t)d->states;
    double level[3][3];
    if (d->vanes) {
        level_axes(x, level);
        see_all(d, k, x, level, b->sight);
    }
    for (int j = 0; j < d->inputs; j++) {
        if (d->input[j] < AM_WIND) by_input(d, k, d->input[j], b->by[j], b->by[j] + 3);
    }
}

/* Residual and derivatives of a vane by the states before and after; too slow for the air to move
 * it, it only has to stay finite. */
static void vane_step(const am_drive *d, size_t k, int vane, const behind_t *b, double *r,
                      double *A, double *B, double *J) {
    const int own = PATH_ROWS + vane;
    const int gusts = PATH_ROWS + d->vanes;
    const double *x = d->path.x + k * (size_t)d->states;
    const double *next = x + d->states;
    const bool slow = d->slow && d->slow[k];
    const double E = slow ? 1.0 : d->lag[0];
    const double c0 = slow ? 0.0 : d->lag[1];
    const double c1 = slow ? 0.0 : d->lag[2];
    const sight_t *before = b[0].sight + vane;
    const sight_t *after = b[1].sight + vane;
    *r = next[own] - E * x[own] - c0 * before->angle - c1 * after->angle;
    for (int i = 0; i < 6; i++) {
        A[i] = -c0 * before->by[i];
        B[i] = -c1 * after->by[i];
    }
    for (int i = 0; d->gusts && i < 3; i++) {
        A[gusts + i] = -A[3 + i];
        B[gusts + i] = -B[3 + i];
    }
    A[own] = -E;
    B[own] = 1.0;
    for (int j = 0; j < d->inputs; j++) {
        const int input = d->input[j];
        J[j] = -c0 * by_constant(d, k, before, input) - c1 * by_constant(d, k + 1, after, input);
        if (input != AM_LAG || slow) continue;
        J[j] = -d->lag_slope[0] * x[own] - d->lag_slope[1] * before->angle
               - d->lag_slope[2] * after->angle;
    }
}

static void add_path_steps(const am_normal *e, const am_residual_group *group, size_t from,
                           size_t to) {
    sums_t sums;
    const am_drive *d = group->drive;
    const am_residuals *given = &group->given;
    const size_t rows = (size_t)given->rows;
    double r[DRIVEN_STATES], mean[6], needed[3], J[DRIVEN_STATES * (AM_LAG + 1)] = {0.0};
    double A[DRIVEN_STATES][STEP_STATES] = {{0.0}};
    double B[DRIVEN_STATES][STEP_STATES] = {{0.0}};
    behind_t behind[2];
    middle_t m;
    begin_sums(&sums, 2 * given->states + given->columns + 1);
    find_behind(d, from, behind);
    for (size_t k = from; k < to; k++) {
        const double *before = d->path.x + k * (size_t)d->states;
        const double *weight = given->weight + k * rows;
        find_behind(d, k + 1, behind + 1);
        if (*weight != 0.0) {
            const bool first = k == 0 || weight[-(ptrdiff_t)rows] == 0.0;
            const bool last = k + 1 == group->count || weight[rows] == 0.0;
            find_means(&d->path, k, first, last, mean);
            find_middle(before, before + d->states, d->path.dt, &m);
            path_residuals(&d->path, mean, &m, r, needed);
            path_derivatives(&d->path, &m, needed, A, B);
            for (int j = 0; j < d->inputs; j++) {
                for (int i = 0; i < 6 && d->input[j] < AM_WIND; i++)
                    J[i * d->inputs + j] = -(behind[0].by[j][i] + behind[1].by[j][i]) / 2.0;
            }
            for (int i = 0; i < d->vanes; i++) {
                const int row = PATH_ROWS + i;
                vane_step(d, k, i, behind, r + row, A[row], B[row], J + row * d->inputs);
            }
            add_step(e, given, k, STEP_STATES, r, A[0], B[0], J, &sums);
        }
        behind[0] = behind[1];
    }
    add_total(e, given, &sums);
}

#endif
