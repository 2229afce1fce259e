/* The loops of normal_groups.h, normal_elimination.h and driven_sums.h for x86-64 with AVX2. */
#ifndef AEROMATCH_NORMAL_AVX2_H
#define AEROMATCH_NORMAL_AVX2_H

#include "kernel.h"

void add_groups_avx2(const am_normal *e, size_t samples, const am_residual_group *group,
                     int groups);
long long eliminate_samples_avx2(const am_normal *e, size_t samples, double *L, double *V,
                                 double *right, double *border);
void substitute_avx2(int states, size_t samples, const double *L, const double *V, size_t columns,
                     double *x);
void follow_path_avx2(const am_drive *d, size_t samples, const double *start, double *x, double *X);
void add_driven_avx2(const am_driven *d, const am_residual_group *group, double *products,
                     double *series, double *pressed);
void add_noise_avx2(const am_drive *d, size_t samples, const double *x, int unknowns,
                    const double *noise, const double *pressed, double *products);

#endif
