/* The loops over tables for x86-64 with AVX2; without fused multiply-add, which would round once
 * where others round twice. */
#if defined(__x86_64__) && !defined(AM_PLAIN)

#define AGAIN avx2

#include "tables_avx2.h"

#include "elementary.h"
#include "nodes.h"
#include "simulation.h"
#include "cells.h"

#include <math.h>
#include <string.h>

#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)

#include "block.h"
#include "locate.h"

void look_up_avx2(am_sim *sim, int stage) { look_up_stage(sim, stage); }

void evaluate_avx2(const block_t *b, size_t rows, const double *v, double *coefficients,
                   double *terms) {
    evaluate_block(b, rows, v, coefficients, terms);
}

#pragma clang attribute pop

#endif
