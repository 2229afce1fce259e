/* What readings say of the start and the constants behind a driven path (am_add_driven), and what
 * the noise of its instruments does to that (am_add_noise), compiled like normal_sums.h. */
#ifndef AEROMATCH_DRIVEN_SUMS_H
#define AEROMATCH_DRIVEN_SUMS_H

#include "driven_path.h"
#include "normal_elimination.h"
#include "normal_sums.h"

/* Derivatives of one row of a reading by the unknowns, and its residual. */
static void find_row(const am_driven *d, const am_residual_group *group, size_t m, int row,
                     double *z) {
    const am_residuals *given = &group->given;
    const size_t at = m * (size_t)given->rows + (size_t)row;
    const double *J = by_state(group, m) + row * given->states;
    const size_t sample = (size_t)d->states * (size_t)d->columns;
    const double *X = d->X + (size_t)group->k[m] * sample;
    const double f = group->f[m];
    memset(z, 0, sizeof *z * (size_t)(d->unknowns + 1));
    for (int s = 0; s < given->states; s++, X += d->columns) {
        if (J[s] == 0.0) continue;
        add_scaled(d->columns, (1.0 - f) * J[s], X, z);
        if (f != 0.0) add_scaled(d->columns, f * J[s], X + sample, z);
    }
    for (int c = 0; c < given->columns; c++) {
        if (given->column[c] < 0) continue;
        z[given->column[c]] += given->J[at * (size_t)given->columns + (size_t)c];
    }
    z[d->unknowns] = given->r[at];
}

/* Both halves of the sums of products. */
static void add_both_halves(const sums_t *p, double *to) {
    for (int i = 0; i < p->width; i++) {
        for (int j = i; j < p->width; j++) {
            to[i * p->width + j] += p->sum[i * p->stride + j];
            if (j > i) to[j * p->width + i] += p->sum[i * p->stride + j];
        }
    }
}

/* J' R^-1 times the derivatives of the reading: to[states][unknowns] of a sample. */
static void press(int states, int unknowns, double w, const double *J, const double *z,
                  double *to) {
    for (int s = 0; s < states; s++, to += unknowns) {
        if (J[s] != 0.0) add_scaled(unknowns, w * J[s], z, to);
    }
}

static void add_driven(const am_driven *d, const am_residual_group *group, double *products,
                       double *series, double *pressed) {
    sums_t p;
    const am_residuals *given = &group->given;
    const int u = d->unknowns;
    const size_t sample = (size_t)d->states * (size_t)u;
    for (int row = 0; row < given->rows; row++) {
        begin_sums(&p, u + 1);
        clear_products(&p);
        for (size_t m = 0; m < group->count; m++) {
            find_row(d, group, m, row, p.z);
            if (products) add_products_of_row(&p);
            for (int j = 0; series && j < u; j++) {
                if (p.z[j] != 0.0)
                    series[((size_t)row * (size_t)u + (size_t)j) * group->count + m] = p.z[j];
            }
            if (!pressed) continue;
            const size_t at = m * (size_t)given->rows + (size_t)row;
            const double w = given->weight[at] * given->weight[at];
            const double *J = by_state(group, m) + row * given->states;
            double *to = pressed + (size_t)group->k[m] * sample;
            press(given->states, u, (1.0 - group->f[m]) * w, J, p.z, to);
            if (group->f[m] != 0.0) press(given->states, u, group->f[m] * w, J, p.z, to + sample);
        }
        if (products)
            add_both_halves(&p, products + (size_t)row * (size_t)(u + 1) * (size_t)(u + 1));
    }
}

/* Sums over a sample and all after it. */
typedef struct {
    double height[MOST_WIDE];
    double speed[3][MOST_WIDE];
    double turn[3][MOST_WIDE];
} later_t;

/* The derivatives b[states][unknowns] of the gradient by the state of a sample, what acts through
 * the vanes at once included, go into the sums. */
static void add_later(const am_drive *d, const place_t *p, const sight_t *sight, int u,
                      const double *b, later_t *l) {
    double by[3][3];
    const double dt = d->path.dt;
    const double *g = p->gain;
    angle_changes(p->level, by);
    for (int j = 0; j < u; j++) {
        double at[6];
        for (int i = 0; i < 6; i++) {
            at[i] = b[i * u + j];
            for (int v = 0; v < d->vanes; v++) at[i] += sight[v].by[i] * b[(PATH_ROWS + v) * u + j];
        }
        const double speed[3] = {l->speed[0][j], l->speed[1][j], l->speed[2][j]};
        double lever[3];
        vector_product(g, speed, lever);
        for (int i = 0; i < 3; i++) {
            l->turn[i][j] += by[0][i] * at[0] + by[1][i] * at[1] + by[2][i] * at[2] + dt * lever[i];
            l->speed[i][j] += at[3 + i];
        }
        l->speed[2][j] -= dt * l->height[j];
        l->height[j] += b[6 * u + j];
    }
}

static void add_noise(const am_drive *d, size_t samples, const double *x, int u,
                      const double noise[6], const double *pressed, double *products) {
    sums_t sums;
    later_t later;
    place_t p;
    sight_t sight[DRIVEN_VANES];
    memset(&later, 0, sizeof later);
    begin_sums(&sums, u);
    clear_products(&sums);
    for (size_t k = samples; k-- > 0;) {
        level_axes(x + k * (size_t)d->states, p.level);
        matrix_times_vector(p.level, d->path.force + 3 * k, p.gain);
        see_all(d, k, x + k * (size_t)d->states, p.level, sight);
        add_later(d, &p, sight, u, pressed + k * (size_t)d->states * (size_t)u, &later);
        for (int i = 0; i < 6; i++) {
            double (*from)[MOST_WIDE] = i < 3 ? later.turn : later.speed;
            const double w = d->path.dt * noise[i];
            for (int j = 0; j < u; j++)
                sums.z[j] = w
                            * (p.level[0][i % 3] * from[0][j] + p.level[1][i % 3] * from[1][j]
                               + p.level[2][i % 3] * from[2][j]);
            add_products_of_row(&sums);
        }
    }
    add_both_halves(&sums, products);
}

#endif
