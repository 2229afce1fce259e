/* Terms of a stage and their sums. */
#include "terms.h"

#include "table.h"

void evaluate_terms(flight_t *sim, int stage) {
    const am_model *m = sim->model;
    const real *scale = sim->scale;
    const real *slot = sim->slot;
    const real *var = sim->var;
    real *term = sim->term;
#pragma clang loop unroll_count(4)
    for (const plain_t *t = m->plain + m->first_plain[stage],
                       *end = m->plain + m->first_plain[stage + 1];
         t < end; t++) {
        term[t->place] = scale[t->term] * slot[t->T] * var[t->v];
    }
    for (const factored_t *t = m->factored + m->first_factored[stage],
                          *end = m->factored + m->first_factored[stage + 1];
         t < end; t++) {
        term[t->place] = scale[t->term] * slot[t->T] * (var[t->v1] * var[t->v2]) * slot[t->K];
    }
    for (uint32_t k = m->first_mixed[stage]; k < m->first_mixed[stage + 1]; k++) {
        term[m->term[m->mixed[k]].place] = term_value(sim, m->mixed[k]);
    }
}

void evaluate_special(flight_t *sim) {
    const am_model *m = sim->model;
    for (uint32_t k = 0; k < m->implicits; k++) {
        sim->term[m->term[m->implicit[k][0]].place] = term_value(sim, m->implicit[k][0]);
    }
    for (uint32_t k = 0; k < m->lates; k++) {
        sim->term[m->term[m->late[k]].place] = term_value(sim, m->late[k]);
    }
}

void leave_out_special(flight_t *sim) {
    const am_model *m = sim->model;
    for (uint32_t k = 0; k < m->implicits; k++) sim->term[m->term[m->implicit[k][0]].place] = 0.0;
    for (uint32_t k = 0; k < m->lates; k++) sim->term[m->term[m->late[k]].place] = 0.0;
}

/* One value after another: they have just been written one by one, and a load of several would
 * wait for the stores. */
void sum_coefficients(const flight_t *sim, real c[COEFFICIENTS]) {
    real CL = 0.0;
    real CD = 0.0;
    real CY = 0.0;
    real Cl = 0.0;
    real Cm = 0.0;
    real Cn = 0.0;
    for (const real *term = sim->term, *end = term + ROW * (size_t)sim->model->rows; term < end;
         term += ROW) {
        CL += term[T_CL];
        CD += term[T_CD];
        CY += term[T_CY];
        Cl += term[T_ROLL];
        Cm += term[T_PITCH];
        Cn += term[T_YAW];
    }
    c[T_CL] = CL;
    c[T_CD] = CD;
    c[T_CY] = CY;
    c[T_ROLL] = Cl;
    c[T_PITCH] = Cm;
    c[T_YAW] = Cn;
}

void evaluate_stage(flight_t *sim, int stage) {
    const am_model *m = sim->model;
    if (m->first_term[stage] == m->first_term[stage + 1]) return;
    look_up(sim, stage);
    evaluate_terms(sim, stage);
    real *sum = sim->sum;
    const real *term = sim->term;
    for (const term_t *t = m->term + m->first_term[stage],
                      *end = m->term + m->first_term[stage + 1];
         t < end; t++) {
        sum[t->target] = (t->first ? (real)0.0 : sum[t->target]) + term[t->place];
    }
}

void contributions(const flight_t *sim, real *term) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < m->terms; i++) term[i] = sim->term[m->term[i].place];
    for (uint32_t i = 0; i < m->implicits; i++) {
        term[m->implicit[i][0]] = term_value(sim, m->implicit[i][0]);
    }
    for (uint32_t i = 0; i < m->lates; i++) term[m->late[i]] = term_value(sim, m->late[i]);
}
