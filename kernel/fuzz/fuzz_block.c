/* libFuzzer: any bytes as a model block, behind a header and a checksum that agree; what is
 * accepted is flown. */
#include "drive.h"

#include <stdlib.h>
#include <string.h>

enum { HEADER = 32, ENTRY = 16, SECTIONS = 13, NAMES = 12, CALLS = 12 };
enum { DIRECTORY = HEADER + ENTRY * SECTIONS };

/* A block with a validity envelope has one section more. */
static uint32_t sections_of(const uint8_t *block, size_t n) {
    uint32_t stated;
    memcpy(&stated, block + 28, sizeof stated);
    return stated == SECTIONS + 1 && n >= DIRECTORY + ENTRY ? stated : SECTIONS;
}

size_t LLVMFuzzerMutate(uint8_t *data, size_t n, size_t most);

/* magic, format, endian mark, size, CRC-32, sections */
static void seal(uint8_t *block, size_t n) {
    const uint32_t words[] = {(uint32_t)am_format(), 0x01020304, (uint32_t)n, 0};
    const uint32_t sections = sections_of(block, n);
    memcpy(block, "AMKERNEL", 8);
    memcpy(block + 8, words, sizeof words);
    memcpy(block + 28, &sections, sizeof sections);
    const uint32_t crc = crc32(block + 28, n - 28);
    memcpy(block + 24, &crc, sizeof crc);
}

/* Every function once or more, chosen by the checksum. */
static void fly(const am_model *m, uint32_t seed) {
    uint8_t choices[CALLS * 16];
    am_sim *sim = am_new(m);
    if (!sim) return;
    for (size_t i = 0; i < sizeof choices; i++) {
        seed = seed * 1664525u + 1013904223u;
        choices[i] = (uint8_t)(seed >> 24);
    }
    bytes_t bytes = {choices, sizeof choices};
    am_set_parameter(sim, am_find(m, AM_PARAMETER, "init.V"), 80.0);
    am_initialize(sim, 0.0);
    for (int k = 0; k < CALLS; k++) call_kernel(m, sim, &bytes);
    am_delete(sim);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n) {
    char text[300] = "";
    uint8_t *block = malloc(n ? n : 1);
    if (!block) return 0;
    if (n) memcpy(block, data, n);
    if (n >= DIRECTORY) seal(block, n);
    am_model *m = am_load(block, n, text, sizeof text);
    promise(m || text[0], "a refusal has a text");
    free(block); /* the model has its own copy */
    if (m) fly(m, crc32(data, n));
    am_free(m);
    return 0;
}

/* One word of one section of a whole block; the names, which are most of the bytes, are left
 * alone. */
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t n, size_t most, unsigned seed) {
    static const uint32_t WORD[] = {
        0,         1,     2,        3,          4,          7,           16,
        255,       65535, 1u << 20, 0x3FF00000, 0x7FF00000, 0x80000000u, UINT32_MAX - 1,
        UINT32_MAX};
    uint64_t place[2];
    if (n < DIRECTORY || seed % 8 == 0) return LLVMFuzzerMutate(data, n, most);
    srand(seed);
    const uint32_t sections = sections_of(data, n);
    for (int edits = 1 + rand() % 3; edits > 0; edits--) {
        size_t section = (size_t)rand() % (sections - 1);
        if (section >= NAMES) section++;
        memcpy(place, data + HEADER + ENTRY * section, sizeof place);
        const size_t records = place[0] < n ? n - (size_t)place[0] : 0;
        const size_t at = rand() % 8 ? (size_t)place[0] + 4 * (size_t)(rand() % 64)
                                     : HEADER + (size_t)rand() % (ENTRY * sections);
        if (records < 4 || at + 4 > n) continue;
        uint32_t word;
        memcpy(&word, data + at, sizeof word);
        word = rand() % 2   ? WORD[(size_t)rand() % (sizeof WORD / sizeof *WORD)]
               : rand() % 2 ? word + (uint32_t)(rand() % 5) - 2
                            : word ^ 1u << rand() % 32;
        memcpy(data + at, &word, sizeof word);
    }
    return n;
}
