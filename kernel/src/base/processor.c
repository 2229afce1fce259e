#include "processor.h"

#if defined(__x86_64__) && !defined(AM_PLAIN)
#include <cpuid.h>

static int looked_up(void) {
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
#else
static int looked_up(void) { return 1; }
#endif

/* A virtual machine takes some 50 microseconds for each question to the processor. */
int lanes_here(void) {
    static _Atomic int known; /* 0: not yet */
    if (!known) known = looked_up();
    return known;
}
