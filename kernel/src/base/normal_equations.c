/* Normal equations of a trajectory with constants: sums over residuals, and the elimination of the
 * states.  The loops exist twice, for any processor of the platform and for x86-64 with AVX2
 * (normal_avx2.c).  Both do the same operations on the same numbers: the results have the same
 * bits. */
#include "normal_avx2.h"
#include "normal_elimination.h"
#include "normal_groups.h"
#include "processor.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)
#define BEST(name, ...) (lanes_here() > 1 ? name##_avx2(__VA_ARGS__) : name(__VA_ARGS__))
#else
#define BEST(name, ...) name(__VA_ARGS__)
#endif

static bool allowed(const am_normal *e, const am_residual_group *group) {
    const am_residuals *given = &group->given;
    return given->states <= e->states && given->columns <= AM_MOST_UNKNOWNS
           && (!group->path || (given->rows == PATH_ROWS && given->states == PATH_ROWS));
}

int am_add_residuals(const am_normal *e, size_t samples, const am_residual_group *group,
                     int groups) {
    if (groups > AM_MOST_GROUPS || e->states > AM_MOST_UNKNOWNS) return AM_BAD_ARGUMENT;
    for (int i = 0; i < groups; i++) {
        if (!allowed(e, group + i)) return AM_BAD_ARGUMENT;
    }
    BEST(add_groups, e, samples, group, groups);
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
