/* The loops over tables exist twice: for any processor of the platform, and for x86-64 with AVX2
 * (avx2.c).  A model takes its pair when it is loaded.  Both do the same operations on the same
 * numbers: the results have the same bits. */
#include "versions.h"

#include "avx2.h"
#include "block.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)
#include <cpuid.h>

/* AVX2, and an operating system that keeps its registers. */
static bool has_avx2(void) {
    const unsigned osxsave_avx = 3u << 27;
    const unsigned avx2 = 1u << 5;
    const unsigned xmm_ymm = 6;
    unsigned a, b, c, d, saved, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & osxsave_avx) != osxsave_avx) return false;
    __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    return (saved & xmm_ymm) == xmm_ymm && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & avx2);
}
#endif

static void interpolate_plain(am_sim *sim, int stage) { interpolate_stage(sim, stage); }

static void evaluate_plain(const block_t *b, size_t rows, const double *v, double *coefficients,
                           double *terms) {
    evaluate_block(b, rows, v, coefficients, terms);
}

versions_t best_versions(void) {
#if defined(__x86_64__) && !defined(AM_PLAIN)
    if (has_avx2()) return (versions_t){interpolate_avx2, evaluate_avx2};
#endif
    return (versions_t){interpolate_plain, evaluate_plain};
}
