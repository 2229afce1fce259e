/* Sums of the normal equations of a trajectory (am_add_residuals): what
 * normal_equations.c and normal_avx2.c compile for any processor and for AVX2, to the same bits.
 *
 * The whitened residuals of one step, or of one reading, have derivatives by the same unknowns.
 * Each makes a row z: derivatives by the states, by the constants, and the residual itself.  The
 * products z' z are summed over the rows first and go to the samples once. */
#ifndef AEROMATCH_NORMAL_SUMS_H
#define AEROMATCH_NORMAL_SUMS_H

#include "four.h"
#include "kernel.h"

#include <stdbool.h>
#include <string.h>

enum {
    MOST_WIDE = 3 * AM_MOST_UNKNOWNS + 4
}; /* two samples, constants, residual; vectors of four */

/* Upper halves of the sums of z' z, of row i the columns from the four that holds i: over the rows
 * of one step, and over all. */
typedef struct {
    int width, stride;
    double z[MOST_WIDE];
    double sum[MOST_WIDE * MOST_WIDE];
    double total[MOST_WIDE * MOST_WIDE];
} sums_t;

static void begin_sums(sums_t *p, int width) {
    p->width = width;
    p->stride = (width + 3) / 4 * 4;
    memset(p->z, 0, sizeof *p->z * (size_t)p->stride);
    memset(p->total, 0, sizeof *p->total * (size_t)(p->width * p->stride));
}

static void clear_products(sums_t *p) {
    memset(p->sum, 0, sizeof *p->sum * (size_t)(p->width * p->stride));
}

static void add_products_of_row(sums_t *p) {
    for (int i = 0; i < p->width; i++) {
        const double x = p->z[i];
        if (x == 0.0) continue;
        double *to = p->sum + i * p->stride;
        for (int j = i / 4 * 4; j < p->stride; j += 4) PUT(to + j) += x * AT(p->z + j);
    }
}

/* Add the rows from `first`, those of the constants and the residual, to the sums over all. */
static void add_to_total(sums_t *p, int first) {
    for (int i = first; i < p->width; i++) {
        const int row = i * p->stride;
        for (int j = i / 4 * 4; j < p->stride; j += 4)
            PUT(p->total + row + j) += AT(p->sum + row + j);
    }
}

/* The sums over all, of the constants and the residual. */
static void add_total(const am_normal *e, const am_residuals *given, const sums_t *p) {
    const int first = p->width - 1 - given->columns;
    const int last = p->width - 1;
    for (int i = 0; i < given->columns; i++) {
        double *row = e->C + (size_t)given->column[i] * e->constants;
        e->gc[given->column[i]] += p->total[(first + i) * p->stride + last];
        for (int j = 0; j < given->columns; j++) {
            const int low = first + (i < j ? i : j);
            const int high = first + (i < j ? j : i);
            row[given->column[j]] += p->total[low * p->stride + high];
        }
    }
    *e->cost += p->total[last * p->stride + last];
}

/* Add to a sample the products of the states that stand at `at` in z, which are the share w of its
 * own. */
static void add_to_sample(const am_normal *e, const am_residuals *given, const sums_t *p, size_t k,
                          int at, double w) {
    const int n = e->states;
    const int first = p->width - 1 - given->columns;
    double *D = e->D + k * n * n;
    for (int i = 0; i < given->states; i++) {
        const double *row = p->sum + (at + i) * p->stride;
        double *G = e->G + (k * n + (size_t)i) * e->constants;
        e->gx[k * n + (size_t)i] += w * row[p->width - 1];
        D[i * n + i] += w * w * row[at + i];
        for (int j = i + 1; j < given->states; j++) {
            const double product = w * w * row[at + j];
            D[i * n + j] += product;
            D[j * n + i] += product;
        }
        for (int c = 0; c < given->columns; c++) G[given->column[c]] += w * row[first + c];
    }
}

/* The block of a sample (columns) and the next one (rows) of a step. */
static void add_to_pair(const am_normal *e, const am_residuals *given, const sums_t *p, size_t k) {
    const int n = given->states;
    double *O = e->O + k * e->states * e->states;
    for (int j = 0; j < n; j++) {
        const double *row = p->sum + j * p->stride + n;
        for (int i = 0; i < n; i++) O[i * e->states + j] += row[i];
    }
}

/* The same of a reading between them, w = f (1 - f). */
static void add_between(const am_normal *e, const am_residuals *given, const sums_t *p, size_t k,
                        double w) {
    double *O = e->O + k * e->states * e->states;
    for (int i = 0; i < given->states; i++) {
        for (int j = 0; j < given->states; j++) {
            const int low = i < j ? i : j;
            O[i * e->states + j] += w * p->sum[low * p->stride + (i < j ? j : i)];
        }
    }
}

static void scale(int n, double w, const double *from, double *to) {
    for (int i = 0; i < n; i++) to[i] = w * from[i];
}

/* Rows of one step: A and B in rows of the given stride. */
static void add_step(const am_normal *e, const am_residuals *given, size_t k, int stride,
                     const double *r, const double *A, const double *B, const double *J,
                     sums_t *p) {
    const int n = given->states;
    bool any = false;
    for (int i = 0; i < given->rows; i++) {
        const size_t row = k * given->rows + (size_t)i;
        const double w = given->weight[row];
        if (w == 0.0) continue;
        if (!any) clear_products(p);
        any = true;
        scale(n, w, A + i * stride, p->z);
        scale(n, w, B + i * stride, p->z + n);
        scale(given->columns, w, J + i * given->columns, p->z + 2 * n);
        p->z[p->width - 1] = w * r[i];
        add_products_of_row(p);
    }
    if (!any) return;
    add_to_sample(e, given, p, k, 0, 1.0);
    add_to_sample(e, given, p, k + 1, n, 1.0);
    add_to_pair(e, given, p, k);
    add_to_total(p, 2 * n);
}

static void add_steps(const am_normal *e, const am_residual_group *group, size_t from, size_t to) {
    sums_t sums;
    const am_residuals *given = &group->given;
    const size_t rows = (size_t)given->rows;
    const size_t derivatives = rows * given->states;
    begin_sums(&sums, 2 * given->states + given->columns + 1);
    for (size_t k = from; k < to; k++) {
        const double *A = group->A + k * derivatives;
        const double *B = group->B + k * derivatives;
        const double *J = given->J + k * rows * given->columns;
        add_step(e, given, k, given->states, given->r + k * rows, A, B, J, &sums);
    }
    add_total(e, given, &sums);
}

/* Derivatives of reading m by the state, row by row. */
static const double *by_state(const am_residual_group *group, size_t m) {
    const am_residuals *given = &group->given;
    return group->A + (group->same ? 0 : m * (size_t)given->rows * (size_t)given->states);
}

static void add_readings(const am_normal *e, const am_residual_group *group, size_t from,
                         size_t to) {
    sums_t p;
    const am_residuals *given = &group->given;
    const int n = given->states;
    begin_sums(&p, n + given->columns + 1);
    for (size_t m = from; m < to; m++) {
        const size_t k = (size_t)group->k[m];
        const double f = group->f[m];
        clear_products(&p);
        const double *A = by_state(group, m);
        for (size_t row = m * given->rows; row < (m + 1) * given->rows; row++, A += n) {
            const double w = given->weight[row];
            scale(n, w, A, p.z);
            scale(given->columns, w, given->J + row * given->columns, p.z + n);
            p.z[p.width - 1] = w * given->r[row];
            add_products_of_row(&p);
        }
        add_to_total(&p, n);
        add_to_sample(e, given, &p, k, 0, 1.0 - f);
        if (f == 0.0) continue;
        add_to_sample(e, given, &p, k + 1, 0, f);
        add_between(e, given, &p, k, f * (1.0 - f));
    }
    add_total(e, given, &p);
}

#endif
