/* The frame of a packed block: header, CRC-32, directory, strings. */
#include "block_reader.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ENDIAN_MARK 0x01020304u

typedef struct {
    char magic[8];
    uint32_t format, endian;
    uint64_t size;
    uint32_t crc, sections;
} header_t;

typedef struct {
    uint64_t offset, count;
} section_t;

static const size_t RECORD[ALL_SECTIONS] = {
    sizeof(geometry_record),
    sizeof(entry_record),
    sizeof(entry_record),
    sizeof(entry_record),
    sizeof(entry_record),
    sizeof(entry_record),
    sizeof(axis_record),
    sizeof(double),
    sizeof(bundle_record),
    sizeof(double),
    sizeof(term_record),
    sizeof(item_record),
    1,
    1,
};

static const char *const SECTION_NAME[ALL_SECTIONS] = {
    "geometry", "inputs",  "outputs", "parameters", "states", "variables", "axes",
    "points",   "bundles", "nodes",   "terms",      "items",  "strings",
    "envelope",
};

const char *section_name(int section) { return SECTION_NAME[section]; }

bool refuse_block(reader *r, const char *format, ...) {
    if (r->err && r->nerr) {
        va_list list;
        va_start(list, format);
        vsnprintf(r->err, r->nerr, format, list);
        va_end(list);
    }
    return false;
}

static uint32_t crc32_of(const unsigned char *bytes, size_t n) {
    uint32_t table[256];
    uint32_t crc = 0xFFFFFFFFu;
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int bit = 0; bit < 8; bit++) c = c & 1 ? 0xEDB88320u ^ (c >> 1) : c >> 1;
        table[i] = c;
    }
    for (size_t i = 0; i < n; i++) crc = table[(crc ^ bytes[i]) & 0xFF] ^ (crc >> 8);
    return ~crc;
}

static bool check_header(reader *r, const unsigned char *bytes, size_t n) {
    header_t head;
    const size_t start = sizeof(header_t) + SECTIONS * sizeof(section_t);
    if (!bytes || n < start) {
        return refuse_block(
            r,
            "model block: %zu bytes are too few for a header of %zu; the file is truncated or no "
            "model",
            n, start);
    }
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.magic, "AMKERNEL", 8) != 0) {
        return refuse_block(
            r,
            "model block: does not begin with AMKERNEL; it is not a model of flightmech.compile");
    }
    if (head.endian != ENDIAN_MARK) {
        return refuse_block(r,
                            "model block: endian mark is %08x; this machine must be little-endian",
                            (unsigned)head.endian);
    }
    if (head.format != AM_FORMAT) {
        return refuse_block(
            r, "model block: format %u, this library reads format %d; compile the model again",
            (unsigned)head.format, AM_FORMAT);
    }
    if (head.size != n) {
        return refuse_block(
            r, "model block: header states %llu bytes, %zu came; the file is truncated or extended",
            (unsigned long long)head.size, n);
    }
    const size_t from = offsetof(header_t, sections);
    if (crc32_of(bytes + from, n - from) != head.crc) {
        return refuse_block(
            r, "model block: CRC-32 does not agree; the bytes were changed after compilation");
    }
    if (head.sections != SECTIONS && head.sections != ALL_SECTIONS) {
        return refuse_block(r, "model block: %u sections, expected %d or %d",
                            (unsigned)head.sections, SECTIONS, ALL_SECTIONS);
    }
    r->sections = (int)head.sections;
    return true;
}

static bool find_sections(reader *r, size_t n) {
    if (n < sizeof(header_t) + (size_t)r->sections * sizeof(section_t)) {
        return refuse_block(r, "model block: the directory does not lie inside the block");
    }
    const section_t *directory = (const section_t *)(r->model->block + sizeof(header_t));
    for (int i = 0; i < r->sections; i++) {
        const uint64_t offset = directory[i].offset;
        const uint64_t count = directory[i].count;
        if (offset > n || offset % 8 != 0 || count > (n - offset) / RECORD[i]) {
            return refuse_block(r, "model block: section %s does not lie inside the block",
                                SECTION_NAME[i]);
        }
        r->at[i] = r->model->block + offset;
        r->count[i] = (size_t)count;
        if (i < STRINGS && i != NODES && i != POINTS && count > MOST) {
            return refuse_block(r, "model block: section %s has too many records", SECTION_NAME[i]);
        }
    }
    if (r->count[GEOMETRY] != 1) {
        return refuse_block(r, "model block: geometry must have one record");
    }
    const char *strings = r->at[STRINGS];
    if (r->count[STRINGS] == 0 || strings[r->count[STRINGS] - 1] != 0) {
        return refuse_block(r, "model block: the string table does not end with 0");
    }
    return true;
}

bool open_block(reader *r, const unsigned char *bytes, size_t n) {
    if (!check_header(r, bytes, n)) return false;
    r->model = calloc(1, sizeof *r->model);
    if (r->model) r->model->block = calloc(1, n + SPILL * sizeof(double));
    if (!r->model || !r->model->block) return refuse_block(r, "model block: no memory");
    memcpy(r->model->block, bytes, n);
    return find_sections(r, n);
}

const char *string_at(const reader *r, uint32_t offset) {
    return offset < r->count[STRINGS] ? (const char *)r->at[STRINGS] + offset : NULL;
}

bool is_implicit(uint32_t code) { return code >= A_ALPHADOTHAT && code < A_ALPHADOTHAT + IMPLICIT; }

bool is_coefficient(uint32_t code) { return code >= A_CL && code <= A_CZ; }

/* A stage must not read what is found only after it. */
bool known_in(const reader *r, uint32_t variable, uint32_t stage) {
    return r->model->entry[AM_VARIABLE][variable].value <= stage;
}
