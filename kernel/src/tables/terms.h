/* Terms of a stage: K1 K2 table v1 v2 max(w, floor)^exponent, each times its scale. */
#ifndef AEROMATCH_TERMS_H
#define AEROMATCH_TERMS_H

#include "elementary_real.h"
#include "flight.h"

/* max(w, floor)^exponent of the power factor at a place; the last one is kept, since the terms of
 * an effect share it. */
static inline real power_value(const flight_t *sim, uint32_t place) {
    const power_t *power = &sim->model->power[place];
    const real v = sim->var[power->variable];
    const real base = PICK(v > power->floor, v, power->floor);
    real *last = sim->last_power;
    if (!EVERY((last[0] == base) & (last[1] == sim->exponent[place]))) {
        last[0] = base;
        last[1] = sim->exponent[place];
        last[2] = POW(base, last[1]);
    }
    return last[2];
}

/* scale T v1 v2 K1 K2 power of term i, with tables and variables as they stand. */
static inline real term_value(const flight_t *sim, uint32_t i) {
    const term_t *t = &sim->model->term[i];
    real value = sim->scale[i] * sim->slot[t->T] * (sim->var[t->v1] * sim->var[t->v2]);
    if (t->K1 | t->K2) value *= sim->slot[t->K1] * sim->slot[t->K2];
    if (t->power) value *= power_value(sim, t->power - 1);
    return value;
}

/* Tables, terms and the sums over each target of a stage: sim->slot, sim->term, sim->sum. */
void evaluate_stage(flight_t *sim, int stage);

/* Terms of a stage from tables that have been looked up, but those with a coefficient or an
 * implicit variable. */
void evaluate_terms(flight_t *sim, int stage);

/* The terms with a coefficient or an implicit variable, as these stand; their places are zero
 * but between these two. */
void evaluate_special(flight_t *sim);
void leave_out_special(flight_t *sim);

/* Sum of the terms of each coefficient. */
void sum_coefficients(const flight_t *sim, real c[COEFFICIENTS]);

/* term[am_count(AM_TERM)]: contribution of each at the last derivative, implicit variables
 * included. */
void contributions(const flight_t *sim, real *term);

#endif
