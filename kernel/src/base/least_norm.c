#include "least_norm.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#define STEPS 100
#define ATTEMPTS 24   /* tenfold dampings of one step */
#define NOTHING 1e-26 /* sum of squares that counts as solved */
/* Sum of squares below which a step that fails, or gains less than half, only meets the rounding of
 * the residual: struts and tyres that are iterated leave 1e-19 to 2e-14, and steps in that scatter
 * lead nowhere, however many are made. */
#define ROUNDING 1e-13
/* The slopes are used again after a step that moves no unknown further than SMALL and leaves no
 * more than WELL of the sum of squares. */
#define SMALL 1e-2
#define WELL 1e-3

static double evaluate(const system_t *s, const double *z, double *r) {
    double sum = 0.0;
    s->residual(s->task, z, r);
    for (int i = 0; i < s->equations; i++) sum += r[i] * r[i];
    return sum;
}

void differences(const system_t *s, const double *z, jacobian_t J) {
    for (int j = 0; j < s->unknowns; j++) {
        double moved[LARGEST_SYSTEM], up[LARGEST_SYSTEM], down[LARGEST_SYSTEM];
        memcpy(moved, z, sizeof(double) * (size_t)s->unknowns);
        moved[j] = z[j] + NUDGE;
        evaluate(s, moved, up);
        moved[j] = z[j] - NUDGE;
        evaluate(s, moved, down);
        for (int i = 0; i < s->equations; i++) J[i][j] = (up[i] - down[i]) / (2.0 * NUDGE);
    }
}

/* The same one-sided, from the residual r at z, which takes half the time, and inwards, since what
 * lies beyond a limit may not move anything; none for an unknown that its limits hold. */
static void one_sided(const system_t *s, const double *z, const double *r, jacobian_t J) {
    double moved[LARGEST_SYSTEM], there[LARGEST_SYSTEM];
    memcpy(moved, z, sizeof(double) * (size_t)s->unknowns);
    for (int j = 0; j < s->unknowns; j++) {
        const bool held = s->low[j] == s->high[j];
        const double nudge = z[j] + NUDGE > s->high[j] ? -NUDGE : NUDGE;
        moved[j] = z[j] + nudge;
        if (!held) evaluate(s, moved, there);
        for (int i = 0; i < s->equations; i++) J[i][j] = held ? 0.0 : (there[i] - r[i]) / nudge;
        moved[j] = z[j];
    }
}

/* Cholesky solution of the positive definite A y = r, in place. */
static bool solve(int n, jacobian_t A, double *r) {
    for (int j = 0; j < n; j++) {
        for (int k = 0; k < j; k++) A[j][j] -= A[j][k] * A[j][k];
        if (!(A[j][j] > 0.0)) return false;
        A[j][j] = sqrt(A[j][j]);
        for (int i = j + 1; i < n; i++) {
            for (int k = 0; k < j; k++) A[i][j] -= A[i][k] * A[j][k];
            A[i][j] /= A[j][j];
        }
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++) r[i] -= A[i][k] * r[k];
        r[i] /= A[i][i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++) r[i] -= A[k][i] * r[k];
        r[i] /= A[i][i];
    }
    return true;
}

static bool minimum_norm_step(const system_t *s, jacobian_t J, const bool *free, const double *r,
                              double lambda, double *dz) {
    const int n = s->equations;
    jacobian_t A;
    double y[LARGEST_SYSTEM];
    double trace = 0.0;
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < n; k++) {
            A[i][k] = 0.0;
            for (int j = 0; j < s->unknowns; j++) A[i][k] += free[j] ? J[i][j] * J[k][j] : 0.0;
        }
    }
    for (int i = 0; i < n; i++) trace += A[i][i];
    for (int i = 0; i < n; i++) A[i][i] += lambda * trace + DBL_MIN;
    memcpy(y, r, sizeof(double) * (size_t)n);
    if (!solve(n, A, y)) return false;
    for (int j = 0; j < s->unknowns; j++) {
        dz[j] = 0.0;
        for (int i = 0; i < n; i++) dz[j] -= free[j] ? J[i][j] * y[i] : 0.0;
    }
    return true;
}

/* The step to `next`, unknowns that press against a limit taken out; false when the equations
 * cannot be solved. */
static bool step_inside(const system_t *s, jacobian_t J, const double *z, const double *r,
                        double lambda, double *next) {
    bool free[LARGEST_SYSTEM];
    bool moved = true;
    double dz[LARGEST_SYSTEM];
    for (int j = 0; j < s->unknowns; j++) free[j] = true;
    while (moved) {
        if (!minimum_norm_step(s, J, free, r, lambda, dz)) return false;
        moved = false;
        for (int j = 0; j < s->unknowns; j++) {
            next[j] = z[j] + dz[j];
            const bool stuck = (z[j] >= s->high[j] && dz[j] > 0.0)
                               || (z[j] <= s->low[j] && dz[j] < 0.0);
            if (free[j] && stuck) {
                free[j] = false;
                moved = true;
            }
            next[j] = next[j] > s->high[j] ? s->high[j] : next[j] < s->low[j] ? s->low[j] : next[j];
        }
    }
    return true;
}

/* One accepted step by slopes J, of which `attempts` dampings are tried; the furthest that an
 * unknown moved, or a negative number when no step makes the residual smaller. */
static double improve(const system_t *s, jacobian_t J, int attempts, double *z, double *r,
                      double *size, double *lambda) {
    for (int attempt = 0; attempt < attempts; attempt++, *lambda *= 10.0) {
        double next[LARGEST_SYSTEM], r_next[LARGEST_SYSTEM];
        double furthest = 0.0;
        if (!step_inside(s, J, z, r, *lambda, next)) continue;
        const double size_next = evaluate(s, next, r_next);
        if (!(size_next < *size)) continue;
        for (int j = 0; j < s->unknowns; j++) furthest = fmax(furthest, fabs(next[j] - z[j]));
        memcpy(z, next, sizeof(double) * (size_t)s->unknowns);
        memcpy(r, r_next, sizeof(double) * (size_t)s->equations);
        *size = size_next;
        *lambda = *lambda > 1e-14 ? *lambda * 0.01 : *lambda;
        return furthest;
    }
    return -1.0;
}

/* The first slopes are central: many a start, such as a sideslip of zero, is a node of a table, and
 * the slopes of one side of it would lead the other way round. */
double least_norm(const system_t *s, double *z) {
    jacobian_t J;
    double r[LARGEST_SYSTEM];
    double lambda = 1e-6;
    double size = evaluate(s, z, r);
    bool reuse = false;
    for (int i = 0; i < STEPS && size > NOTHING; i++) {
        const double before = size;
        const double damping = lambda;
        if (i == 0 || s->nearest) differences(s, z, J);
        else if (!reuse) one_sided(s, z, r, J);
        const int attempts = reuse || size < ROUNDING ? 1 : ATTEMPTS;
        const double moved = improve(s, J, attempts, z, r, &size, &lambda);
        if (moved < 0.0 && !reuse) break;
        if (moved < 0.0) lambda = damping; /* by slopes of here */
        else if (size < ROUNDING && size > 0.5 * before) break;
        reuse = !s->nearest && moved >= 0.0 && moved < SMALL && size < WELL * before;
    }
    return size;
}
