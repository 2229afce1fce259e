/* Packed block to const model.  Every number of the block is checked before use: any bytes are
 * safe.
 *
 * Layout, little-endian: header (32 bytes), directory of SECTIONS x {offset, count} (uint64),
 * sections aligned to 64 bytes. flightmech/compiler.py writes it; the records below are the
 * format. */
#include "model.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ENDIAN_MARK 0x01020304u
#define NO_STRING UINT32_MAX
#define MOST 1000000u /* upper bound of any count; keeps products inside 64 bits */

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
    SECTIONS
};

typedef struct {
    char magic[8];
    uint32_t format, endian;
    uint64_t size;
    uint32_t crc, sections;
} header_t;

typedef struct {
    uint64_t offset, count;
} section_t;

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

static const size_t RECORD[SECTIONS] = {
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
};
static const char *const SECTION_NAME[SECTIONS] = {
    "geometry", "inputs",  "outputs", "parameters", "states", "variables", "axes",
    "points",   "bundles", "nodes",   "terms",      "items",  "strings",
};

typedef struct {
    am_model *model;
    size_t count[SECTIONS];
    const void *at[SECTIONS];
    uint32_t first_slot[STAGES + 1]; /* as the block counts, without gaps */
    char *err;
    size_t nerr;
} reader;

static bool refuse(reader *r, const char *format, ...) {
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
        return refuse(
            r,
            "model block: %zu bytes are too few for a header of %zu; the file is truncated or no "
            "model",
            n, start);
    }
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.magic, "AMKERNEL", 8) != 0) {
        return refuse(
            r, "model block: does not begin with AMKERNEL; this is no model of flightmech.compile");
    }
    if (head.endian != ENDIAN_MARK) {
        return refuse(r, "model block: endian mark is %08x; this machine must be little-endian",
                      (unsigned)head.endian);
    }
    if (head.format != AM_FORMAT) {
        return refuse(
            r, "model block: format %u, this library reads format %d; compile the model again",
            (unsigned)head.format, AM_FORMAT);
    }
    if (head.size != n) {
        return refuse(
            r, "model block: header says %llu bytes, %zu came; the file is truncated or extended",
            (unsigned long long)head.size, n);
    }
    const size_t from = offsetof(header_t, sections);
    if (crc32_of(bytes + from, n - from) != head.crc) {
        return refuse(
            r, "model block: CRC-32 does not agree; the bytes were changed after compilation");
    }
    if (head.sections != SECTIONS) {
        return refuse(r, "model block: %u sections, expected %d", (unsigned)head.sections,
                      SECTIONS);
    }
    return true;
}

static bool find_sections(reader *r, size_t n) {
    const section_t *directory = (const section_t *)(r->model->block + sizeof(header_t));
    for (int i = 0; i < SECTIONS; i++) {
        const uint64_t offset = directory[i].offset;
        const uint64_t count = directory[i].count;
        if (offset > n || offset % 8 != 0 || count > (n - offset) / RECORD[i]) {
            return refuse(r, "model block: section %s does not lie inside the block",
                          SECTION_NAME[i]);
        }
        r->at[i] = r->model->block + offset;
        r->count[i] = (size_t)count;
        if (i != STRINGS && i != NODES && i != POINTS && count > MOST) {
            return refuse(r, "model block: section %s has too many records", SECTION_NAME[i]);
        }
    }
    if (r->count[GEOMETRY] != 1) return refuse(r, "model block: geometry must have one record");
    const char *strings = r->at[STRINGS];
    if (r->count[STRINGS] == 0 || strings[r->count[STRINGS] - 1] != 0) {
        return refuse(r, "model block: the string table does not end with 0");
    }
    return true;
}

static const char *string_at(const reader *r, uint32_t offset) {
    return offset < r->count[STRINGS] ? (const char *)r->at[STRINGS] + offset : NULL;
}

bool all_finite(const double *a, size_t n) {
    double nothing = 0.0; /* NaN and infinity by zero are NaN, and stay it */
    for (size_t i = 0; i < n; i++) nothing += a[i] * 0.0;
    return nothing == 0.0;
}

/* One zeroed piece of memory for the arrays of the model, carved in order. */
static bool reserve(reader *r) {
    am_model *m = r->model;
    m->axes = (uint32_t)r->count[AXES];
    m->bundles = (uint32_t)r->count[BUNDLES];
    m->terms = (uint32_t)r->count[TERMS];
    m->count[AM_INPUT] = (int)r->count[INPUTS];
    m->count[AM_OUTPUT] = (int)r->count[OUTPUTS];
    m->count[AM_PARAMETER] = (int)r->count[PARAMETERS];
    m->count[AM_STATE] = (int)r->count[STATES];
    m->count[AM_VARIABLE] = (int)r->count[VARIABLES];
    m->count[AM_TERM] = (int)m->terms;
    m->count[AM_AXIS] = (int)m->axes;
    for (int kind = AM_INPUT; kind <= AM_AXIS; kind++) {
        if (!(m->entry[kind] = calloc((size_t)m->count[kind] + 1, sizeof(am_entry)))) {
            return refuse(r, "model block: no memory");
        }
    }
    m->variable = calloc(r->count[VARIABLES] + 1, sizeof *m->variable);
    m->axis = calloc(m->axes + 1, sizeof *m->axis);
    m->cell = calloc(r->count[POINTS] + 3 * (size_t)m->axes + 1, sizeof *m->cell);
    m->bundle = calloc(m->bundles + 1, sizeof *m->bundle);
    m->term = calloc(m->terms + 1, sizeof *m->term);
    m->implicit = calloc(m->terms + 1, sizeof *m->implicit);
    m->late = calloc(m->terms + 1, sizeof *m->late);
    m->power = calloc(m->terms + 1, sizeof *m->power);
    m->plain = calloc(m->terms + 1, sizeof *m->plain);
    m->factored = calloc(m->terms + 1, sizeof *m->factored);
    m->mixed = calloc(m->terms + 1, sizeof *m->mixed);
    const bool tables = m->variable && m->axis && m->cell && m->bundle;
    const bool terms = m->term && m->implicit && m->late && m->power && m->plain && m->factored
                       && m->mixed;
    return (tables && terms) || refuse(r, "model block: no memory");
}

static bool read_geometry(reader *r) {
    const geometry_record *g = r->at[GEOMETRY];
    am_model *m = r->model;
    if (!(isfinite(g->S) && g->S > 0 && isfinite(g->cbar) && g->cbar > 0 && isfinite(g->b)
          && g->b > 0 && isfinite(g->x_ref_mac))) {
        return refuse(r, "model block: S, cbar and b must be positive and x_ref_mac finite");
    }
    if (g->force_axes > BODY_AXES) {
        return refuse(r, "model block: force axes %u; allowed: 0 stability, 1 wind, 2 body",
                      (unsigned)g->force_axes);
    }
    m->S = g->S;
    m->cbar = g->cbar;
    m->b = g->b;
    m->x_ref_mac = g->x_ref_mac;
    m->force_axes = (int)g->force_axes;
    m->title = string_at(r, g->title);
    m->meta = string_at(r, g->meta);
    if (!m->title || !m->meta) {
        return refuse(r, "model block: title or meta lies outside the string table");
    }
    return true;
}

static bool read_entries(reader *r, int section, am_kind kind) {
    const entry_record *record = r->at[section];
    for (size_t i = 0; i < r->count[section]; i++) {
        am_entry *e = &r->model->entry[kind][i];
        e->name = string_at(r, record[i].name);
        e->units = string_at(r, record[i].units);
        e->display_units = string_at(r, record[i].display_units);
        e->description = string_at(r, record[i].description);
        if (!e->name || !e->units || !e->display_units || !e->description) {
            return refuse(r, "model block: %s %zu has a text outside the string table",
                          SECTION_NAME[section], i);
        }
        e->value = record[i].value;
        e->low = record[i].low;
        e->high = record[i].high;
        if (!isfinite(e->value) || !isfinite(e->low) || !isfinite(e->high) || e->low > e->high) {
            return refuse(
                r, "model block: %s %s has a value or range that is not finite or not in order",
                SECTION_NAME[section], e->name);
        }
        e->flags = (int)(record[i].flags & (AM_FIXED | AM_INTEGER));
    }
    return true;
}

/* Items of the groups, sorted by group; core and weather have exactly one, which has no name. */
static bool read_items(reader *r) {
    am_model *m = r->model;
    const item_record *record = r->at[ITEMS];
    for (size_t i = 0; i < r->count[ITEMS]; i++) {
        const uint32_t group = record[i].group;
        const char *name = string_at(r, record[i].name);
        if (group >= GROUPS || !name || (i && group < record[i - 1].group)) {
            return refuse(r, "model block: item %zu has a wrong group or name", i);
        }
        if (m->items[group] == MAX_ITEMS) {
            return refuse(r, "model block: more than %d items %s", MAX_ITEMS, am_group((int)group));
        }
        if (strlen(name) >= NAME_SIZE / 2) {
            return refuse(r, "model block: the name of item %zu is too long", i);
        }
        m->item[group][m->items[group]++] = name;
    }
    if (m->items[G_CORE] != 1 || m->items[G_WEATHER] != 1) {
        return refuse(r, "model block: core and weather must be there once");
    }
    if (m->items[G_FUEL] > 1 || m->items[G_GEAR] > 1) {
        return refuse(r, "model block: fuel and gear can be there only once");
    }
    if (m->items[G_SPOOL] && m->items[G_SPOOL] != m->items[G_ENGINE]) {
        return refuse(r, "model block: %u engines have spools, of %u", (unsigned)m->items[G_SPOOL],
                      (unsigned)m->items[G_ENGINE]);
    }
    if (m->items[G_CONTACT] && !m->items[G_GEAR]) {
        return refuse(r, "model block: contacts without a gear");
    }
    return true;
}

/* Where the names of each group begin. */
static bool lay_out(reader *r) {
    am_model *m = r->model;
    for (int kind = 0; kind < NAMED_KINDS; kind++) {
        uint32_t next = kind == AM_VARIABLE; /* variable 0 is the constant 1 */
        for (int group = 0; group < GROUPS; group++) {
            m->per[kind][group] = group_size(kind, group);
            m->first[kind][group] = group == G_CORE ? 0 : next;
            next += m->items[group] * m->per[kind][group];
        }
        m->total[kind] = next;
    }
    for (int group = 0; group < GROUPS; group++) {
        m->per_memory[group] = memory_size(group);
        m->per_work[group] = work_size(group);
        m->first_memory[group] = m->memories;
        m->first_work[group] = m->works;
        m->memories += m->items[group] * m->per_memory[group];
        m->works += m->items[group] * m->per_work[group];
    }
    m->target_stage = calloc(3 * (size_t)m->total[AM_TARGET] + 1, sizeof *m->target_stage);
    if (!m->target_stage) return refuse(r, "model block: no memory");
    m->first_of = m->target_stage + m->total[AM_TARGET];
    m->end_of = m->first_of + m->total[AM_TARGET];
    for (int group = 0; group < GROUPS; group++) {
        for (uint32_t item = 0; item < m->items[group]; item++) {
            for (uint32_t code = 0; code < m->per[AM_TARGET][group]; code++) {
                m->target_stage[place(m, AM_TARGET, group, item) + code] = (uint32_t)pattern_stage(
                    AM_TARGET, group, code);
            }
        }
    }
    return true;
}

/* The catalogue must hold exactly the names of the library, in its order, so that an index is a
 * code. */
static bool check_names(reader *r, am_kind kind, size_t extra) {
    const am_model *m = r->model;
    const char *section = SECTION_NAME[INPUTS + (int)kind];
    const size_t expected = m->total[kind] + extra;
    if ((size_t)m->count[kind] != expected) {
        return refuse(r, "model block: %d %s, this library needs %zu; compile the model again",
                      m->count[kind], section, expected);
    }
    for (int group = 0; group < GROUPS; group++) {
        for (uint32_t item = 0; item < m->items[group]; item++) {
            for (uint32_t code = 0; code < m->per[kind][group]; code++) {
                char name[NAME_SIZE];
                const uint32_t i = place(m, (int)kind, group, item) + code;
                item_name(name, group_pattern((int)kind, group, code), m->item[group][item]);
                if (strcmp(name, m->entry[kind][i].name) != 0) {
                    return refuse(r,
                                  "model block: %s %u is %s, expected %s; compile the model again",
                                  section, (unsigned)i, m->entry[kind][i].name, name);
                }
            }
        }
    }
    return true;
}

static bool variable_code(const am_model *m, const char *name, uint32_t *code, int *stage) {
    for (int group = 0; group < GROUPS; group++) {
        for (uint32_t item = 0; item < m->items[group]; item++) {
            for (uint32_t i = 0; i < m->per[AM_VARIABLE][group]; i++) {
                char known[NAME_SIZE];
                item_name(known, group_pattern(AM_VARIABLE, group, i), m->item[group][item]);
                if (strcmp(name, known) != 0) continue;
                /* the constant 1 goes before the core */
                *code = place(m, AM_VARIABLE, group, item) + i + (group == G_CORE);
                *stage = pattern_stage(AM_VARIABLE, group, i);
                return true;
            }
        }
    }
    return false;
}

static bool read_variables(reader *r) {
    am_model *m = r->model;
    for (int i = 0; i < m->count[AM_VARIABLE]; i++) {
        const char *name = m->entry[AM_VARIABLE][i].name;
        int stage;
        if (!variable_code(m, name, &m->variable[i], &stage)) {
            return refuse(r, "model block: unknown variable %s", name);
        }
        m->entry[AM_VARIABLE][i].value = stage;
        m->uses_phi |= m->variable[i] == A_PHI;
    }
    return true;
}

static bool is_implicit(uint32_t code) {
    return code >= A_ALPHADOTHAT && code < A_ALPHADOTHAT + IMPLICIT;
}

/* A stage must not read what is found only after it. */
static bool known_in(const reader *r, uint32_t variable, uint32_t stage) {
    return r->model->entry[AM_VARIABLE][variable].value <= stage;
}

static bool check_points(reader *r, uint32_t i, const double *p, uint32_t count) {
    const char *name = r->model->entry[AM_AXIS][i].name;
    for (uint32_t k = 0; k < count; k++) {
        if (!(fabs(p[k]) < FARTHEST)) {
            return refuse(
                r, "model block: axis %u (%s) has a breakpoint that is not finite or beyond %g",
                (unsigned)i, name, FARTHEST);
        }
        if (k == 0) continue;
        if (!(p[k] > p[k - 1])) {
            return refuse(r, "model block: axis %u (%s) does not rise at point %u", (unsigned)i,
                          name, (unsigned)k);
        }
        if (!(1.0 / (p[k] - p[k - 1]) < FARTHEST)) {
            return refuse(r, "model block: axis %u (%s) has a step at point %u that is too small",
                          (unsigned)i, name, (unsigned)k);
        }
    }
    return true;
}

/* The smallest number above x. */
static double next_above(double x) {
    uint64_t bits;
    if (x == 0.0) return 0x1p-1074;
    memcpy(&bits, &x, sizeof bits);
    bits += x > 0.0 ? 1 : (uint64_t)-1;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Fills count + 3 cells. */
static void lay_cells(const double *p, uint32_t count, bool linear, cell_t *to) {
    const uint32_t last = count - 1;
    const double first_rise = last ? 1.0 / (p[1] - p[0]) : 0.0;
    const double last_rise = last ? 1.0 / (p[last] - p[last - 1]) : 0.0;
    const double end = last ? 1.0 : 0.0;
    to[0] = (cell_t){-FARTHEST, p[0], linear ? first_rise : 0.0, 0.0};
    for (uint32_t k = 0; k < last; k++) {
        to[1 + k] = (cell_t){p[k], p[k], 1.0 / (p[k + 1] - p[k]), 0.0};
    }
    to[count] = (cell_t){p[last], p[last], 0.0, end};
    to[count + 1] = (cell_t){next_above(p[last]), p[last], linear ? last_rise : 0.0, end};
    to[count + 2] = (cell_t){.from = FARTHEST};
}

static bool read_axes(reader *r) {
    am_model *m = r->model;
    const axis_record *record = r->at[AXES];
    const double *points = r->at[POINTS];
    uint32_t stage = 0;
    uint32_t next = 0;
    for (uint32_t i = 0; i < m->axes; i++) {
        if (record[i].variable >= r->count[VARIABLES]) {
            return refuse(r, "model block: axis %u has no variable", (unsigned)i);
        }
        const uint32_t code = m->variable[record[i].variable];
        const uint32_t count = record[i].count;
        const uint32_t first = record[i].first;
        am_entry *e = &m->entry[AM_AXIS][i];
        *e = m->entry[AM_VARIABLE][record[i].variable];
        if (count == 0 || first != next || count > r->count[POINTS] - first) {
            return refuse(r, "model block: axis %u (%s) has breakpoints outside the block",
                          (unsigned)i, e->name);
        }
        next += count;
        const double *p = points + first;
        if (!check_points(r, i, p, count)) return false;
        if (record[i].stage < stage || record[i].stage >= STAGES) {
            return refuse(r, "model block: axes are not sorted by stage");
        }
        while (stage < record[i].stage) m->first_axis[++stage] = i;
        if (is_implicit(code) || code == A_CL) {
            return refuse(r, "model block: %s cannot be a table axis; it may be a regressor only",
                          e->name);
        }
        if (!known_in(r, record[i].variable, stage)) {
            return refuse(r, "model block: %s is not yet known where a table needs it", e->name);
        }
        cell_t *cell = m->cell + first + 3 * (size_t)i;
        lay_cells(p, count, record[i].linear != 0, cell);
        m->axis[i] = (axis_t){cell, count + 2, count, code};
        e->low = p[0];
        e->high = p[count - 1];
        e->value = 0.0;
        e->flags = record[i].linear ? AM_LINEAR : 0;
    }
    while (stage < STAGES) m->first_axis[++stage] = m->axes;
    return true;
}

static bool read_bundles(reader *r) {
    am_model *m = r->model;
    const bundle_record *record = r->at[BUNDLES];
    uint32_t stage = 0;
    uint32_t slot = 1;
    m->node = r->at[NODES];
    r->first_slot[0] = slot;
    if (r->count[NODES] > UINT32_MAX) return refuse(r, "model block: too many nodes");
    for (uint32_t i = 0; i < m->bundles; i++) {
        const bundle_record *b = &record[i];
        bundle_t *to = &m->bundle[i];
        if (b->axes > MAX_AXES || b->width == 0 || b->width > MOST) {
            return refuse(r, "model block: bundle %u has a wrong number of axes or tables",
                          (unsigned)i);
        }
        if (b->stage < stage || b->stage >= STAGES) {
            return refuse(r, "model block: bundles are not sorted by stage");
        }
        while (stage < b->stage) {
            m->first_bundle[++stage] = i;
            r->first_slot[stage] = slot;
        }
        size_t doubles = b->width;
        for (uint32_t k = b->axes; k-- > 0;) {
            if (b->axis[k] < m->first_axis[stage] || b->axis[k] >= m->first_axis[stage + 1]) {
                return refuse(r,
                              "model block: bundle %u refers to an axis that is not in its stage",
                              (unsigned)i);
            }
            const uint32_t count = m->axis[b->axis[k]].count;
            to->axis[k] = b->axis[k];
            to->stride[k] = count > 1 ? doubles : 0;
            if (doubles > r->count[NODES] / count) {
                return refuse(r, "model block: bundle %u has nodes outside the block", (unsigned)i);
            }
            doubles *= count;
        }
        if (b->first > r->count[NODES] || doubles > r->count[NODES] - b->first) {
            return refuse(r, "model block: bundle %u has nodes outside the block", (unsigned)i);
        }
        to->first = (size_t)b->first;
        to->axes = b->axes;
        to->width = b->width;
        to->slot = slot + SPILL * stage;
        slot += b->width;
        if (slot > MOST) return refuse(r, "model block: too many tables");
    }
    while (stage < STAGES) {
        m->first_bundle[++stage] = m->bundles;
        r->first_slot[stage] = slot;
    }
    m->slots = slot + SPILL * STAGES;
    if (!all_finite(r->at[NODES], r->count[NODES])) {
        return refuse(r, "model block: a table node is not finite");
    }
    return true;
}

static bool factor(const reader *r, uint32_t reference, uint32_t *code) {
    if (reference > r->count[VARIABLES]) return false;
    *code = reference ? r->model->variable[reference - 1] : A_ONE;
    return true;
}

static uint32_t unknown_place(am_model *m, uint32_t kind) {
    for (uint32_t j = 0; j < m->unknowns; j++) {
        if (m->unknown[j] == kind) return j;
    }
    m->unknown[m->unknowns] = kind;
    return m->unknowns++;
}

/* A term may hold one of alphadothat, betadothat, dnz, which are solved for, or CL, which is
 * known after all terms of CL. */
static bool note_special(reader *r, uint32_t i) {
    am_model *m = r->model;
    const term_t *t = &m->term[i];
    const char *name = m->entry[AM_TERM][i].name;
    const bool first = is_implicit(t->v1);
    const bool second = is_implicit(t->v2);
    const bool lift = t->v1 == A_CL || t->v2 == A_CL;
    if (first && second) {
        return refuse(
            r,
            "model block: term %s has two of alphadothat, betadothat, dnz; only one can be "
            "solved for",
            name);
    }
    if (lift && (first || second || t->target < T_ROLL || t->target > T_YAW)) {
        return refuse(r,
                      "model block: term %s uses CL, which only terms of Cl, Cm and Cn without "
                      "alphadothat, betadothat, dnz can",
                      name);
    }
    if ((first || second || lift) && t->target >= COEFFICIENTS) {
        return refuse(r, "model block: term %s cannot depend on alphadothat, betadothat, dnz or CL",
                      name);
    }
    if (lift) m->late[m->lates++] = i;
    if (!first && !second) return true;
    m->implicit[m->implicits][0] = i;
    m->implicit[m->implicits++][1] = unknown_place(m, (first ? t->v1 : t->v2) - A_ALPHADOTHAT);
    return true;
}

static bool read_power(reader *r, const term_record *b, term_t *t, const char *name) {
    am_model *m = r->model;
    uint32_t code;
    if (!b->power) return true;
    if (!factor(r, b->power, &code) || !known_in(r, b->power - 1, m->target_stage[b->target])
        || is_implicit(code) || code == A_CL) {
        return refuse(r, "model block: term %s has a power of an unknown variable", name);
    }
    if (!(b->floor > 0.0) || !isfinite(b->floor)) {
        return refuse(r, "model block: term %s: the floor of its power must be positive", name);
    }
    m->power[m->powers++] = (power_t){code, b->floor};
    t->power = m->powers;
    return true;
}

static bool is_special(const term_t *t) {
    return is_implicit(t->v1) || is_implicit(t->v2) || t->v1 == A_CL || t->v2 == A_CL;
}

/* Gives a term the list of its stage that its form allows. */
static void list_term(am_model *m, uint32_t i) {
    const term_t *t = &m->term[i];
    const uint32_t v = t->v1 == A_ONE ? t->v2 : t->v1;
    if (is_special(t)) return;
    if (t->K2 || t->power || (t->v1 != A_ONE && t->v2 != A_ONE)) m->mixed[m->mixeds++] = i;
    else if (t->K1) m->factored[m->factoreds++] = (factored_t){i, t->place, t->T, v, t->K1};
    else m->plain[m->plains++] = (plain_t){i, t->place, t->T, v};
}

static void end_stage(am_model *m, uint32_t stage, uint32_t end) {
    m->first_term[stage] = end;
    m->first_plain[stage] = m->plains;
    m->first_factored[stage] = m->factoreds;
    m->first_mixed[stage] = m->mixeds;
}

/* Places and lists of the terms, once all are read. */
static void place_terms(am_model *m) {
    uint32_t stage = 0;
    for (uint32_t t = 0; t < COEFFICIENTS; t++) {
        if (m->end_of[t] - m->first_of[t] > m->rows) m->rows = m->end_of[t] - m->first_of[t];
    }
    m->places = m->rows * ROW;
    for (uint32_t i = 0; i < m->terms; i++) {
        const uint32_t target = m->term[i].target;
        m->term[i].first = i == m->first_of[target];
        m->term[i].place = target < COEFFICIENTS ? (i - m->first_of[target]) * ROW + target
                                                 : m->places++;
        while (stage < m->target_stage[target]) end_stage(m, ++stage, i);
        list_term(m, i);
    }
    while (stage < STAGES) end_stage(m, ++stage, m->terms);
}

static bool read_term(reader *r, uint32_t i) {
    am_model *m = r->model;
    const term_record *b = (const term_record *)r->at[TERMS] + i;
    am_entry *e = &m->entry[AM_TERM][i];
    term_t *t = &m->term[i];
    e->name = string_at(r, b->name);
    e->description = string_at(r, b->description);
    e->units = e->display_units = "1";
    e->low = -DBL_MAX;
    e->high = DBL_MAX;
    if (!e->name || !e->description) {
        return refuse(r, "model block: term %u has no name", (unsigned)i);
    }
    if (b->target >= m->total[AM_TARGET]) {
        return refuse(r, "model block: term %s has target %u", e->name, (unsigned)b->target);
    }
    const uint32_t stage = m->target_stage[b->target];
    const uint32_t v[2] = {b->v1, b->v2};
    uint32_t slot[3] = {b->K1, b->K2, b->T};
    for (int k = 0; k < 3; k++) {
        if (!slot[k]) continue;
        if (slot[k] < r->first_slot[stage] || slot[k] >= r->first_slot[stage + 1]) {
            return refuse(r, "model block: term %s refers to a table outside its stage", e->name);
        }
        slot[k] += SPILL * stage;
    }
    *t = (term_t){
        .K1 = slot[0], .K2 = slot[1], .T = slot[2], .v1 = A_ONE, .v2 = A_ONE, .target = b->target};
    if (!factor(r, b->v1, &t->v1) || !factor(r, b->v2, &t->v2)) {
        return refuse(r, "model block: term %s refers to an unknown variable", e->name);
    }
    for (int k = 0; k < 2; k++) {
        if (v[k] && !known_in(r, v[k] - 1, stage)) {
            return refuse(r, "model block: term %s depends on %s, which is not yet known there",
                          e->name, m->entry[AM_VARIABLE][v[k] - 1].name);
        }
    }
    return read_power(r, b, t, e->name) && note_special(r, i);
}

static bool read_terms(reader *r) {
    am_model *m = r->model;
    uint32_t stage = 0;
    for (uint32_t i = 0; i < m->terms; i++) {
        if (!read_term(r, i)) return false;
        const uint32_t target = m->term[i].target;
        if (m->target_stage[target] < stage
            || (i && m->target_stage[target] == stage && target < m->term[i - 1].target)) {
            return refuse(r, "model block: terms are not sorted by stage and target");
        }
        stage = m->target_stage[target];
        if (i == 0 || target != m->term[i - 1].target) m->first_of[target] = i;
        m->end_of[target] = i + 1;
    }
    place_terms(m);
    return true;
}

/* The last parameters scale the terms; the exponents of the power factors follow, in the order
 * of the terms. */
static bool check_scales(reader *r) {
    const am_model *m = r->model;
    const am_entry *e = m->entry[AM_PARAMETER] + m->total[AM_PARAMETER];
    for (uint32_t i = 0; i < m->terms; i++) {
        if (strncmp(e[i].name, "term.", 5) != 0) {
            return refuse(r, "model block: the scale of term %s is not a parameter term.*",
                          m->entry[AM_TERM][i].name);
        }
    }
    for (uint32_t i = 0; i < m->powers; i++) {
        if (strncmp(e[m->terms + i].name, "power.", 6) != 0) {
            return refuse(r, "model block: parameter %s stands where an exponent power.* must be",
                          e[m->terms + i].name);
        }
    }
    return true;
}

/* The stage of a variable stood in its entry while the block was read. */
static bool forget_stages(reader *r) {
    for (int i = 0; i < r->model->count[AM_VARIABLE]; i++) {
        r->model->entry[AM_VARIABLE][i].value = 0.0;
    }
    return true;
}

static bool read_block(reader *r, const unsigned char *bytes, size_t n) {
    if (!check_header(r, bytes, n)) return false;
    if (!(r->model = calloc(1, sizeof *r->model))
        || !(r->model->block = calloc(1, n + SPILL * sizeof(double)))) {
        return refuse(r, "model block: no memory");
    }
    memcpy(r->model->block, bytes, n);
    if (!find_sections(r, n) || !reserve(r) || !read_geometry(r)) return false;
    for (int kind = AM_INPUT; kind <= AM_VARIABLE; kind++) {
        if (!read_entries(r, INPUTS + kind, (am_kind)kind)) return false;
    }
    if (!read_items(r) || !lay_out(r) || !read_variables(r) || !read_axes(r) || !read_bundles(r)
        || !read_terms(r)) {
        return false;
    }
    return check_names(r, AM_INPUT, 0) && check_names(r, AM_OUTPUT, 0)
           && check_names(r, AM_STATE, 0)
           && check_names(r, AM_PARAMETER, (size_t)r->model->terms + r->model->powers)
           && check_scales(r) && forget_stages(r);
}

am_model *am_load(const void *bytes, size_t n, char *err, size_t nerr) {
    reader r = {.err = err, .nerr = nerr};
    if (err && nerr) err[0] = 0;
    if (read_block(&r, bytes, n)) {
        r.model->sim_bytes = sim_size(r.model);
        r.model->versions = best_versions();
        return r.model;
    }
    am_free(r.model);
    return NULL;
}

void am_free(am_model *model) {
    if (!model) return;
    for (int kind = AM_INPUT; kind <= AM_AXIS; kind++) free(model->entry[kind]);
    free(model->variable);
    free(model->axis);
    free(model->bundle);
    free(model->term);
    free(model->implicit);
    free(model->late);
    free(model->power);
    free(model->plain);
    free(model->factored);
    free(model->mixed);
    free(model->cell);
    free(model->target_stage);
    free(model->block);
    free(model);
}
