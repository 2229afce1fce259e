/* Step and derivative of one simulation in the version that the processor allows: the same bits. */
#ifndef AEROMATCH_ONCE_AVX2_H
#define AEROMATCH_ONCE_AVX2_H

#include "one_step.h"
#include "sixdof.h"
#include "tables_avx2.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)

bool one_step_avx2(am_sim *sim, double t, double h, const double *u0, const double *u1, double s0,
                   double s1);
void derivative_avx2(am_sim *sim, const double *x, const double *u, double *dx);

#else

#define one_step_avx2 one_step
#define derivative_avx2 derivative

#endif

static inline bool best_step(am_sim *sim, double t, double h, const double *u0, const double *u1,
                             double s0, double s1) {
    return has_avx2(sim->model) ? one_step_avx2(sim, t, h, u0, u1, s0, s1)
                                : one_step(sim, t, h, u0, u1, s0, s1);
}

static inline void best_derivative(am_sim *sim, const double *x, const double *u, double *dx) {
    if (has_avx2(sim->model)) derivative_avx2(sim, x, u, dx);
    else derivative(sim, x, u, dx);
}

#endif
