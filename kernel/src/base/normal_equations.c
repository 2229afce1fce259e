/* Normal equations of a trajectory with constants: products of the derivatives of whitened
 * residuals, summed at the samples that they touch. */
#include "four.h"
#include "kernel.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* to[j] += x row[j] for j < n */
static inline void add_scaled(int n, double x, const double *row, double *to) {
    int j = 0;
    for (; j + 4 <= n; j += 4) PUT(to + j) += x * AT(row + j);
    for (; j < n; j++) to[j] += x * row[j];
}

/* to[column[j]] += x row[j] */
static inline void add_at_columns(const am_residuals *given, double x, const double *row,
                                  double *to) {
    for (int j = 0; j < given->columns; j++) to[given->column[j]] += x * row[j];
}

/* What one residual r, with the derivatives J by the constants, adds to the sums over constants. */
static void add_to_constants(const am_normal *e, const am_residuals *given, double r,
                             const double *J) {
    *e->cost += r * r;
    for (int i = 0; i < given->columns; i++) {
        const int c = given->column[i];
        if (J[i] == 0.0) continue;
        e->gc[c] += r * J[i];
        add_at_columns(given, J[i], J, e->C + (size_t)c * e->constants);
    }
}

/* What it adds to the sums of a sample by whose state its derivatives are d. */
static void add_to_sample(const am_normal *e, const am_residuals *given, size_t k, double r,
                          const double *d, const double *J) {
    const int n = e->states;
    double *gx = e->gx + k * n;
    double *D = e->D + k * n * n;
    double *G = e->G + k * n * e->constants;
    for (int i = 0; i < given->states; i++) {
        if (d[i] == 0.0) continue;
        gx[i] += r * d[i];
        add_scaled(given->states, d[i], d, D + (size_t)i * n);
        add_at_columns(given, d[i], J, G + (size_t)i * e->constants);
    }
}

/* The block of a sample (columns) and the next one (rows). */
static void add_to_pair(const am_normal *e, const am_residuals *given, size_t k,
                        const double *before, const double *after) {
    double *O = e->O + k * e->states * e->states;
    for (int i = 0; i < given->states; i++) {
        if (after[i] != 0.0) add_scaled(given->states, after[i], before, O + (size_t)i * e->states);
    }
}

static void scale(int n, double w, const double *from, double *to) {
    for (int i = 0; i < n; i++) to[i] = w * from[i];
}

int am_add_steps(const am_normal *e, const am_residuals *given, size_t steps, const double *A,
                 const double *B) {
    double before[AM_MOST_UNKNOWNS], after[AM_MOST_UNKNOWNS], J[AM_MOST_UNKNOWNS];
    const int n = given->states;
    const int columns = given->columns;
    if (n > e->states || e->states > AM_MOST_UNKNOWNS || columns > AM_MOST_UNKNOWNS) {
        return AM_BAD_ARGUMENT;
    }
    for (size_t row = 0; row < steps * (size_t)given->rows; row++) {
        const size_t k = row / (size_t)given->rows;
        const double w = given->weight[row];
        if (w == 0.0) continue;
        const double r = w * given->r[row];
        scale(n, w, A + row * n, before);
        scale(n, w, B + row * n, after);
        scale(columns, w, given->J + row * columns, J);
        add_to_sample(e, given, k, r, before, J);
        add_to_sample(e, given, k + 1, r, after, J);
        add_to_pair(e, given, k, before, after);
        add_to_constants(e, given, r, J);
    }
    return AM_OK;
}

int am_add_readings(const am_normal *e, const am_residuals *given, size_t readings,
                    const long long *k, const double *f, const double *A) {
    double d[AM_MOST_UNKNOWNS], before[AM_MOST_UNKNOWNS], after[AM_MOST_UNKNOWNS],
        J[AM_MOST_UNKNOWNS];
    const int n = given->states;
    const int columns = given->columns;
    if (n > e->states || e->states > AM_MOST_UNKNOWNS || columns > AM_MOST_UNKNOWNS) {
        return AM_BAD_ARGUMENT;
    }
    for (size_t row = 0; row < readings * (size_t)given->rows; row++) {
        const size_t m = row / (size_t)given->rows;
        const size_t at = (size_t)k[m];
        const double w = given->weight[row];
        const double r = w * given->r[row];
        scale(n, w, A + row * n, d);
        scale(columns, w, given->J + row * columns, J);
        scale(n, 1.0 - f[m], d, before);
        add_to_sample(e, given, at, r, before, J);
        add_to_constants(e, given, r, J);
        if (f[m] == 0.0) continue;
        scale(n, f[m], d, after);
        add_to_sample(e, given, at + 1, r, after, J);
        add_to_pair(e, given, at, before, after);
    }
    return AM_OK;
}

/* ---- elimination of the states --------------------------------------------------------------- */

/* Cholesky factor of the lower half of S, in place; the row that has no positive pivot, or n. */
static int factor(int n, double *S) {
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = S[i * n + j];
            for (int l = 0; l < j; l++) sum -= S[i * n + l] * S[j * n + l];
            if (j < i) S[i * n + j] = sum / S[j * n + j];
            else if (sum > 0.0) S[i * n + i] = sqrt(sum);
            else return i;
        }
    }
    return n;
}

/* M = L^-1 M, rows of the given width. */
static void forward(int n, const double *L, int width, double *M) {
    for (int i = 0; i < n; i++) {
        double *row = M + (size_t)i * width;
        const double *l = L + i * n;
        const double per_pivot = 1.0 / l[i];
        int c = 0;
        for (; c + 4 <= width; c += 4) {
            four sum = AT(row + c);
            for (int j = 0; j < i; j++) sum -= l[j] * AT(M + (size_t)j * width + c);
            PUT(row + c) = sum * per_pivot;
        }
        for (; c < width; c++) {
            for (int j = 0; j < i; j++) row[c] -= l[j] * M[(size_t)j * width + c];
            row[c] *= per_pivot;
        }
    }
}

/* to[j] += sign sum_i M[i][at] M[i][from + j] for j < count */
static inline void add_products(int n, int width, const double *M, double sign, int at, int from,
                                int count, double *to) {
    int c = 0;
    for (; c + 4 <= count; c += 4) {
        four sum = {0.0, 0.0, 0.0, 0.0};
        for (int i = 0; i < n; i++) {
            const double *row = M + (size_t)i * width;
            sum += row[at] * AT(row + from + c);
        }
        PUT(to + c) += sign * sum;
    }
    for (; c < count; c++) {
        double sum = 0.0;
        for (int i = 0; i < n; i++) {
            const double *row = M + (size_t)i * width;
            sum += row[at] * row[from + c];
        }
        to[c] += sign * sum;
    }
}

/* A sample's right-hand sides behind the block that leads to the next sample, which is set. */
static void take_block(const am_normal *e, size_t k, int width, double *M) {
    const int n = e->states;
    const double *O = e->O + k * n * n;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) M[(size_t)i * width + j] = O[j * n + i];
    }
}

static void clear_block(int n, int width, double *M) {
    for (int i = 0; i < n; i++) memset(M + (size_t)i * width, 0, sizeof *M * (size_t)n);
}

/* What the elimination of a sample takes off the next one and off the sums of the border; of these
 * four more than the lower half at most. */
static void reduce(int n, int width, const double *M, double *S, double *next, double *border) {
    const int right = width - n;
    for (int j = 0; S && j < n; j++) {
        add_products(n, width, M, -1.0, j, 0, j + 1, S + j * n);
        add_products(n, width, M, -1.0, j, n, right, next + (size_t)j * width + n);
    }
    for (int j = 0; j < right; j++) {
        const int count = (j + 4) / 4 * 4;
        add_products(n, width, M, 1.0, n + j, n, count < right ? count : right,
                     border + (size_t)j * right);
    }
}

long long am_eliminate(const am_normal *e, size_t samples, double *L, double *M, double *border) {
    const int n = e->states;
    const int width = n + e->constants + 1;
    memcpy(L, e->D, sizeof *L * samples * n * n);
    for (size_t k = 0; k < samples; k++) {
        for (int i = 0; i < n; i++) {
            double *row = M + (k * n + (size_t)i) * width + n;
            memcpy(row, e->G + (k * n + (size_t)i) * e->constants, sizeof *row * e->constants);
            row[e->constants] = e->gx[k * n + (size_t)i];
        }
    }
    for (size_t k = 0; k < samples; k++) {
        double *S = L + k * n * n;
        double *here = M + k * n * width;
        const bool last = k + 1 == samples;
        const int failed = factor(n, S);
        if (failed < n) return (long long)k * n + failed;
        if (last) clear_block(n, width, here);
        else take_block(e, k, width, here);
        forward(n, S, width, here);
        reduce(n, width, here, last ? NULL : S + n * n, here + (size_t)n * width, border);
    }
    return -1;
}

void am_substitute(int states, int constants, size_t samples, const double *L, const double *M,
                   size_t columns, double *x) {
    const int n = states;
    const int width = n + constants + 1;
    for (size_t k = samples; k-- > 0;) {
        const double *V = M + k * n * width;
        double *here = x + k * n * columns;
        const double *next = here + n * columns;
        for (int i = n; i-- > 0;) {
            double *row = here + (size_t)i * columns;
            for (int j = 0; k + 1 < samples && j < n; j++) {
                add_scaled((int)columns, -V[(size_t)i * width + j], next + j * columns, row);
            }
            for (int j = i + 1; j < n; j++) {
                add_scaled((int)columns, -L[(k * n + (size_t)j) * n + i], here + j * columns, row);
            }
            scale((int)columns, 1.0 / L[(k * n + (size_t)i) * n + i], row, row);
        }
    }
}
