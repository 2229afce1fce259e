/* The loops of normal_groups.h and normal_elimination.h for x86-64 with AVX2; without
 * fused multiply-add, which would round once where others round twice. */
#include "normal_avx2.h"

#include "elementary.h"
#include "four.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#if defined(__x86_64__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)

#include "driven_path.h"
#include "driven_sums.h"
#include "normal_elimination.h"
#include "normal_groups.h"

void add_groups_avx2(const am_normal *e, size_t samples, const am_residual_group *group,
                     int groups) {
    add_groups(e, samples, group, groups);
}

long long eliminate_samples_avx2(const am_normal *e, size_t samples, double *L, double *V,
                                 double *right, double *border) {
    return eliminate_samples(e, samples, L, V, right, border);
}

void substitute_avx2(int states, size_t samples, const double *L, const double *V, size_t columns,
                     double *x) {
    substitute(states, samples, L, V, columns, x);
}

void follow_path_avx2(const am_drive *d, size_t samples, const double *start, double *x,
                      double *X) {
    follow_path(d, samples, start, x, X);
}

void add_driven_avx2(const am_driven *d, const am_residual_group *group, double *products,
                     double *series, double *pressed) {
    add_driven(d, group, products, series, pressed);
}

void add_noise_avx2(const am_drive *d, size_t samples, const double *x, int unknowns,
                    const double *noise, const double *pressed, double *products) {
    add_noise(d, samples, x, unknowns, noise, pressed, products);
}

#pragma clang attribute pop
#endif
