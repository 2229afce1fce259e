/* Terms of a stage: K1 K2 table v1 v2 max(w, floor)^exponent, each times its scale. */
#ifndef AEROMATCH_TERMS_H
#define AEROMATCH_TERMS_H

#include "elementary.h"
#include "simulation.h"

/* max(w, floor)^exponent of the power factor at a place; the last one is kept, since the terms of
 * an effect share it. */
static inline double power_value(const am_sim *sim, uint32_t place) {
    const power_t *power = &sim->model->power[place];
    const double v = sim->var[power->variable];
    const double base = v > power->floor ? v : power->floor;
    double *last = sim->last_power;
    if (last[0] != base || last[1] != sim->exponent[place]) {
        last[0] = base;
        last[1] = sim->exponent[place];
        last[2] = am_pow(base, last[1]);
    }
    return last[2];
}

/* scale T v1 v2 K1 K2 power of term i, with tables and variables as they stand. */
static inline double term_value(const am_sim *sim, uint32_t i) {
    const term_t *t = &sim->model->term[i];
    double value = sim->scale[i] * sim->slot[t->T] * (sim->var[t->v1] * sim->var[t->v2]);
    if (t->K1 | t->K2) value *= sim->slot[t->K1] * sim->slot[t->K2];
    return t->power ? value * power_value(sim, t->power - 1) : value;
}

/* Tables, terms and the sums over each target of a stage: sim->slot, sim->term, sim->sum. */
void evaluate_stage(am_sim *sim, int stage);

/* Terms of a stage from tables that have been looked up, but those with a coefficient or an
 * implicit variable. */
void evaluate_terms(am_sim *sim, int stage);

/* The terms with a coefficient or an implicit variable, as these stand; their places are zero
 * but between these two. */
void evaluate_special(am_sim *sim);
void leave_out_special(am_sim *sim);

/* Sum of the terms of each coefficient. */
void sum_coefficients(const am_sim *sim, double c[COEFFICIENTS]);

/* term[am_count(AM_TERM)]: contribution of each at the last derivative, implicit variables
 * included. */
void contributions(const am_sim *sim, double *term);

#endif
