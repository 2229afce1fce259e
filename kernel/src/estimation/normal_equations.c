/* Normal equations of a trajectory with constants: sums over residuals, and the elimination of the
 * states.  The loops exist twice, for any processor of the platform and for x86-64 with AVX2
 * (normal_avx2.c).  Both do the same operations on the same numbers: the results have the same
 * bits. */
#include "driven_path.h"
#include "driven_sums.h"
#include "normal_avx2.h"
#include "normal_elimination.h"
#include "normal_groups.h"
#include "processor.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)
#define BEST(name, ...) (lanes_here() > 1 ? name##_avx2(__VA_ARGS__) : name(__VA_ARGS__))
#else
#define BEST(name, ...) name(__VA_ARGS__)
#endif

static bool sound(const am_drive *d, size_t samples) {
    const int states = PATH_ROWS + d->vanes + (d->gusts ? 3 : 0);
    if (d->vanes < 0 || d->vanes > DRIVEN_VANES || d->states < states) return false;
    if (d->inputs < 0 || d->inputs > AM_LAG + 1 || samples == 0) return false;
    for (int i = 0; i < d->vanes; i++) {
        if (d->side[i] != 1 && d->side[i] != 2) return false;
    }
    for (int i = 0; i < d->inputs; i++) {
        if (d->input[i] < AM_BIAS || d->input[i] > AM_LAG) return false;
    }
    return true;
}

/* Nothing but attitude, velocity, height and vanes. */
static bool plain(const am_drive *d) { return !d->gusts && d->states == PATH_ROWS + d->vanes; }

static bool allowed(const am_normal *e, const am_residual_group *group) {
    const am_residuals *given = &group->given;
    const am_drive *d = group->drive;
    if (given->states > e->states || given->columns > AM_MOST_UNKNOWNS) return false;
    return !d
           || (sound(d, group->count) && given->rows == PATH_ROWS + d->vanes
               && d->states == e->states && given->states == given->rows + (d->gusts ? 3 : 0)
               && given->columns == d->inputs);
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
    if (e->states < 1 || e->states > AM_MOST_UNKNOWNS || e->constants < 0) return -2;
    return BEST(eliminate_samples, e, samples, L, V, right, border);
}

void am_substitute(int states, size_t samples, const double *L, const double *V, size_t columns,
                   double *x) {
    BEST(substitute, states, samples, L, V, columns, x);
}

int am_follow(const am_drive *d, size_t samples, const double *start, double *x, double *X) {
    if (!sound(d, samples) || !plain(d)) return AM_BAD_ARGUMENT;
    BEST(follow_path, d, samples, start, x, X);
    return AM_OK;
}

int am_add_driven(const am_driven *d, const am_residual_group *group, double *products,
                  double *series, double *pressed) {
    if (d->unknowns > 3 * AM_MOST_UNKNOWNS || group->given.states > d->states) {
        return AM_BAD_ARGUMENT;
    }
    BEST(add_driven, d, group, products, series, pressed);
    return AM_OK;
}

int am_add_noise(const am_drive *d, size_t samples, const double *x, int unknowns,
                 const double *noise, const double *pressed, double *products) {
    if (!sound(d, samples) || !plain(d) || unknowns > 3 * AM_MOST_UNKNOWNS) return AM_BAD_ARGUMENT;
    BEST(add_noise, d, samples, x, unknowns, noise, pressed, products);
    return AM_OK;
}
