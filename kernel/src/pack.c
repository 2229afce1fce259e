/* Packed block to const model.  Every number of the block is checked before use: any bytes are safe.
 *
 * Layout, little-endian: header (32 bytes), directory of SECTIONS x {offset, count} (uint64), sections aligned to 64 bytes.
 * flightmech/compiler.py writes it; the records below are the format. */
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

enum { GEOMETRY, INPUTS, OUTPUTS, PARAMETERS, VARIABLES, AXES, POINTS, BUNDLES, NODES, TERMS, ENGINES, STRINGS, SECTIONS };

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
    uint32_t variable, first, count, linear, group, reserved;
} axis_record;

typedef struct {
    uint32_t axes, axis[MAX_AXES], width, group, reserved;
    uint64_t first; /* index of the first node in NODES */
} bundle_record;

typedef struct {
    uint32_t name, description, K1, K2, T, v1, v2, coefficient; /* v1, v2: 0 none, else variable + 1 */
} term_record;

typedef struct {
    double position[3], direction[3];
} engine_record;

static const size_t RECORD[SECTIONS] = {
    sizeof(geometry_record), sizeof(entry_record),  sizeof(entry_record), sizeof(entry_record), sizeof(entry_record), sizeof(axis_record),
    sizeof(double),          sizeof(bundle_record), sizeof(double),       sizeof(term_record),  sizeof(engine_record), 1,
};
static const char *const SECTION_NAME[SECTIONS] = {
    "geometry", "inputs", "outputs", "parameters", "variables", "axes", "points", "bundles", "nodes", "terms", "engines", "strings",
};

typedef struct {
    am_model *model;
    size_t count[SECTIONS];
    const void *at[SECTIONS];
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
    uint32_t table[256], crc = 0xFFFFFFFFu;
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
    if (!bytes || n < start)
        return refuse(r, "model block: %zu bytes are too few for a header of %zu; the file is truncated or no model", n, start);
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.magic, "AMKERNEL", 8) != 0)
        return refuse(r, "model block: does not begin with AMKERNEL; this is no model of flightmech.compile");
    if (head.endian != ENDIAN_MARK)
        return refuse(r, "model block: endian mark is %08x; this machine must be little-endian", (unsigned)head.endian);
    if (head.format != AM_FORMAT)
        return refuse(r, "model block: format %u, this library reads format %d; compile the model again", (unsigned)head.format, AM_FORMAT);
    if (head.size != n)
        return refuse(r, "model block: header says %llu bytes, %zu came; the file is truncated or extended", (unsigned long long)head.size, n);
    const size_t from = offsetof(header_t, sections);
    if (crc32_of(bytes + from, n - from) != head.crc)
        return refuse(r, "model block: CRC-32 does not agree; the bytes were changed after compilation");
    if (head.sections != SECTIONS) return refuse(r, "model block: %u sections, expected %d", (unsigned)head.sections, SECTIONS);
    return true;
}

static bool find_sections(reader *r, size_t n) {
    const section_t *directory = (const section_t *)(r->model->block + sizeof(header_t));
    for (int i = 0; i < SECTIONS; i++) {
        const uint64_t offset = directory[i].offset, count = directory[i].count;
        if (offset > n || offset % 8 != 0 || count > (n - offset) / RECORD[i])
            return refuse(r, "model block: section %s does not lie inside the block", SECTION_NAME[i]);
        r->at[i] = r->model->block + offset;
        r->count[i] = (size_t)count;
        if (i != STRINGS && i != NODES && i != POINTS && count > MOST)
            return refuse(r, "model block: section %s has too many records", SECTION_NAME[i]);
    }
    if (r->count[GEOMETRY] != 1) return refuse(r, "model block: geometry must have one record");
    const char *strings = r->at[STRINGS];
    if (r->count[STRINGS] == 0 || strings[r->count[STRINGS] - 1] != 0)
        return refuse(r, "model block: the string table does not end with 0");
    return true;
}

static const char *string_at(const reader *r, uint32_t offset) {
    return offset < r->count[STRINGS] ? (const char *)r->at[STRINGS] + offset : NULL;
}

bool all_finite(const double *a, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (!isfinite(a[i])) return false;
    return true;
}

/* One zeroed piece of memory for the arrays of the model, carved in order. */
static bool reserve(reader *r) {
    am_model *m = r->model;
    m->axes = (uint32_t)r->count[AXES], m->bundles = (uint32_t)r->count[BUNDLES];
    m->terms = (uint32_t)r->count[TERMS], m->engines = (uint32_t)r->count[ENGINES];
    if (m->engines > MAX_ENGINES) return refuse(r, "model block: %u engines; at most %d are possible", (unsigned)m->engines, MAX_ENGINES);
    m->count[AM_INPUT] = (int)r->count[INPUTS], m->count[AM_OUTPUT] = (int)r->count[OUTPUTS];
    m->count[AM_PARAMETER] = (int)r->count[PARAMETERS], m->count[AM_VARIABLE] = (int)r->count[VARIABLES];
    m->count[AM_TERM] = (int)m->terms, m->count[AM_AXIS] = (int)m->axes;
    for (int kind = AM_INPUT; kind <= AM_AXIS; kind++)
        if (!(m->entry[kind] = calloc((size_t)m->count[kind] + 1, sizeof(am_entry)))) return refuse(r, "model block: no memory");
    m->variable = calloc(r->count[VARIABLES] + 1, sizeof *m->variable);
    m->axis = calloc(m->axes + 1, sizeof *m->axis);
    m->bundle = calloc(m->bundles + 1, sizeof *m->bundle);
    m->term = calloc(m->terms + 1, sizeof *m->term);
    m->implicit = calloc(m->terms + 1, sizeof *m->implicit);
    m->engine = calloc(m->engines + 1, sizeof *m->engine);
    if (!m->variable || !m->axis || !m->bundle || !m->term || !m->implicit || !m->engine) return refuse(r, "model block: no memory");
    return true;
}

static bool read_geometry(reader *r) {
    const geometry_record *g = r->at[GEOMETRY];
    am_model *m = r->model;
    if (!(isfinite(g->S) && g->S > 0 && isfinite(g->cbar) && g->cbar > 0 && isfinite(g->b) && g->b > 0 && isfinite(g->x_ref_mac)))
        return refuse(r, "model block: S, cbar and b must be positive and x_ref_mac finite");
    if (g->force_axes > BODY_AXES)
        return refuse(r, "model block: force axes %u; allowed: 0 stability, 1 wind, 2 body", (unsigned)g->force_axes);
    m->S = g->S, m->cbar = g->cbar, m->b = g->b, m->x_ref_mac = g->x_ref_mac, m->force_axes = (int)g->force_axes;
    m->title = string_at(r, g->title), m->meta = string_at(r, g->meta);
    if (!m->title || !m->meta) return refuse(r, "model block: title or meta lies outside the string table");
    return true;
}

static bool read_entries(reader *r, int section, am_kind kind) {
    const entry_record *record = r->at[section];
    for (size_t i = 0; i < r->count[section]; i++) {
        am_entry *e = &r->model->entry[kind][i];
        e->name = string_at(r, record[i].name), e->units = string_at(r, record[i].units);
        e->display_units = string_at(r, record[i].display_units), e->description = string_at(r, record[i].description);
        if (!e->name || !e->units || !e->display_units || !e->description)
            return refuse(r, "model block: %s %zu has a text outside the string table", SECTION_NAME[section], i);
        e->value = record[i].value, e->low = record[i].low, e->high = record[i].high;
        if (!isfinite(e->value) || !isfinite(e->low) || !isfinite(e->high) || e->low > e->high)
            return refuse(r, "model block: %s %s has a value or range that is not finite or not in order", SECTION_NAME[section], e->name);
        e->flags = (int)(record[i].flags & (AM_FIXED | AM_INTEGER));
    }
    return true;
}

/* "engine*.x" with the number of the engine in place of the star. */
static void engine_name(char *to, size_t n, const char *pattern, uint32_t engine) {
    snprintf(to, n, "engine%u%s", (unsigned)(engine + 1), pattern + strlen("engine*"));
}

/* The catalogue must hold exactly the names of the library, in its order, so that an index is a code. */
static bool check_names(reader *r, am_kind kind, size_t extra) {
    const am_model *m = r->model;
    const char *section = SECTION_NAME[INPUTS + (int)kind];
    const size_t fixed = (size_t)known_count(kind, false), each = (size_t)known_count(kind, true);
    const size_t expected = fixed + each * m->engines + extra;
    if ((size_t)m->count[kind] != expected)
        return refuse(r, "model block: %d %s, this library needs %zu; compile the model again", m->count[kind], section, expected);
    for (size_t i = 0; i < expected - extra; i++) {
        char name[64];
        if (i < fixed) snprintf(name, sizeof name, "%s", am_known(kind, (int)i));
        else engine_name(name, sizeof name, am_known(kind, (int)(fixed + (i - fixed) % each)), (uint32_t)((i - fixed) / each));
        if (strcmp(name, m->entry[kind][i].name) != 0)
            return refuse(r, "model block: %s %zu is %s, expected %s; compile the model again", section, i, m->entry[kind][i].name, name);
    }
    return true;
}

static bool variable_code(const am_model *m, const char *name, uint32_t *code) {
    const int fixed = known_count(AM_VARIABLE, false), each = known_count(AM_VARIABLE, true);
    for (int i = 0; i < fixed; i++)
        if (strcmp(name, am_known(AM_VARIABLE, i)) == 0) return *code = (uint32_t)i + 1, true;
    for (uint32_t engine = 0; engine < m->engines; engine++)
        for (int i = 0; i < each; i++) {
            char known[64];
            engine_name(known, sizeof known, am_known(AM_VARIABLE, fixed + i), engine);
            if (strcmp(name, known) == 0) return *code = (uint32_t)(A_FIXED + (int)engine * each + i), true;
        }
    return false;
}

static bool read_variables(reader *r) {
    am_model *m = r->model;
    m->variables = (uint32_t)(A_FIXED + A_PER_ENGINE * (int)m->engines);
    for (int i = 0; i < m->count[AM_VARIABLE]; i++) {
        const char *name = m->entry[AM_VARIABLE][i].name;
        if (!variable_code(m, name, &m->variable[i])) return refuse(r, "model block: unknown variable %s", name);
        m->uses_phi |= m->variable[i] == A_PHI;
    }
    return true;
}

static bool is_implicit(uint32_t code) { return code >= A_ALPHADOTHAT && code < A_ALPHADOTHAT + IMPLICIT; }

static bool is_thrust(uint32_t code) { return code >= A_FIXED && (code - A_FIXED) % A_PER_ENGINE == A_THRUST; }

static bool read_axes(reader *r) {
    am_model *m = r->model;
    const axis_record *record = r->at[AXES];
    const double *points = r->at[POINTS];
    uint32_t group = ENGINE_GROUP;
    for (uint32_t i = 0; i < m->axes; i++) {
        if (record[i].variable >= r->count[VARIABLES]) return refuse(r, "model block: axis %u has no variable", (unsigned)i);
        const uint32_t code = m->variable[record[i].variable], count = record[i].count, first = record[i].first;
        am_entry *e = &m->entry[AM_AXIS][i];
        *e = m->entry[AM_VARIABLE][record[i].variable];
        if (count == 0 || first > r->count[POINTS] || count > r->count[POINTS] - first)
            return refuse(r, "model block: axis %u (%s) has breakpoints outside the block", (unsigned)i, e->name);
        const double *p = points + first;
        if (!all_finite(p, count)) return refuse(r, "model block: axis %u (%s) has a breakpoint that is not finite", (unsigned)i, e->name);
        for (uint32_t k = 1; k < count; k++)
            if (!(p[k] > p[k - 1]))
                return refuse(r, "model block: axis %u (%s) does not rise at point %u", (unsigned)i, e->name, (unsigned)k);
        if (record[i].group < group || record[i].group >= GROUPS) return refuse(r, "model block: axes are not sorted by group");
        while (group < record[i].group) m->first_axis[++group] = i;
        if (is_implicit(code)) return refuse(r, "model block: %s cannot be a table axis; it may be a regressor only", e->name);
        if (group == ENGINE_GROUP && is_thrust(code)) return refuse(r, "model block: %s cannot be an axis of an engine table", e->name);
        m->axis[i] = (axis_t){p, count, code, record[i].linear != 0};
        e->low = p[0], e->high = p[count - 1], e->value = 0.0;
        e->flags = record[i].linear ? AM_LINEAR : 0;
    }
    while (group < GROUPS) m->first_axis[++group] = m->axes;
    return true;
}

static bool read_bundles(reader *r) {
    am_model *m = r->model;
    const bundle_record *record = r->at[BUNDLES];
    uint32_t group = ENGINE_GROUP;
    m->slots = 1;
    for (uint32_t i = 0; i < m->bundles; i++) {
        const bundle_record *b = &record[i];
        bundle_t *to = &m->bundle[i];
        if (b->axes > MAX_AXES || b->width == 0 || b->width > MOST)
            return refuse(r, "model block: bundle %u has a wrong number of axes or tables", (unsigned)i);
        if (b->group < group || b->group >= GROUPS) return refuse(r, "model block: bundles are not sorted by group");
        while (group < b->group) m->first_bundle[++group] = i;
        size_t doubles = b->width;
        for (uint32_t k = b->axes; k-- > 0;) {
            if (b->axis[k] < m->first_axis[group] || b->axis[k] >= m->first_axis[group + 1])
                return refuse(r, "model block: bundle %u refers to an axis that is not in its group", (unsigned)i);
            const uint32_t count = m->axis[b->axis[k]].count;
            to->axis[k] = b->axis[k];
            to->stride[k] = count > 1 ? doubles : 0;
            if (doubles > r->count[NODES] / count) return refuse(r, "model block: bundle %u has nodes outside the block", (unsigned)i);
            doubles *= count;
        }
        if (b->first > r->count[NODES] || doubles > r->count[NODES] - b->first)
            return refuse(r, "model block: bundle %u has nodes outside the block", (unsigned)i);
        to->node = (const double *)r->at[NODES] + b->first;
        to->axes = b->axes, to->width = b->width, to->slot = m->slots;
        m->slots += b->width;
        if (m->slots > MOST) return refuse(r, "model block: too many tables");
    }
    while (group < GROUPS) m->first_bundle[++group] = m->bundles;
    if (!all_finite(r->at[NODES], r->count[NODES])) return refuse(r, "model block: a table node is not finite");
    return true;
}

static bool factor(const reader *r, uint32_t reference, uint32_t *code) {
    if (reference > r->count[VARIABLES]) return false;
    *code = reference ? r->model->variable[reference - 1] : A_ONE;
    return true;
}

static uint32_t unknown_place(am_model *m, uint32_t kind) {
    for (uint32_t j = 0; j < m->unknowns; j++)
        if (m->unknown[j] == kind) return j;
    m->unknown[m->unknowns] = kind;
    return m->unknowns++;
}

static bool note_implicit(reader *r, uint32_t i) {
    am_model *m = r->model;
    const term_t *t = &m->term[i];
    const bool first = is_implicit(t->v1), second = is_implicit(t->v2);
    if (!first && !second) return true;
    const char *name = m->entry[AM_TERM][i].name;
    if (first && second) return refuse(r, "model block: term %s has two of alphadothat, betadothat, dnz; only one can be solved for", name);
    if (t->coefficient >= COEFFICIENTS)
        return refuse(r, "model block: engine term %s cannot depend on alphadothat, betadothat or dnz", name);
    m->implicit[m->implicits][0] = i;
    m->implicit[m->implicits++][1] = unknown_place(m, (first ? t->v1 : t->v2) - A_ALPHADOTHAT);
    return true;
}

/* Engine terms first, then CL CD CY Cl Cm Cn. */
static uint32_t rank(uint32_t coefficient) { return coefficient >= COEFFICIENTS ? coefficient - COEFFICIENTS : MAX_ENGINES + coefficient; }

static bool read_terms(reader *r) {
    am_model *m = r->model;
    const term_record *record = r->at[TERMS];
    const uint32_t split = m->first_bundle[AERO_GROUP] < m->bundles ? m->bundle[m->first_bundle[AERO_GROUP]].slot : m->slots;
    for (uint32_t i = 0; i < m->terms; i++) {
        const term_record *b = &record[i];
        am_entry *e = &m->entry[AM_TERM][i];
        e->name = string_at(r, b->name), e->description = string_at(r, b->description);
        e->units = e->display_units = "1";
        e->low = -DBL_MAX, e->high = DBL_MAX;
        if (!e->name || !e->description) return refuse(r, "model block: term %u has no name", (unsigned)i);
        if (b->coefficient >= COEFFICIENTS + m->engines)
            return refuse(r, "model block: term %s has coefficient %u", e->name, (unsigned)b->coefficient);
        const bool engine = b->coefficient >= COEFFICIENTS;
        const uint32_t slot[3] = {b->K1, b->K2, b->T};
        for (int k = 0; k < 3; k++)
            if (slot[k] >= m->slots || (slot[k] && (slot[k] < split) != engine))
                return refuse(r, "model block: term %s refers to a table outside its group", e->name);
        term_t *t = &m->term[i];
        *t = (term_t){b->K1, b->K2, b->T, A_ONE, A_ONE, b->coefficient};
        if (!factor(r, b->v1, &t->v1) || !factor(r, b->v2, &t->v2))
            return refuse(r, "model block: term %s refers to an unknown variable", e->name);
        if (engine && (is_thrust(t->v1) || is_thrust(t->v2)))
            return refuse(r, "model block: engine term %s cannot depend on a thrust", e->name);
        if (i && rank(b->coefficient) < rank(m->term[i - 1].coefficient))
            return refuse(r, "model block: terms are not sorted by coefficient");
        if (engine) {
            e->units = e->display_units = "N";
            m->engine[b->coefficient - COEFFICIENTS].has_table = true;
            m->first_term[AERO_GROUP] = i + 1;
        }
        if (!note_implicit(r, i)) return false;
    }
    m->first_term[GROUPS] = m->terms;
    uint32_t i = m->first_term[AERO_GROUP];
    for (uint32_t c = 0; c <= COEFFICIENTS; c++) {
        while (i < m->terms && m->term[i].coefficient < c) i++;
        m->first_of[c] = i;
    }
    return true;
}

static bool read_engines(reader *r) {
    const engine_record *record = r->at[ENGINES];
    for (uint32_t i = 0; i < r->model->engines; i++) {
        if (!all_finite(record[i].position, 3) || !all_finite(record[i].direction, 3))
            return refuse(r, "model block: engine %u has a position or direction that is not finite", (unsigned)(i + 1));
        memcpy(r->model->engine[i].position, record[i].position, sizeof record[i].position);
        memcpy(r->model->engine[i].direction, record[i].direction, sizeof record[i].direction);
    }
    return true;
}

static bool check_scales(reader *r) {
    const am_model *m = r->model;
    for (uint32_t i = 0; i < m->terms; i++)
        if (strncmp(m->entry[AM_PARAMETER][m->count[AM_PARAMETER] - (int)m->terms + (int)i].name, "term.", 5) != 0)
            return refuse(r, "model block: the scale of term %s is not a parameter term.*", m->entry[AM_TERM][i].name);
    return true;
}

static bool read_block(reader *r, const unsigned char *bytes, size_t n) {
    if (!check_header(r, bytes, n)) return false;
    if (!(r->model = calloc(1, sizeof *r->model)) || !(r->model->block = malloc(n))) return refuse(r, "model block: no memory");
    memcpy(r->model->block, bytes, n);
    if (!find_sections(r, n) || !reserve(r) || !read_geometry(r)) return false;
    for (int kind = AM_INPUT; kind <= AM_VARIABLE; kind++)
        if (!read_entries(r, INPUTS + kind, (am_kind)kind)) return false;
    if (!check_names(r, AM_INPUT, 0) || !check_names(r, AM_OUTPUT, 0) || !check_names(r, AM_PARAMETER, r->model->terms)) return false;
    return read_variables(r) && read_axes(r) && read_bundles(r) && read_terms(r) && read_engines(r) && check_scales(r);
}

am_model *am_load(const void *bytes, size_t n, char *err, size_t nerr) {
    reader r = {.err = err, .nerr = nerr};
    if (err && nerr) err[0] = 0;
    if (read_block(&r, bytes, n)) {
        r.model->sim_bytes = sim_size(r.model);
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
    free(model->engine);
    free(model->block);
    free(model);
}
