/* The loops over tables for x86-64 with AVX2: the same bits as without. */
#ifndef AEROMATCH_TABLES_AVX2_H
#define AEROMATCH_TABLES_AVX2_H

#include "model.h"

struct block;

#if defined(__x86_64__) && !defined(AM_PLAIN)

static inline bool has_avx2(const am_model *m) { return m->lanes > 1; }

/* Tables of a stage, as look_up_stage. */
void look_up_avx2(am_sim *sim, int stage);

/* A block of rows, as evaluate_block. */
void evaluate_avx2(const struct block *b, size_t rows, const double *v, double *coefficients,
                   double *terms);

#else

static inline bool has_avx2(const am_model *m) { return m == NULL; }

#define look_up_avx2 look_up_stage
#define evaluate_avx2 evaluate_block

#endif

#endif
