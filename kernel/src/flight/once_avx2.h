/* Step and derivative of one simulation in the version that the processor allows: the same bits. */
#ifndef AEROMATCH_ONCE_AVX2_H
#define AEROMATCH_ONCE_AVX2_H

#include "one_step.h"
#include "sixdof.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)

bool one_step_avx2(am_sim *sim, double t, double h, const double *u0, const double *u1, double s0,
                   double s1);
void derivative_avx2(am_sim *sim, const double *x, const double *u, double *dx);

/* lanes_here of versions.c has found AVX2. */
static inline bool has_avx2(const am_sim *sim) { return sim->model->versions.lanes > 1; }

#else

#define one_step_avx2 one_step
#define derivative_avx2 derivative

static inline bool has_avx2(const am_sim *sim) { return sim == NULL; }

#endif

static inline bool best_step(am_sim *sim, double t, double h, const double *u0, const double *u1,
                             double s0, double s1) {
    return has_avx2(sim) ? one_step_avx2(sim, t, h, u0, u1, s0, s1)
                         : one_step(sim, t, h, u0, u1, s0, s1);
}

static inline void best_derivative(am_sim *sim, const double *x, const double *u, double *dx) {
    if (has_avx2(sim)) derivative_avx2(sim, x, u, dx);
    else derivative(sim, x, u, dx);
}

#endif
