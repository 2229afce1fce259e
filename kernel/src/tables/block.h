/* Many rows of variables at once: a block of rows, one column for every variable, table and
 * term.
 *
 * The numbers are combined as in interpolate.h and terms.c, so that a row gives the same bits
 * here and in a flight. */
#ifndef AEROMATCH_BLOCK_H
#define AEROMATCH_BLOCK_H

#include "elementary.h"
#include "interpolate.h"
#include "simulation.h"
#include "cells.h"

#include <string.h>

#define ROWS 64    /* of a block, a multiple of eight */
#define COUNTED 40 /* most cells of an axis that are counted through */
/* most tables of a bundle that are looked up for four rows at once, not four tables at once */
#define NARROW 2

typedef struct block {
    const am_sim *sim;
    double *one, *variable; /* columns: of ones, of the catalogued variables */
    double *fraction;       /* of the axes */
    double *slot, *term;
    double *row;           /* the tables of one bundle */
    uint32_t *node;        /* lower nodes of the axes */
    const double **column; /* by code of a variable */
} block_t;

static inline double *column_of(double *columns, uint32_t i) { return columns + (size_t)i * ROWS; }

/* Rows beyond the last repeat it. */
static void copy_rows(const block_t *b, const double *v, size_t rows) {
    const size_t n = (size_t)b->sim->model->count[AM_VARIABLE];
    for (size_t i = 0; i < n; i++) {
        double *to = b->variable + i * ROWS;
        for (size_t r = 0; r < rows; r++) to[r] = v[r * n + i];
        for (size_t r = rows; r < ROWS; r++) to[r] = to[rows - 1];
    }
}

/* ---- tables ---------------------------------------------------------------------------------- */

static inline four all(double x) { return (four){x, x, x, x}; }

static inline bool within(const cell_t *cell, const double x[8]) {
    const four from = all(cell[0].from);
    const four to = all(cell[1].from);
    const four_counts in = (AT(x) >= from) & (AT(x) < to) & (AT(x + 4) >= from) & (AT(x + 4) < to);
    return in[0] & in[1] & in[2] & in[3];
}

/* What find_cell finds, for eight rows: as many cells after the first as begin at or below x. */
static inline void find_cells(const axis_t *axis, const double x[8], uint32_t to[8]) {
    four_counts low = {0};
    four_counts high = {0};
    if (axis->cells > COUNTED) {
        for (int k = 0; k < 8; k++) to[k] = find_cell(axis, x[k]);
        return;
    }
    for (const cell_t *cell = axis->cell + 1, *end = axis->cell + axis->cells; cell < end; cell++) {
        const four from = all(cell->from);
        low -= AT(x) >= from;
        high -= AT(x + 4) >= from;
    }
    for (int k = 0; k < 4; k++) {
        to[k] = (uint32_t)low[k];
        to[4 + k] = (uint32_t)high[k];
    }
}

/* Eight rows that stay in the cell of the row before, as along a flight, need no search. */
static void locate_rows(const block_t *b, uint32_t i) {
    const axis_t *axis = &b->sim->model->axis[i];
    const double *x = b->column[axis->variable];
    double *fraction = column_of(b->fraction, i);
    uint32_t *node = b->node + (size_t)i * ROWS;
    uint32_t cell[8] = {0};
    for (int r = 0; r < ROWS; r += 8) {
        const cell_t *last = &axis->cell[cell[7]];
        if (within(last, x + r)) {
            const uint32_t lower = lower_node(axis, cell[7]);
            for (int k = 0; k < 8; k++) node[r + k] = lower;
            for (int k = r; k < r + 8; k += 4) {
                PUT(fraction + k) = all(last->start)
                                    + (AT(x + k) - all(last->point)) * all(last->per_step);
            }
            continue;
        }
        find_cells(axis, x + r, cell);
        for (int k = 0; k < 8; k++) {
            fraction[r + k] = fraction_in(&axis->cell[cell[k]], within_reach(x[r + k]));
            node[r + k] = lower_node(axis, cell[k]);
        }
    }
}

/* Lower corners of the cells of a bundle. */
typedef struct {
    const double *first;
    const uint32_t *node[MAX_AXES];
    size_t stride[MAX_AXES];
} corner_t;

static corner_t corner_of(const block_t *b, const bundle_t *bundle) {
    corner_t c = {.first = b->sim->model->node + bundle->first};
    for (uint32_t k = 0; k < bundle->axes; k++) {
        c.node[k] = b->node + (size_t)bundle->axis[k] * ROWS;
        c.stride[k] = bundle->stride[k];
    }
    return c;
}

static inline const double *corner_at(const corner_t *c, uint32_t axes, int r) {
    const double *at = c->first;
    for (uint32_t k = 0; k < axes; k++) at += c->stride[k] * c->node[k][r];
    return at;
}

/* The same node of four cells. */
#define EACH(n, o) ((four){(n)[0][o], (n)[1][o], (n)[2][o], (n)[3][o]})

/* What PLANE is for four tables, for four rows. */
static inline four plane_rows(const double *const n[4], size_t o, size_t s0, size_t s1, four w,
                              four f0, four f1) {
    const four low = w * (1.0 - f0);
    const four high = w * f0;
    const four g1 = 1.0 - f1;
    return (low * g1 * EACH(n, o) + low * f1 * EACH(n, o + s1))
           + (high * g1 * EACH(n, o + s0) + high * f1 * EACH(n, o + s0 + s1));
}

static inline four table_rows(const block_t *b, const bundle_t *bundle, const double *const n[4],
                              size_t t, uint32_t axes, int r) {
    const size_t *s = bundle->stride;
    four f[MAX_AXES];
    for (uint32_t k = 0; k < axes; k++) f[k] = AT(column_of(b->fraction, bundle->axis[k]) + r);
    if (axes == 0) return EACH(n, t);
    const four g0 = 1.0 - f[0];
    if (axes == 1) return g0 * EACH(n, t) + f[0] * EACH(n, t + s[0]);
    if (axes == 2) return plane_rows(n, t, s[0], s[1], all(1.0), f[0], f[1]);
    if (axes == 3) {
        return plane_rows(n, t, s[1], s[2], g0, f[1], f[2])
               + plane_rows(n, t + s[0], s[1], s[2], f[0], f[1], f[2]);
    }
    const four g1 = 1.0 - f[1];
    const four low = plane_rows(n, t, s[2], s[3], g0 * g1, f[2], f[3])
                     + plane_rows(n, t + s[1], s[2], s[3], g0 * f[1], f[2], f[3]);
    return low
           + (plane_rows(n, t + s[0], s[2], s[3], f[0] * g1, f[2], f[3])
              + plane_rows(n, t + s[0] + s[1], s[2], s[3], f[0] * f[1], f[2], f[3]));
}

/* The compiler unrolls each number of axes. */
static inline void narrow_rows(const block_t *b, const bundle_t *bundle, uint32_t axes) {
    const corner_t corner = corner_of(b, bundle);
    for (int r = 0; r < ROWS; r += 4) {
        const double *n[4];
        for (int i = 0; i < 4; i++) n[i] = corner_at(&corner, axes, r + i);
        for (uint32_t t = 0; t < bundle->width; t++) {
            PUT(column_of(b->slot, bundle->slot + t) + r) = table_rows(b, bundle, n, t, axes, r);
        }
    }
}

static void wide_rows(const block_t *b, const bundle_t *bundle) {
    const corner_t corner = corner_of(b, bundle);
    double *to = column_of(b->slot, bundle->slot);
    for (int r = 0; r < ROWS; r++) {
        interpolate(bundle, corner_at(&corner, bundle->axes, r), b->fraction + r, ROWS, b->row);
        for (uint32_t t = 0; t < bundle->width; t++) to[t * ROWS + (uint32_t)r] = b->row[t];
    }
}

static void look_up_rows(const block_t *b, const bundle_t *bundle) {
    if (bundle->width > NARROW) wide_rows(b, bundle);
    else if (bundle->axes == 0) narrow_rows(b, bundle, 0);
    else if (bundle->axes == 1) narrow_rows(b, bundle, 1);
    else if (bundle->axes == 2) narrow_rows(b, bundle, 2);
    else if (bundle->axes == 3) narrow_rows(b, bundle, 3);
    else narrow_rows(b, bundle, 4);
}

/* ---- terms ----------------------------------------------------------------------------------- */

static void term_rows(const block_t *b, uint32_t i) {
    const am_sim *sim = b->sim;
    const term_t *t = &sim->model->term[i];
    const double *T = column_of(b->slot, t->T);
    const double *K1 = column_of(b->slot, t->K1);
    const double *K2 = column_of(b->slot, t->K2);
    const double *v1 = b->column[t->v1];
    const double *v2 = b->column[t->v2];
    const double scale = sim->scale[i];
    double *to = column_of(b->term, i);
    for (int r = 0; r < ROWS; r += 4) PUT(to + r) = scale * AT(T + r) * (AT(v1 + r) * AT(v2 + r));
    if (t->K1 | t->K2) {
        for (int r = 0; r < ROWS; r += 4) PUT(to + r) *= AT(K1 + r) * AT(K2 + r);
    }
    if (!t->power) return;
    const power_t *power = &sim->model->power[t->power - 1];
    const double *v = b->column[power->variable];
    const double exponent = sim->exponent[t->power - 1];
    for (int r = 0; r < ROWS; r++) {
        to[r] *= am_pow(v[r] > power->floor ? v[r] : power->floor, exponent);
    }
}

static void coefficient_rows(const block_t *b, size_t rows, double *to) {
    const am_model *m = b->sim->model;
    memset(to, 0, rows * COEFFICIENTS * sizeof *to);
    for (uint32_t k = 0; k < COEFFICIENTS; k++) {
        if (m->first_of[k] == m->end_of[k]) continue;
        double sum[ROWS] = {0.0};
        for (uint32_t i = m->first_of[k]; i < m->end_of[k]; i++) {
            const double *term = column_of(b->term, i);
            for (int r = 0; r < ROWS; r += 4) PUT(sum + r) += AT(term + r);
        }
        for (size_t r = 0; r < rows; r++) to[r * COEFFICIENTS + k] = sum[r];
    }
}

static inline void evaluate_block(const block_t *b, size_t rows, const double *v,
                                  double *coefficients, double *terms) {
    const am_model *m = b->sim->model;
    copy_rows(b, v, rows);
    for (uint32_t i = 0; i < m->axes; i++) locate_rows(b, i);
    for (uint32_t i = 0; i < m->bundles; i++) look_up_rows(b, &m->bundle[i]);
    for (uint32_t i = 0; i < m->terms; i++) term_rows(b, i);
    if (coefficients) coefficient_rows(b, rows, coefficients);
    for (uint32_t i = 0; terms && i < m->terms; i++) {
        const double *from = column_of(b->term, i);
        for (size_t r = 0; r < rows; r++) terms[r * m->terms + i] = from[r];
    }
}

#endif
