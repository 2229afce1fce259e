#include "sha256.h"

#include <stdint.h>
#include <string.h>

static const uint32_t K[64] = {
    /* FIPS 180-4, 4.2.2 */
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

static uint32_t rotate_right(uint32_t x, int n) { return x >> n | x << (32 - n); }

/* w[t + 16] from the sixteen before it, in their place; FIPS 180-4, 6.2.2. */
static void expand(uint32_t w[16]) {
    for (int i = 0; i < 16; i++) {
        uint32_t x = w[(i + 1) & 15];
        uint32_t y = w[(i + 14) & 15];
        w[i] += (rotate_right(x, 7) ^ rotate_right(x, 18) ^ x >> 3) + w[(i + 9) & 15];
        w[i] += rotate_right(y, 17) ^ rotate_right(y, 19) ^ y >> 10;
    }
}

/* Eight rounds; the names of the words turn, so that none has to be moved. */
static void rounds(uint32_t v[8], const uint32_t *w, const uint32_t *k) {
    for (int i = 0; i < 8; i++) {
        uint32_t a = v[-i & 7];
        uint32_t b = v[(1 - i) & 7];
        uint32_t c = v[(2 - i) & 7];
        uint32_t e = v[(4 - i) & 7];
        uint32_t f = v[(5 - i) & 7];
        uint32_t g = v[(6 - i) & 7];
        uint32_t t = v[(7 - i) & 7] + k[i] + w[i];
        t += (rotate_right(e, 6) ^ rotate_right(e, 11) ^ rotate_right(e, 25)) + (g ^ (e & (f ^ g)));
        v[(3 - i) & 7] += t;
        v[(7 - i) & 7] = t + (rotate_right(a, 2) ^ rotate_right(a, 13) ^ rotate_right(a, 22))
                         + ((a & b) | (c & (a | b)));
    }
}

static void absorb_portable(uint32_t s[8], const unsigned char *bytes, size_t blocks) {
    for (; blocks; blocks--, bytes += 64) {
        uint32_t v[8], w[16];
        memcpy(v, s, sizeof v);
        for (int i = 0; i < 16; i++) {
            w[i] = (uint32_t)bytes[4 * i] << 24 | (uint32_t)bytes[4 * i + 1] << 16
                   | (uint32_t)bytes[4 * i + 2] << 8 | bytes[4 * i + 3];
        }
        for (int i = 0; i < 64; i += 16) {
            if (i) expand(w);
            rounds(v, w, K + i);
            rounds(v, w + 8, K + i + 8);
        }
        for (int i = 0; i < 8; i++) s[i] += v[i];
    }
}

#ifdef __x86_64__
#include <cpuid.h>
#include <immintrin.h>

/* The processor has SHA (bit 29 of EBX in leaf 7), SSSE3 and SSE4.1 (bits 9, 19 of ECX in leaf 1).
   Looked up once: a virtual machine takes some 50 microseconds for each leaf. */
static int has_instructions(void) {
    static _Atomic int known; /* 0: not yet, 1: no, 2: yes */
    if (!known) {
        unsigned a, b, c, d;
        int yes = __get_cpuid(1, &a, &b, &c, &d) && (c >> 9 & 1) && (c >> 19 & 1);
        known = 1 + (yes && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b >> 29 & 1));
    }
    return known == 2;
}

#define BY_INSTRUCTIONS __attribute__((target("sha,sse4.1,ssse3")))

static BY_INSTRUCTIONS __m128i big_endian(const unsigned char *bytes) {
    const __m128i order = _mm_set_epi64x(0x0c0d0e0f08090a0b, 0x0405060700010203);
    return _mm_shuffle_epi8(_mm_loadu_si128((const __m128i *)bytes), order);
}

static BY_INSTRUCTIONS void absorb_instructions(uint32_t s[8], const unsigned char *bytes,
                                                size_t blocks) {
    __m128i low = _mm_shuffle_epi32(_mm_loadu_si128((const __m128i *)s), 0xb1);
    __m128i high = _mm_shuffle_epi32(_mm_loadu_si128((const __m128i *)(s + 4)), 0x1b);
    __m128i abef = _mm_alignr_epi8(low, high, 8);
    __m128i cdgh = _mm_blend_epi16(high, low, 0xf0);
    for (; blocks; blocks--, bytes += 64) {
        __m128i abef_before = abef;
        __m128i cdgh_before = cdgh;
        __m128i w[4];
        for (int i = 0; i < 4; i++) w[i] = big_endian(bytes + 16 * i);
        for (int i = 0; i < 16; i++) {
            if (i >= 4) { /* w[t] of four t at once */
                __m128i sum = _mm_add_epi32(_mm_sha256msg1_epu32(w[i & 3], w[(i + 1) & 3]),
                                            _mm_alignr_epi8(w[(i + 3) & 3], w[(i + 2) & 3], 4));
                w[i & 3] = _mm_sha256msg2_epu32(sum, w[(i + 3) & 3]);
            }
            __m128i t = _mm_add_epi32(w[i & 3], _mm_loadu_si128((const __m128i *)(K + 4 * i)));
            cdgh = _mm_sha256rnds2_epu32(cdgh, abef, t);
            abef = _mm_sha256rnds2_epu32(abef, cdgh, _mm_shuffle_epi32(t, 0x0e));
        }
        abef = _mm_add_epi32(abef, abef_before);
        cdgh = _mm_add_epi32(cdgh, cdgh_before);
    }
    low = _mm_shuffle_epi32(abef, 0x1b);
    high = _mm_shuffle_epi32(cdgh, 0xb1);
    _mm_storeu_si128((__m128i *)s, _mm_blend_epi16(low, high, 0xf0));
    _mm_storeu_si128((__m128i *)(s + 4), _mm_alignr_epi8(high, low, 8));
}

static void absorb(uint32_t s[8], const unsigned char *bytes, size_t blocks) {
    (has_instructions() ? absorb_instructions : absorb_portable)(s, bytes, blocks);
}
#else
static void absorb(uint32_t s[8], const unsigned char *bytes, size_t blocks) {
    absorb_portable(s, bytes, blocks);
}
#endif

void sha256_hex(const unsigned char *bytes, size_t n, char text[65]) {
    uint32_t h[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                     0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    unsigned char last[128] = {0};
    size_t whole = n / 64 * 64;
    size_t rest = n - whole;
    size_t length = rest < 56 ? 64 : 128;
    absorb(h, bytes, whole / 64);
    if (rest) memcpy(last, bytes + whole, rest);
    last[rest] = 0x80;
    for (int i = 0; i < 8; i++) last[length - 1 - i] = (unsigned char)((uint64_t)n * 8 >> 8 * i);
    absorb(h, last, length / 64);
    for (int i = 0; i < 64; i++) text[i] = "0123456789abcdef"[h[i / 8] >> (28 - 4 * (i % 8)) & 15];
    text[64] = 0;
}
