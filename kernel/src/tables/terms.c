/* Terms of a stage and their sums. */
#include "terms.h"

#include "look_up.h"

#define WAIT 256 /* evaluations for which a switch is off before its terms are no longer listed */

/* ---- lists ----------------------------------------------------------------------------------- */

/* The switches that are zero, as bits. */
static uint32_t switched_off(const flight_t *sim) {
    const am_model *m = sim->model;
    uint32_t off = 0;
    for (uint32_t k = 0; k < m->switches; k++) {
        off |= (uint32_t)EVERY(sim->var[m->switch_of[k]] == 0.0) << k;
    }
    return off;
}

static bool is_plain(const term_t *t) {
    return !t->K1 && !t->K2 && !t->power && (t->v1 == A_ONE || t->v2 == A_ONE);
}

static uint32_t variable_of(const term_t *t) { return t->v1 == A_ONE ? t->v2 : t->v1; }

/* Lists a product; returns where it will stand. */
static uint32_t list_product(flight_t *sim, int stage, uint32_t i) {
    const term_t *t = &sim->model->term[i];
    const lists_t *to = &sim->lists;
    list_ends_t *end = &sim->ends;
    if (t->power) {
        to->powered[end->powered[stage]++] = (powered_t){i,     t->T,  t->v1,       t->v2,
                                                         t->K1, t->K2, t->power - 1};
    } else if (t->K2) {
        to->mixed[end->mixed[stage]++] = i;
    } else if (!is_plain(t)) {
        to->factored[end->factored[stage]++] = (factored_t){i, t->T, t->v1, t->v2, t->K1};
    } else {
        to->plain[end->plain[stage]++] = (plain_t){i, t->T, variable_of(t)};
    }
    return sim->model->slots + i;
}

/* Where a term stands in the sum of its target: a table that nothing multiplies needs no product,
 * nor does one that only a variable multiplies in a coefficient. */
static void list_addend(flight_t *sim, int stage, uint32_t i, bool further,
                        uint32_t n[COEFFICIENTS]) {
    const term_t *t = &sim->model->term[i];
    const lists_t *to = &sim->lists;
    list_ends_t *end = &sim->ends;
    const bool unscaled = is_plain(t) && stage != STAGE_HINGE && EVERY(sim->scale[i] == 1.0);
    if (t->target < COEFFICIENTS) {
        to->row[n[t->target]++][t->target] = unscaled ? (plain_addend_t){t->T, variable_of(t)}
                                                      : (plain_addend_t){
                                                            list_product(sim, stage, i), A_ONE};
        return;
    }
    const bool bare = unscaled && variable_of(t) == A_ONE;
    const addend_t addend = {bare ? t->T : list_product(sim, stage, i), t->target};
    if (further) to->further[end->further[stage]++] = addend;
    else to->first[end->first[stage]++] = addend;
}

/* A power factor that is beyond any number at its floor: times zero it would be none. */
static bool may_be_infinite(const flight_t *sim, const term_t *t) {
    if (!t->power) return false;
    const real exponent = sim->exponent[t->power - 1];
    const bool falls = EVERY(exponent <= 0.0) && EVERY(exponent > -MOST_POWER);
    return !falls || sim->model->power[t->power - 1].floor < 1e-30;
}

/* Zero by a switch of ends.off or by its scale.  A scale does not remove a power factor: its
 * value is stored for the terms behind it, whose bits must not depend on what other lanes leave
 * out. */
static bool is_zero(const flight_t *sim, uint32_t i) {
    const term_t *t = &sim->model->term[i];
    if (t->switches & sim->ends.off && !may_be_infinite(sim, t)) return true;
    return t->bounded && !t->power && EVERY(sim->scale[i] == 0.0);
}

/* Lists of a stage without the terms that are zero: a zero changes no sum.  The special terms are
 * apart. */
static void list_stage(flight_t *sim, int stage) {
    const am_model *m = sim->model;
    const lists_t *to = &sim->lists;
    list_ends_t *end = &sim->ends;
    uint32_t n[COEFFICIENTS] = {0};
    uint32_t last = UINT32_MAX;
    end->plain[stage] = end->factored[stage] = end->powered[stage] = m->first_term[stage];
    end->mixed[stage] = end->first[stage] = end->further[stage] = m->first_term[stage];
    for (uint32_t i = m->first_term[stage]; i < m->first_term[stage + 1]; i++) {
        const term_t *t = &m->term[i];
        if (t->special) continue;
        if (is_zero(sim, i)) {
            sim->slot[m->slots + i] = 0.0;
            if (t->target != last && i + 1 == m->end_of[t->target]) sim->sum[t->target] = 0.0;
            continue;
        }
        list_addend(sim, stage, i, t->target == last, n);
        last = t->target;
    }
    if (stage != STAGE_AERO) return;
    end->rows = 0;
    for (int k = 0; k < COEFFICIENTS; k++) end->rows = n[k] > end->rows ? n[k] : end->rows;
    for (int k = 0; k < COEFFICIENTS; k++) {
        while (n[k] < end->rows) to->row[n[k]++][k] = (plain_addend_t){m->slots + m->terms, A_ONE};
    }
}

void list_terms(flight_t *sim) {
    for (int stage = 0; stage < STAGES; stage++) list_stage(sim, stage);
}

/* The lists of the coefficients for the switches that are off now.  Terms that are listed and zero
 * only cost time, so one that goes off and on from step to step stays. */
__attribute__((noinline)) static void follow_switches(flight_t *sim, uint32_t off) {
    list_ends_t *end = &sim->ends;
    if (!(end->off & ~off) && ++end->waited < WAIT) return;
    end->off = off;
    end->waited = 0;
    list_stage(sim, STAGE_AERO);
}

/* ---- values ---------------------------------------------------------------------------------- */

/* Of the less frequent forms. */
__attribute__((noinline)) static void find_other_products(flight_t *sim, int stage) {
    const uint32_t first = sim->model->first_term[stage];
    const lists_t *lists = &sim->lists;
    const real *slot = sim->slot;
    const real *var = sim->var;
    real *product = sim->slot + sim->model->slots;
    for (const powered_t *t = lists->powered + first,
                         *end = lists->powered + sim->ends.powered[stage];
         t < end; t++) {
        product[t->term] = sim->scale[t->term] * slot[t->T] * (var[t->v1] * var[t->v2])
                           * (slot[t->K1] * slot[t->K2]) * power_value(sim, t->power);
    }
    for (uint32_t k = first; k < sim->ends.mixed[stage]; k++) {
        product[lists->mixed[k]] = term_value(sim, lists->mixed[k]);
    }
}

static inline void find_products(flight_t *sim, int stage) {
    const am_model *m = sim->model;
    const uint32_t first = m->first_term[stage];
    const real *scale = sim->scale;
    const real *slot = sim->slot;
    const real *var = sim->var;
    real *product = sim->slot + m->slots;
#pragma clang loop unroll_count(4)
    for (const plain_t *t = sim->lists.plain + first,
                       *end = sim->lists.plain + sim->ends.plain[stage];
         t < end; t++) {
        product[t->term] = scale[t->term] * slot[t->T] * var[t->v];
    }
    for (const factored_t *t = sim->lists.factored + first,
                          *end = sim->lists.factored + sim->ends.factored[stage];
         t < end; t++) {
        product[t->term] = scale[t->term] * slot[t->T] * (var[t->v1] * var[t->v2]) * slot[t->K];
    }
    const uint32_t others = sim->ends.powered[stage] + sim->ends.mixed[stage] - 2 * first;
    if (others) find_other_products(sim, stage);
}

void evaluate_terms(flight_t *sim, int stage) {
    const uint32_t first = sim->model->first_term[stage];
    look_up(sim, stage);
    find_products(sim, stage);
    const lists_t *lists = &sim->lists;
    const real *value = sim->slot;
    real *sum = sim->sum;
#pragma clang loop unroll_count(4)
    for (const addend_t *a = lists->first + first, *end = lists->first + sim->ends.first[stage];
         a < end; a++) {
        sum[a->target] = 0.0 + value[a->value];
    }
    for (const addend_t *a = lists->further + first,
                        *end = lists->further + sim->ends.further[stage];
         a < end; a++) {
        sum[a->target] += value[a->value];
    }
}

void evaluate_coefficients(flight_t *sim, real c[COEFFICIENTS]) {
    const uint32_t off = switched_off(sim);
    real CL = 0.0;
    real CD = 0.0;
    real CY = 0.0;
    real Cl = 0.0;
    real Cm = 0.0;
    real Cn = 0.0;
    if (off != sim->ends.off) follow_switches(sim, off);
    look_up(sim, STAGE_AERO);
    find_products(sim, STAGE_AERO);
    const real *value = sim->slot;
    const real *var = sim->var;
    for (const plain_addend_t(*row)[COEFFICIENTS] = sim->lists.row,
               (*end)[COEFFICIENTS] = row + sim->ends.rows;
         row < end; row++) {
        const plain_addend_t *a = *row;
        CL += value[a[T_CL].value] * var[a[T_CL].v];
        CD += value[a[T_CD].value] * var[a[T_CD].v];
        CY += value[a[T_CY].value] * var[a[T_CY].v];
        Cl += value[a[T_ROLL].value] * var[a[T_ROLL].v];
        Cm += value[a[T_PITCH].value] * var[a[T_PITCH].v];
        Cn += value[a[T_YAW].value] * var[a[T_YAW].v];
    }
    c[T_CL] = CL;
    c[T_CD] = CD;
    c[T_CY] = CY;
    c[T_ROLL] = Cl;
    c[T_PITCH] = Cm;
    c[T_YAW] = Cn;
}

void contributions(const flight_t *sim, real *term) {
    const am_model *m = sim->model;
    const uint32_t hinge = m->first_term[STAGE_HINGE];
    const uint32_t behind = m->first_term[STAGE_HINGE + 1];
    for (uint32_t i = 0; i < m->terms; i++) {
        /* the variables of hinge moments were those of one surface after the other */
        const bool of_hinge = i >= hinge && i < behind;
        term[i] = of_hinge ? sim->slot[m->slots + i] : term_value(sim, i);
    }
}
