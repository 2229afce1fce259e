/* Names of a block: they must be those that this library computes, in its order. */
#include "read_catalogue.h"

#include "names.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bool read_entries(reader *r, int section, am_kind kind) {
    const entry_record *record = r->at[section];
    for (size_t i = 0; i < r->count[section]; i++) {
        am_entry *e = &r->model->entry[kind][i];
        e->name = string_at(r, record[i].name);
        e->units = string_at(r, record[i].units);
        e->display_units = string_at(r, record[i].display_units);
        e->description = string_at(r, record[i].description);
        if (!e->name || !e->units || !e->display_units || !e->description) {
            return refuse_block(r, "model block: %s %zu has a text outside the string table",
                                section_name(section), i);
        }
        e->value = record[i].value;
        e->low = record[i].low;
        e->high = record[i].high;
        if (!isfinite(e->value) || !isfinite(e->low) || !isfinite(e->high) || e->low > e->high) {
            return refuse_block(
                r, "model block: %s %s has a value or range that is not finite or not in order",
                section_name(section), e->name);
        }
        e->flags = (int)(record[i].flags & (AM_FIXED | AM_INTEGER));
    }
    return true;
}

static int control_of(const char *circuit) {
    static const char *const NAME[] = {"column", "wheel", "pedal"};
    for (int i = 0; i <= U_DELTA_R - U_DELTA_E; i++) {
        if (strcmp(circuit, NAME[i]) == 0) return U_DELTA_E + i;
    }
    return -1;
}

/* The item of a group that has this name of `length` characters; false when there is none. */
static bool find_item(const am_model *m, int group, const char *name, size_t length,
                      uint32_t *item) {
    for (uint32_t i = 0; i < m->items[group]; i++) {
        const char *known = m->item[group][i];
        if (strlen(known) != length || strncmp(known, name, length) != 0) continue;
        *item = i;
        return true;
    }
    return false;
}

/* The ends of a feed or transfer from its name: an engine or tank, a dot, and a tank. */
static bool find_ends(const am_model *m, const char *name, int group, uint32_t *first,
                      uint32_t *tank) {
    const char *dot = strchr(name, '.');
    if (!dot) return false;
    return find_item(m, group, name, (size_t)(dot - name), first)
           && find_item(m, G_TANK, dot + 1, strlen(dot + 1), tank);
}

static bool read_feeds(reader *r) {
    am_model *m = r->model;
    const bool tanks = m->items[G_TANK] > 0;
    if (m->items[G_TANKS] != tanks || (tanks && m->items[G_FUEL])) {
        return refuse_block(r, "model block: tanks must be there once where there is a tank, and "
                               "without fuel");
    }
    for (uint32_t i = 0; i < m->items[G_FEED]; i++) {
        const char *name = m->item[G_FEED][i];
        if (!find_ends(m, name, G_ENGINE, &m->feed_engine[i], &m->feed_tank[i])) {
            return refuse_block(r, "model block: feed %s leads from no tank, or to no engine",
                                name);
        }
    }
    for (uint32_t i = 0; i < m->items[G_TRANSFER]; i++) {
        const char *name = m->item[G_TRANSFER][i];
        if (!find_ends(m, name, G_TANK, &m->from_tank[i], &m->to_tank[i])) {
            return refuse_block(r, "model block: transfer %s leads from no tank, or to no tank",
                                name);
        }
    }
    return true;
}

/* Items of the groups, sorted by group; core and weather have exactly one, which has no name. */
bool read_items(reader *r) {
    am_model *m = r->model;
    const item_record *record = r->at[ITEMS];
    for (size_t i = 0; i < r->count[ITEMS]; i++) {
        const uint32_t group = record[i].group;
        const char *name = string_at(r, record[i].name);
        if (group >= GROUPS || !name || (i && group < record[i - 1].group)) {
            return refuse_block(r, "model block: item %zu has a wrong group or name", i);
        }
        if (m->items[group] == MAX_ITEMS) {
            return refuse_block(r, "model block: more than %d items %s", MAX_ITEMS,
                                am_group((int)group));
        }
        if (strlen(name) >= NAME_SIZE / 2) {
            return refuse_block(r, "model block: the name of item %zu is too long", i);
        }
        m->item[group][m->items[group]++] = name;
    }
    if (m->items[G_CORE] != 1 || m->items[G_WEATHER] != 1) {
        return refuse_block(r, "model block: core and weather must be there once");
    }
    if (m->items[G_FUEL] > 1 || m->items[G_GEAR] > 1 || m->items[G_EARTH] > 1
        || m->items[G_SEPARATION] > 1 || m->items[G_ENVELOPE] > 1) {
        return refuse_block(r,
            "model block: fuel, gear, earth, separation and envelope can be there only once");
    }
    if (m->items[G_SPOOL] && m->items[G_SPOOL] != m->items[G_ENGINE]) {
        return refuse_block(r, "model block: %u engines have spools, of %u",
                            (unsigned)m->items[G_SPOOL], (unsigned)m->items[G_ENGINE]);
    }
    for (int group = G_PROPELLER; group <= G_MOTOR; group++) {
        const uint32_t all = m->items[group == G_PROPELLER ? G_ENGINE : G_PROPELLER];
        if (m->items[group] && m->items[group] != all) {
            return refuse_block(r, "model block: %u items %s, of %u engines with a propeller",
                                (unsigned)m->items[group], am_group(group), (unsigned)all);
        }
    }
    if (m->items[G_CONTACT] && !m->items[G_GEAR]) {
        return refuse_block(r, "model block: contacts without a gear");
    }
    for (uint32_t i = 0; i < m->items[G_CIRCUIT]; i++) {
        m->control[i] = control_of(m->item[G_CIRCUIT][i]);
    }
    return read_feeds(r);
}

/* Where the names of each group begin. */
bool find_group_starts(reader *r) {
    am_model *m = r->model;
    for (int kind = 0; kind < NAMED_KINDS; kind++) {
        uint32_t next = kind == AM_VARIABLE; /* variable 0 is the constant 1 */
        for (int group = 0; group < GROUPS; group++) {
            m->per[kind][group] = group_size(kind, group);
            m->first[kind][group] = group == G_CORE ? 0 : next;
            for (uint32_t item = 0; item < MAX_ITEMS; item++) {
                m->begin[kind][group][item] = m->first[kind][group] + item * m->per[kind][group];
            }
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
    if (!m->target_stage) return refuse_block(r, "model block: no memory");
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
bool check_names(reader *r, am_kind kind, size_t extra) {
    const am_model *m = r->model;
    const char *section = section_name(INPUTS + (int)kind);
    const size_t expected = m->total[kind] + extra;
    if ((size_t)m->count[kind] != expected) {
        return refuse_block(r,
                            "model block: %d %s, this library needs %zu; compile the model again",
                            m->count[kind], section, expected);
    }
    for (int group = 0; group < GROUPS; group++) {
        for (uint32_t item = 0; item < m->items[group]; item++) {
            for (uint32_t code = 0; code < m->per[kind][group]; code++) {
                char name[NAME_SIZE];
                const uint32_t i = place(m, (int)kind, group, item) + code;
                item_name(name, group_pattern((int)kind, group, code), m->item[group][item]);
                if (strcmp(name, m->entry[kind][i].name) != 0) {
                    return refuse_block(
                        r, "model block: %s %u is %s, expected %s; compile the model again",
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

bool read_variables(reader *r) {
    am_model *m = r->model;
    for (int i = 0; i < m->count[AM_VARIABLE]; i++) {
        const char *name = m->entry[AM_VARIABLE][i].name;
        int stage;
        if (!variable_code(m, name, &m->variable[i], &stage)) {
            return refuse_block(r, "model block: unknown variable %s", name);
        }
        m->entry[AM_VARIABLE][i].value = stage;
        m->uses_phi |= m->variable[i] == A_PHI;
    }
    return true;
}

/* The last parameters scale the terms; the exponents of the power factors follow, in the order
 * of the terms. */
bool check_scales(reader *r) {
    const am_model *m = r->model;
    const am_entry *e = m->entry[AM_PARAMETER] + m->total[AM_PARAMETER];
    for (uint32_t i = 0; i < m->terms; i++) {
        if (strncmp(e[i].name, "term.", 5) != 0) {
            return refuse_block(r, "model block: the scale of term %s is not a parameter term.*",
                                m->entry[AM_TERM][i].name);
        }
    }
    for (uint32_t i = 0; i < m->powers; i++) {
        if (strncmp(e[m->terms + i].name, "power.", 6) != 0) {
            return refuse_block(
                r, "model block: parameter %s stands where an exponent power.* must be",
                e[m->terms + i].name);
        }
    }
    return true;
}

/* The stage of a variable stood in its entry while the block was read. */
bool forget_stages(reader *r) {
    for (int i = 0; i < r->model->count[AM_VARIABLE]; i++) {
        r->model->entry[AM_VARIABLE][i].value = 0.0;
    }
    return true;
}
