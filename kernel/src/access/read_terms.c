/* Terms of a block: what each multiplies, and what multiplies it. */
#include "read_terms.h"

#include <float.h>
#include <math.h>

static bool read_factor(const reader *r, uint32_t reference, uint32_t *code) {
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

/* A term may hold one of alphadothat, betadothat, dnz, which are solved for. */
static bool note_implicit(reader *r, uint32_t i) {
    am_model *m = r->model;
    const term_t *t = &m->term[i];
    const char *name = m->entry[AM_TERM][i].name;
    const bool first = is_implicit(t->v1);
    const bool second = is_implicit(t->v2);
    if (first && second) {
        return refuse_block(
            r,
            "model block: term %s has two of alphadothat, betadothat, dnz; only one can be "
            "solved for",
            name);
    }
    if ((first || second) && t->target >= COEFFICIENTS) {
        return refuse_block(r, "model block: term %s cannot depend on alphadothat, betadothat, dnz",
                            name);
    }
    if (!first && !second) return true;
    const bool bare = (first ? t->v2 : t->v1) == A_ONE && !(t->K1 | t->K2 | t->power);
    const uint32_t kind = (first ? t->v1 : t->v2) - A_ALPHADOTHAT;
    m->implicit[m->implicits++] = (implicit_t){i, t->T, t->target, unknown_place(m, kind), bare};
    return true;
}

/* True when the stage of a target may read a variable; only coefficients read coefficients. */
static bool known_there(const reader *r, uint32_t reference, uint32_t target) {
    if (is_coefficient(r->model->variable[reference - 1])) return target < COEFFICIENTS;
    return known_in(r, reference - 1, r->model->target_stage[target]);
}

static bool read_power(reader *r, const term_record *b, term_t *t, const char *name) {
    am_model *m = r->model;
    uint32_t code;
    if (!b->power) return true;
    if (!read_factor(r, b->power, &code) || !known_there(r, b->power, b->target)
        || is_implicit(code)) {
        return refuse_block(r, "model block: term %s has a power of an unknown variable", name);
    }
    if (!(b->floor > 0.0) || !isfinite(b->floor)) {
        return refuse_block(r, "model block: term %s: the floor of its power must be positive",
                            name);
    }
    m->power[m->powers++] = (power_t){code, b->floor};
    t->power = m->powers;
    return true;
}

/* ---- terms that depend on coefficients ------------------------------------------------------- */

/* The coefficients of a database by axes of its forces: a variable to the targets that it is made
 * of, as bits; 0 for one that the database does not have. */
static uint32_t made_of(const am_model *m, uint32_t code) {
    const uint32_t lift_drag = 1u << T_CL | 1u << T_CD;
    const bool body = m->force_axes == BODY_AXES;
    if (!is_coefficient(code)) return 0;
    if (code == A_CL || code == A_CD) return body ? lift_drag : 1u << (T_CL + code - A_CL);
    if (code == A_CX || code == A_CZ) return !body ? 0 : code == A_CX ? 1u << T_CL : 1u << T_CD;
    return 1u << (T_CL + code - A_CL);
}

/* A coefficient that the database does not have. */
static bool foreign(const am_model *m, uint32_t code) {
    return is_coefficient(code) && !made_of(m, code);
}

/* The bundle whose tables write a slot. */
static uint32_t bundle_of(const am_model *m, uint32_t slot) {
    uint32_t low = 0;
    for (uint32_t n = m->bundles; n > 1;) {
        const uint32_t half = n / 2;
        if (slot >= m->bundle[low + half].slot) low += half;
        n -= half;
    }
    return low;
}

/* Targets that a term depends on, as bits. */
static uint32_t needs(const am_model *m, const term_t *t) {
    const uint32_t slot[3] = {t->K1, t->K2, t->T};
    uint32_t found = made_of(m, t->v1) | made_of(m, t->v2);
    if (t->power) found |= made_of(m, m->power[t->power - 1].variable);
    for (int k = 0; k < 3; k++) {
        if (!slot[k]) continue;
        const bundle_t *bundle = &m->bundle[bundle_of(m, slot[k])];
        for (uint32_t i = 0; i < bundle->axes; i++) {
            found |= made_of(m, m->axis[bundle->axis[i]].variable);
        }
    }
    return found;
}

/* One more than the highest level among targets; 0 for no target. */
static uint32_t level_above(const uint32_t level[COEFFICIENTS], uint32_t targets) {
    uint32_t found = 0;
    for (uint32_t t = 0; t < COEFFICIENTS; t++) {
        if (targets >> t & 1 && level[t] + 1 > found) found = level[t] + 1;
    }
    return found;
}

/* Levels of the targets: 0 when no term of one depends on a coefficient. */
static bool find_levels(reader *r, uint32_t level[COEFFICIENTS]) {
    const am_model *m = r->model;
    uint32_t need[COEFFICIENTS] = {0};
    for (uint32_t i = 0; i < m->terms; i++) {
        if (m->term[i].target < COEFFICIENTS) need[m->term[i].target] |= needs(m, &m->term[i]);
    }
    for (int round = 0; round <= COEFFICIENTS; round++) {
        for (uint32_t t = 0; t < COEFFICIENTS; t++) level[t] = level_above(level, need[t]);
    }
    for (uint32_t t = 0; t < COEFFICIENTS; t++) {
        if (level[t] > LEVELS) {
            return refuse_block(r, "model block: coefficients depend on each other in a loop");
        }
    }
    return true;
}

/* True when every table of a term is looked up after the coefficients on its axes are known and
 * no later than the term. */
static bool tables_in_time(const am_model *m, const term_t *t, const uint32_t level[COEFFICIENTS],
                           uint32_t own) {
    const uint32_t slot[3] = {t->K1, t->K2, t->T};
    for (int k = 0; k < 3; k++) {
        if (!slot[k]) continue;
        const uint32_t b = bundle_of(m, slot[k]);
        if (b >= m->first_bundle[STAGE_AERO + own + 1]) return false;
        for (uint32_t i = 0; i < m->bundle[b].axes; i++) {
            const uint32_t code = m->axis[m->bundle[b].axis[i]].variable;
            const uint32_t known = level_above(level, made_of(m, code));
            if (foreign(m, code) || b < m->first_bundle[STAGE_AERO + known]) return false;
        }
    }
    return true;
}

static bool check_late(reader *r, uint32_t i, const uint32_t level[COEFFICIENTS], uint32_t own) {
    const am_model *m = r->model;
    const term_t *t = &m->term[i];
    const char *name = m->entry[AM_TERM][i].name;
    if (foreign(m, t->v1) || foreign(m, t->v2)
        || (t->power && foreign(m, m->power[t->power - 1].variable))) {
        return refuse_block(r, "model block: term %s depends on a coefficient of other force axes",
                            name);
    }
    if (own && (is_implicit(t->v1) || is_implicit(t->v2))) {
        return refuse_block(r,
                            "model block: term %s has a coefficient and one of alphadothat, "
                            "betadothat, dnz; only one of them can be solved for",
                            name);
    }
    if (!tables_in_time(m, t, level, own)) {
        return refuse_block(r, "model block: term %s refers to a table outside its stage", name);
    }
    return true;
}

/* Lists the terms that depend on coefficients in the order of their levels. */
static bool read_late(reader *r) {
    am_model *m = r->model;
    uint32_t level[COEFFICIENTS] = {0};
    if (!find_levels(r, level)) return false;
    for (uint32_t i = 0; i < m->terms; i++) {
        const term_t *t = &m->term[i];
        if (t->target >= COEFFICIENTS) continue;
        const uint32_t own = level_above(level, needs(m, t));
        if (!check_late(r, i, level, own)) return false;
        if (own > m->levels) m->levels = own;
        m->late_force |= own && t->target < T_ROLL;
    }
    for (uint32_t own = 1; own <= m->levels; own++) {
        for (uint32_t i = 0; i < m->terms; i++) {
            const term_t *t = &m->term[i];
            if (t->target >= COEFFICIENTS) continue;
            if (level_above(level, needs(m, t)) == own) m->late[m->lates++] = i;
        }
        m->first_late[own] = m->lates;
    }
    return true;
}

/* ---- what the sums are made of --------------------------------------------------------------- */

static void note_switch(am_model *m, uint32_t code) {
    for (uint32_t i = 0; i < m->terms; i++) {
        const term_t *t = &m->term[i];
        if (t->target < COEFFICIENTS && (t->v1 == code || t->v2 == code)) {
            m->switch_of[m->switches++] = code;
            return;
        }
    }
}

/* Inputs that stay at zero for whole flights; those that a pilot moves all the time are none. */
static void find_switches(am_model *m) {
    for (uint32_t code = A_DELTA_T; code <= A_SPEEDBRAKE; code++) {
        note_switch(m, code);
    }
    for (uint32_t i = 0; i < items(m, G_DEVICE); i++) {
        note_switch(m, place(m, AM_VARIABLE, G_DEVICE, i) + A_DEVICE);
    }
}

/* Whether the table never continues beyond its ends, so that all its values are finite.  An
 * infinite value times zero would not be a number. */
static bool holds(const am_model *m, uint32_t slot) {
    if (!slot) return true;
    const bundle_t *bundle = &m->bundle[bundle_of(m, slot)];
    for (uint32_t k = 0; k < bundle->axes; k++) {
        if (m->entry[AM_AXIS][bundle->axis[k]].flags & AM_LINEAR) return false;
    }
    return true;
}

static uint32_t switches_of(const am_model *m, const term_t *t) {
    uint32_t found = 0;
    if (t->target >= COEFFICIENTS || t->special || !t->bounded) return 0;
    for (uint32_t k = 0; k < m->switches; k++) {
        if (t->v1 == m->switch_of[k] || t->v2 == m->switch_of[k]) found |= 1u << k;
    }
    return found;
}

/* What follows from all terms. */
static void arrange_terms(am_model *m) {
    uint32_t stage = 0;
    find_switches(m);
    for (uint32_t i = 0; i < m->terms; i++) {
        term_t *t = &m->term[i];
        while (stage < m->target_stage[t->target]) m->first_term[++stage] = i;
        t->special = t->target < COEFFICIENTS
                     && (is_implicit(t->v1) || is_implicit(t->v2) || needs(m, t));
        t->bounded = holds(m, t->T) && holds(m, t->K1) && holds(m, t->K2);
        t->switches = switches_of(m, t);
    }
    while (stage < STAGES) m->first_term[++stage] = m->terms;
    for (uint32_t i = 0; i < items(m, G_SPOOL); i++) {
        for (uint32_t t = 0; t < T_PER_SPOOL; t++) {
            m->decks[i] |= (uint64_t)has_terms(m, G_SPOOL, i, t) << t;
        }
    }
    for (uint32_t t = 0; t < COEFFICIENTS; t++) {
        if (m->end_of[t] - m->first_of[t] > m->rows) m->rows = m->end_of[t] - m->first_of[t];
    }
}

/* A slot of the block, whose bundles stand without gaps, as the model counts them. */
static uint32_t with_gaps(const am_model *m, uint32_t slot) {
    uint32_t b = 0;
    while (b + 1 < m->bundles && slot >= m->bundle[b + 1].slot - SPILL * (b + 1)) b++;
    return slot + SPILL * b;
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
        return refuse_block(r, "model block: term %u has no name", (unsigned)i);
    }
    if (b->target >= m->total[AM_TARGET]) {
        return refuse_block(r, "model block: term %s has target %u", e->name, (unsigned)b->target);
    }
    const uint32_t stage = m->target_stage[b->target];
    const uint32_t v[2] = {b->v1, b->v2};
    uint32_t slot[3] = {b->K1, b->K2, b->T};
    for (int k = 0; k < 3; k++) {
        if (!slot[k]) continue;
        uint32_t of_table = stage;
        /* tables over coefficients; levels_agree checks which */
        if (b->target < COEFFICIENTS) {
            while (of_table + 1 < STAGE_HINGE && slot[k] >= r->first_slot[of_table + 1]) of_table++;
        }
        if (slot[k] < r->first_slot[of_table] || slot[k] >= r->first_slot[of_table + 1]) {
            return refuse_block(r, "model block: term %s refers to a table outside its stage",
                                e->name);
        }
        slot[k] = with_gaps(m, slot[k]);
    }
    *t = (term_t){
        .K1 = slot[0], .K2 = slot[1], .T = slot[2], .v1 = A_ONE, .v2 = A_ONE, .target = b->target};
    if (!read_factor(r, b->v1, &t->v1) || !read_factor(r, b->v2, &t->v2)) {
        return refuse_block(r, "model block: term %s refers to an unknown variable", e->name);
    }
    for (int k = 0; k < 2; k++) {
        if (v[k] && !known_there(r, v[k], b->target)) {
            return refuse_block(r,
                                "model block: term %s depends on %s, which is not yet known there",
                                e->name, m->entry[AM_VARIABLE][v[k] - 1].name);
        }
    }
    return read_power(r, b, t, e->name) && note_implicit(r, i);
}

bool read_terms(reader *r) {
    am_model *m = r->model;
    uint32_t stage = 0;
    for (uint32_t i = 0; i < m->terms; i++) {
        if (!read_term(r, i)) return false;
        const uint32_t target = m->term[i].target;
        if (m->target_stage[target] < stage
            || (i && m->target_stage[target] == stage && target < m->term[i - 1].target)) {
            return refuse_block(r, "model block: terms are not sorted by stage and target");
        }
        stage = m->target_stage[target];
        if (i == 0 || target != m->term[i - 1].target) m->first_of[target] = i;
        m->end_of[target] = i + 1;
    }
    arrange_terms(m);
    return read_late(r);
}
