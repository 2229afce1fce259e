/* Terms of a block: what each multiplies, and the list of its stage that its form allows. */
#include "read_terms.h"

#include <float.h>
#include <math.h>

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
        return refuse_block(
            r,
            "model block: term %s has two of alphadothat, betadothat, dnz; only one can be "
            "solved for",
            name);
    }
    if (lift && (first || second || t->target < T_ROLL || t->target > T_YAW)) {
        return refuse_block(
            r,
            "model block: term %s uses CL, which only terms of Cl, Cm and Cn without "
            "alphadothat, betadothat, dnz can",
            name);
    }
    if ((first || second || lift) && t->target >= COEFFICIENTS) {
        return refuse_block(
            r, "model block: term %s cannot depend on alphadothat, betadothat, dnz or CL", name);
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
        if (slot[k] < r->first_slot[stage] || slot[k] >= r->first_slot[stage + 1]) {
            return refuse_block(r, "model block: term %s refers to a table outside its stage",
                                e->name);
        }
        slot[k] += SPILL * stage;
    }
    *t = (term_t){
        .K1 = slot[0], .K2 = slot[1], .T = slot[2], .v1 = A_ONE, .v2 = A_ONE, .target = b->target};
    if (!factor(r, b->v1, &t->v1) || !factor(r, b->v2, &t->v2)) {
        return refuse_block(r, "model block: term %s refers to an unknown variable", e->name);
    }
    for (int k = 0; k < 2; k++) {
        if (v[k] && !known_in(r, v[k] - 1, stage)) {
            return refuse_block(r,
                                "model block: term %s depends on %s, which is not yet known there",
                                e->name, m->entry[AM_VARIABLE][v[k] - 1].name);
        }
    }
    return read_power(r, b, t, e->name) && note_special(r, i);
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
    place_terms(m);
    return true;
}
