/* Normal equations of a trajectory with constants: sums over residuals, and the elimination of the
 * states.  The loops exist twice, for any processor of the platform and for x86-64 with AVX2
 * (normal_avx2.c).  Both do the same operations on the same numbers: the results have the same
 * bits. */
#include "normal_avx2.h"
#include "normal_elimination.h"
#include "normal_sums.h"
#include "path_steps.h"
#include "processor.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)
#define BEST(name, ...) (lanes_here() > 1 ? name##_avx2(__VA_ARGS__) : name(__VA_ARGS__))
#else
#define BEST(name, ...) name(__VA_ARGS__)
#endif

static bool too_many(const am_normal *e, const am_residuals *given) {
    return given->states > e->states || e->states > AM_MOST_UNKNOWNS
           || given->columns > AM_MOST_UNKNOWNS;
}

int am_add_steps(const am_normal *e, const am_residuals *given, size_t steps, const double *A,
                 const double *B) {
    if (too_many(e, given)) return AM_BAD_ARGUMENT;
    BEST(add_steps, e, given, steps, A, B);
    return AM_OK;
}

int am_add_path_steps(const am_normal *e, const am_residuals *given, const am_path *path,
                      size_t steps) {
    if (too_many(e, given) || given->rows != PATH_ROWS || given->states != PATH_ROWS) {
        return AM_BAD_ARGUMENT;
    }
    BEST(add_path_steps, e, given, path, steps);
    return AM_OK;
}

int am_add_readings(const am_normal *e, const am_residuals *given, size_t readings,
                    const long long *k, const double *f, const double *A) {
    if (too_many(e, given)) return AM_BAD_ARGUMENT;
    BEST(add_readings, e, given, readings, k, f, A);
    return AM_OK;
}

long long am_eliminate(const am_normal *e, size_t samples, double *L, double *V, double *right,
                       double *border) {
    return BEST(eliminate, e, samples, L, V, right, border);
}

void am_substitute(int states, size_t samples, const double *L, const double *V, size_t columns,
                   double *x) {
    BEST(substitute, states, samples, L, V, columns, x);
}
