/* The loops over tables for x86-64 with AVX2. */
#ifndef AEROMATCH_AVX2_H
#define AEROMATCH_AVX2_H

#include "model.h"

/* Tables of a stage, as look_up_stage. */
void look_up_avx2(am_sim *sim, int stage);

/* A block of rows, as evaluate_block. */
void evaluate_avx2(const struct block *b, size_t rows, const double *v, double *coefficients,
                   double *terms);

#endif
