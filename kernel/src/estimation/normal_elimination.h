/* Elimination of the states of a trajectory (am_eliminate, am_substitute), compiled like
 * normal_sums.h. */
#ifndef AEROMATCH_NORMAL_ELIMINATION_H
#define AEROMATCH_NORMAL_ELIMINATION_H

#include "four.h"
#include "kernel.h"
#include "normal_sums.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* to[j] += x row[j] for j < n */
static inline void add_scaled(int n, double x, const double *row, double *to) {
    int j = 0;
    for (; j + 4 <= n; j += 4) PUT(to + j) += x * AT(row + j);
    for (; j < n; j++) to[j] += x * row[j];
}

/* A pivot that is a smaller part of the information on its state is rounding: its twelve leading
 * digits have cancelled.  Along recorded flights the smallest is 4e-7. */
static const double LOST = 1e-12;

/* Cholesky factor of the lower half of S, in place, and one over its pivots; D: the same before
 * neighbours were eliminated.  The row that nothing determines, or n. */
static int factor_cholesky(int n, const double *D, double *S, double *per_pivot) {
    for (int i = 0; i < n; i++) {
        double *row = S + i * n;
        for (int j = 0; j < i; j++) {
            double sum = row[j];
            for (int l = 0; l < j; l++) sum -= row[l] * S[j * n + l];
            row[j] = sum * per_pivot[j];
        }
        double sum = row[i];
        for (int l = 0; l < i; l++) sum -= row[l] * row[l];
        if (!(sum > LOST * D[i * n + i])) return i;
        row[i] = sqrt(sum);
        per_pivot[i] = 1.0 / row[i];
    }
    return n;
}

/* M = L^-1 M, rows of the given width. */
static void forward(int n, const double *L, const double *per_pivot, int width, double *M) {
    for (int i = 0; i < n; i++) {
        double *row = M + (size_t)i * width;
        const double *l = L + i * n;
        int c = 0;
        for (; c + 4 <= width; c += 4) {
            four sum = AT(row + c);
            for (int j = 0; j < i; j++) sum -= l[j] * AT(M + (size_t)j * width + c);
            PUT(row + c) = sum * per_pivot[i];
        }
        for (; c < width; c++) {
            for (int j = 0; j < i; j++) row[c] -= l[j] * M[(size_t)j * width + c];
            row[c] *= per_pivot[i];
        }
    }
}

/* to[j] += sign sum_i left[i][at] right[i][j] for j < count; rows of left and right of the widths
 * n and width. */
static inline void add_products(int n, int step, const double *left, double sign, int width,
                                const double *right, int count, double *to) {
    int c = 0;
    for (; c + 4 <= count; c += 4) {
        four sum = {0.0, 0.0, 0.0, 0.0};
        for (int i = 0; i < n; i++) sum += left[i * step] * AT(right + (size_t)i * width + c);
        PUT(to + c) += sign * sum;
    }
    for (; c < count; c++) {
        double sum = 0.0;
        for (int i = 0; i < n; i++) sum += left[i * step] * right[(size_t)i * width + c];
        to[c] += sign * sum;
    }
}

/* V = the block of a sample (rows) with the next one (columns). */
static void copy_transposed(const am_normal *e, size_t k, double *V) {
    const int n = e->states;
    const double *O = e->O + k * n * n;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) V[i * n + j] = O[j * n + i];
    }
}

/* to[i][j] += sign sum_l left[l][i] right[l][j] for i, j < 4; rows of the strides a, b, c. */
static inline void add_tile(int n, double sign, int a, const double *left, int b,
                            const double *right, int c, double *to) {
    four sum[4] = {{0.0}, {0.0}, {0.0}, {0.0}};
    for (int l = 0; l < n; l++) {
        const double *x = left + l * a;
        const four y = AT(right + (size_t)l * b);
        for (int i = 0; i < 4; i++) sum[i] += x[i] * y;
    }
    for (int i = 0; i < 4; i++) PUT(to + (size_t)i * c) += sign * sum[i];
}

/* Subtract from the next sample what the elimination of one leaves there; width: vectors of
 * four. */
static void reduce_next(int n, const double *V, int width, const double *right, double *S,
                        double *next) {
    for (int j = 0; j < n; j++) add_products(n, n, V + j, -1.0, n, V, j + 1, S + j * n);
    int j = 0;
    for (; j + 4 <= n; j += 4) {
        double *to = next + (size_t)j * width;
        for (int c = 0; c < width; c += 4)
            add_tile(n, -1.0, n, V + j, width, right + c, width, to + c);
    }
    for (; j < n; j++) {
        add_products(n, n, V + j, -1.0, width, right, width, next + (size_t)j * width);
    }
}

/* What it adds to the sums of the border, the lower half by vectors of four. */
static void add_to_border(int n, int width, const double *right, double *border) {
    for (int j = 0; j < width; j += 4) {
        double *to = border + (size_t)j * width;
        for (int c = 0; c <= j; c += 4)
            add_tile(n, 1.0, width, right + j, width, right + c, width, to + c);
    }
}

static long long eliminate_samples(const am_normal *e, size_t samples, double *L, double *V,
                                   double *right, double *border) {
    const int n = e->states;
    const int width = (e->constants + 4) / 4 * 4;
    double per_pivot[AM_MOST_UNKNOWNS];
    memcpy(L, e->D, sizeof *L * samples * n * n);
    for (size_t row = 0; row < samples * n; row++) {
        double *to = right + row * width;
        memcpy(to, e->G + row * e->constants, sizeof *to * e->constants);
        to[e->constants] = e->gx[row];
        for (int c = e->constants + 1; c < width; c++) to[c] = 0.0;
    }
    for (size_t k = 0; k < samples; k++) {
        double *S = L + k * n * n;
        double *block = V + k * n * n;
        double *here = right + k * n * width;
        const int failed = factor_cholesky(n, e->D + k * n * n, S, per_pivot);
        if (failed < n) return (long long)k * n + failed;
        forward(n, S, per_pivot, width, here);
        add_to_border(n, width, here, border);
        if (k + 1 == samples) break;
        copy_transposed(e, k, block);
        forward(n, S, per_pivot, n, block);
        reduce_next(n, block, width, here, S + n * n, here + (size_t)n * width);
    }
    return -1;
}

/* The states of one sample, of which `here` holds the right-hand sides, for a single column. */
static void substitute_one(int n, const double *L, const double *V, const double *next,
                           double *here) {
    for (int i = n; i-- > 0;) {
        double sum = here[i];
        for (int j = 0; next && j < n; j++) sum -= V[i * n + j] * next[j];
        for (int j = i + 1; j < n; j++) sum -= L[j * n + i] * here[j];
        here[i] = sum / L[i * n + i];
    }
}

static void substitute_many(int n, const double *L, const double *V, size_t columns,
                            const double *next, double *here) {
    for (int i = n; i-- > 0;) {
        double *row = here + (size_t)i * columns;
        for (int j = 0; next && j < n; j++) {
            add_scaled((int)columns, -V[i * n + j], next + j * columns, row);
        }
        for (int j = i + 1; j < n; j++) {
            add_scaled((int)columns, -L[j * n + i], here + j * columns, row);
        }
        scale((int)columns, 1.0 / L[i * n + i], row, row);
    }
}

static void substitute(int n, size_t samples, const double *L, const double *V, size_t columns,
                       double *x) {
    for (size_t k = samples; k-- > 0;) {
        const size_t at = k * n * n;
        double *here = x + k * n * columns;
        const double *next = k + 1 < samples ? here + n * columns : NULL;
        if (columns == 1) substitute_one(n, L + at, V + at, next, here);
        else substitute_many(n, L + at, V + at, columns, next, here);
    }
}

#endif
