/* The loops of normal_groups.h and normal_elimination.h for x86-64 with AVX2. */
#ifndef AEROMATCH_NORMAL_AVX2_H
#define AEROMATCH_NORMAL_AVX2_H

#include "kernel.h"

void add_groups_avx2(const am_normal *e, size_t samples, const am_residual_group *group,
                     int groups);
long long eliminate_avx2(const am_normal *e, size_t samples, double *L, double *V, double *right,
                         double *border);
void substitute_avx2(int states, size_t samples, const double *L, const double *V, size_t columns,
                     double *x);

#endif
