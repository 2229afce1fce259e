/* The loops over tables exist twice: for any processor of the platform, and for x86-64 with AVX2
 * (avx2.c).  A model takes its pair when it is loaded.  Both do the same operations on the same
 * numbers: the results have the same bits. */
#include "versions.h"

#include "avx2.h"
#include "block.h"
#include "locate.h"
#include "processor.h"

static void look_up_plain(am_sim *sim, int stage) { look_up_stage(sim, stage); }

static void evaluate_plain(const block_t *b, size_t rows, const double *v, double *coefficients,
                           double *terms) {
    evaluate_block(b, rows, v, coefficients, terms);
}

versions_t best_versions(void) {
#if defined(__x86_64__) && !defined(AM_PLAIN)
    const int lanes = lanes_here();
    if (lanes > 1) return (versions_t){look_up_avx2, evaluate_avx2, lanes};
#endif
    return (versions_t){look_up_plain, evaluate_plain, 1};
}
