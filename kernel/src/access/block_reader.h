/* The records of a packed block, and the reader that checks them one section after another.
 *
 * Layout, little-endian: header (32 bytes), directory of SECTIONS x {offset, count} (uint64),
 * sections aligned to 64 bytes.  Written by flightmech/simulation/packer.py.  The records below are
 * the format. */
#ifndef AEROMATCH_BLOCK_READER_H
#define AEROMATCH_BLOCK_READER_H

#include "model.h"

#define MOST 1000000u /* upper bound of any count; keeps products inside 64 bits */

/* in the order of the directory */
enum {
    GEOMETRY,
    INPUTS,
    OUTPUTS,
    PARAMETERS,
    STATES,
    VARIABLES,
    AXES,
    POINTS,
    BUNDLES,
    NODES,
    TERMS,
    ITEMS,
    STRINGS,
    SECTIONS, /* that every block has */
    ENVELOPE = SECTIONS,
    ALL_SECTIONS
};

typedef struct {
    double S, cbar, b, x_ref_mac;
    uint32_t force_axes, title, meta, reserved;
} geometry_record;

typedef struct {
    uint32_t name, units, display_units, description;
    double value, low, high;
    uint32_t flags, reserved;
} entry_record;

typedef struct {
    uint32_t variable, first, count, linear, stage, reserved;
} axis_record;

typedef struct {
    uint32_t axes, axis[MAX_AXES], width, stage, reserved;
    uint64_t first; /* index of the first node in NODES */
} bundle_record;

typedef struct {
    /* v1, v2, power: 0 none, else variable + 1 */
    uint32_t name, description, K1, K2, T, v1, v2, target, power, reserved;
    /* of the power's variable */
    double floor;
} term_record;

typedef struct {
    uint32_t group, name;
} item_record;

typedef struct {
    am_model *model;
    size_t count[ALL_SECTIONS];
    const void *at[ALL_SECTIONS];
    int sections; /* of the block */
    uint32_t first_slot[STAGES + 1]; /* as the block counts, without gaps */
    char *err;
    size_t nerr;
} reader;

/* Write the reason (printf format) and return false. */
bool refuse_block(reader *r, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Check the header and copy the block into a new model, which the reader then owns. */
bool open_block(reader *r, const unsigned char *bytes, size_t n);

/* Name of a section, for messages. */
const char *section_name(int section);

/* Text at an offset of the string table; NULL outside. */
const char *string_at(const reader *r, uint32_t offset);

/* True when a stage may read a variable of the catalogue. */
bool known_in(const reader *r, uint32_t variable, uint32_t stage);

/* alphadothat, betadothat or dnz. */
bool is_implicit(uint32_t code);

/* A coefficient: known once its terms are summed. */
bool is_coefficient(uint32_t code);

#endif
