/* Residuals of the steps of a flight path (am_path of a group), compiled like normal_sums.h.
 *
 * Each step is written in the axes of the instruments at its middle: what gyros and accelerometers
 * would have to be wrong by, and the height that does not follow the vertical velocity. */
#ifndef AEROMATCH_PATH_STEPS_H
#define AEROMATCH_PATH_STEPS_H

#include "elementary.h"
#include "kernel.h"
#include "normal_sums.h"

enum { PATH_ROWS = 7 }; /* rates, specific force, height; as many states stand behind them */

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

static void multiply(const double matrix[3][3], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = matrix[i][0] * v[0] + matrix[i][1] * v[1] + matrix[i][2] * v[2];
    }
}

static void cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Residuals r, and the specific force that the step needs, in body axes. */
static void path_residuals(const am_path *path, size_t k, const middle_t *m, double r[PATH_ROWS],
                           double needed[3]) {
    double carried[3], turning[3], shown[3], coriolis[3], rates[3], level[3];
    multiply(path->transport, m->middle + 3, carried);
    for (int i = 0; i < 3; i++) {
        turning[i] = 2.0 * path->spin[i] + carried[i];
        shown[i] = carried[i] + path->sensed[i];
    }
    cross(turning, m->middle + 3, coriolis);
    for (int i = 0; i < 3; i++) coriolis[i] += m->change[3 + i];
    coriolis[2] -= path->gravity - path->fall * (m->middle[6] - path->level);
    multiply(m->body, coriolis, needed);
    multiply(m->axis, m->change, rates);
    multiply(m->body, shown, level);
    for (int i = 0; i < 3; i++) {
        r[i] = rates[i] + level[i] - path->rates[3 * k + (size_t)i];
        r[3 + i] = needed[i] - path->force[3 * k + (size_t)i];
    }
    r[6] = m->change[6] + m->middle[5];
}

/* Add to A and B the derivatives by the middle (half of each) and the change of one unknown. */
static inline void place(double by_middle, double by_change, double dt, double *A, double *B) {
    *A = by_middle / 2.0 - by_change / dt;
    *B = by_middle / 2.0 + by_change / dt;
}

/* Derivatives of the residuals by the states before, A, and after, B; what is zero stays.  A
 * vector of the level axes that is seen in body axes changes with an angle as its cross product
 * with the axis of this angle. */
static void path_derivatives(const am_path *path, const middle_t *m, const double needed[3],
                             double A[PATH_ROWS][PATH_ROWS], double B[PATH_ROWS][PATH_ROWS]) {
    const double dt = path->dt;
    const double psi_dot = m->change[2];
    double rates[3];
    multiply(m->axis, m->change, rates);
    const double change[3][2] = {{0.0, -m->ct * psi_dot},
                                 {rates[2], -m->sf * m->st * psi_dot},
                                 {-rates[1], -m->cf * m->st * psi_dot}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const double axis[3] = {m->axis[0][j], m->axis[1][j], m->axis[2][j]};
            double turn[3];
            cross(needed, axis, turn);
            place(j < 2 ? change[i][j] : 0.0, m->axis[i][j], dt, &A[i][j], &B[i][j]);
            place(turn[i], 0.0, dt, &A[3 + i][j], &B[3 + i][j]);
            place(0.0, m->body[i][j], dt, &A[3 + i][3 + j], &B[3 + i][3 + j]);
        }
        place(path->fall * m->body[i][2], 0.0, dt, &A[3 + i][6], &B[3 + i][6]);
    }
    place(1.0, 0.0, dt, &A[6][5], &B[6][5]);
    place(0.0, 1.0, dt, &A[6][6], &B[6][6]);
}

static void add_path_steps(const am_normal *e, const am_residual_group *group, size_t from,
                           size_t to) {
    sums_t sums;
    const am_path *path = group->path;
    double r[PATH_ROWS];
    double needed[3];
    double A[PATH_ROWS][PATH_ROWS] = {{0.0}};
    double B[PATH_ROWS][PATH_ROWS] = {{0.0}};
    middle_t m;
    begin_sums(&sums, 2 * PATH_ROWS + group->given.columns + 1);
    for (size_t k = from; k < to; k++) {
        const double *before = path->x + k * e->states;
        find_middle(before, before + e->states, path->dt, &m);
        path_residuals(path, k, &m, r, needed);
        path_derivatives(path, &m, needed, A, B);
        add_step(e, &group->given, k, r, A[0], B[0], &sums);
    }
    give_total(e, &group->given, &sums);
}

#endif
