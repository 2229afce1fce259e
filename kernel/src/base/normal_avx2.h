/* The loops of normal_sums.h, path_steps.h and normal_elimination.h for x86-64 with AVX2. */
#ifndef AEROMATCH_NORMAL_AVX2_H
#define AEROMATCH_NORMAL_AVX2_H

#include "kernel.h"

void add_steps_avx2(const am_normal *e, const am_residuals *given, size_t steps, const double *A,
                    const double *B);
void add_path_steps_avx2(const am_normal *e, const am_residuals *given, const am_path *path,
                         size_t steps);
void add_readings_avx2(const am_normal *e, const am_residuals *given, size_t readings,
                       const long long *k, const double *f, const double *A);
long long eliminate_avx2(const am_normal *e, size_t samples, double *L, double *V, double *right,
                         double *border);
void substitute_avx2(int states, size_t samples, const double *L, const double *V, size_t columns,
                     double *x);

#endif
