/* The loops over tables exist twice: for any processor of the platform, and for x86-64 with AVX2
 * (avx2.c).  A model takes its pair when it is loaded.  Both do the same operations on the same
 * numbers: the results have the same bits. */
#include "versions.h"

#include "avx2.h"
#include "block.h"
#include "locate.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)
#include <cpuid.h>

/* Lanes of doubles that the processor and an operating system that keeps its registers allow: four
 * with AVX2, eight with AVX-512. */
static int lanes_here(void) {
    const unsigned osxsave_avx = 3u << 27;
    const unsigned avx2 = 1u << 5;
    const unsigned avx512 = 1u << 16 | 1u << 17 | 1u << 30 | 1u << 31; /* F, DQ, BW, VL */
    const unsigned xmm_ymm = 0x6;
    const unsigned xmm_ymm_zmm = 0xe6;
    unsigned a, b, c, d, saved, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & osxsave_avx) != osxsave_avx) return 1;
    __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    if ((saved & xmm_ymm) != xmm_ymm || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & avx2)) {
        return 1;
    }
    return (saved & xmm_ymm_zmm) == xmm_ymm_zmm && (b & avx512) == avx512 ? 8 : 4;
}
#endif

static void look_up_plain(am_sim *sim, int stage, uint64_t changed) {
    look_up_stage(sim, stage, changed);
}

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
