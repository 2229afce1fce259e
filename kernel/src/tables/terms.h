/* Terms of a stage: K1 K2 table v1 v2 max(w, floor)^exponent, each times its scale. */
#ifndef AEROMATCH_TERMS_H
#define AEROMATCH_TERMS_H

#include "elementary_real.h"
#include "flight.h"

#define NEAR_POWER 4e-4 /* of the base */
#define MOST_POWER 8.0

/* base^s: in the later slopes of a step from that of the anchor by the binomial series, where what
 * is left out is at most 1716 NEAR_POWER^6 of it, 7e-18. */
static inline real power_near(const flight_t *sim, real base, real s) {
    const real *anchor = sim->last_power + A_POWER;
    const real u = (base - anchor[0]) / anchor[0];
    mask_t near = everywhere(sim->anchored);
    near &= size_of(u) < NEAR_POWER;
    near &= size_of(s) < MOST_POWER;
    near &= anchor[1] == s;
    if (!ANY(near)) return POW(base, s);
    const real r3 = 1.0 + (s - 3.0) * (1.0 / 4.0) * u * (1.0 + (s - 4.0) * (1.0 / 5.0) * u);
    const real r1 = 1.0 + (s - 1.0) * (1.0 / 2.0) * u * (1.0 + (s - 2.0) * (1.0 / 3.0) * u * r3);
    const real series = anchor[2] + anchor[2] * (s * u * r1);
    return EVERY(near) ? series : PICK(near, series, POW(base, s));
}

/* max(w, floor)^exponent of the power factor at a place; the last one is stored, since the terms of
 * an effect share it. */
static inline real power_value(const flight_t *sim, uint32_t place) {
    const power_t *power = &sim->model->power[place];
    const real v = sim->var[power->variable];
    const real base = PICK(v > power->floor, v, power->floor);
    real *last = sim->last_power;
    if (!EVERY((last[0] == base) & (last[1] == sim->exponent[place]))) {
        last[0] = base;
        last[1] = sim->exponent[place];
        last[2] = power_near(sim, base, last[1]);
    }
    return last[2];
}

/* The last power is that of the anchor. */
static inline void anchor_power(flight_t *sim) {
    memcpy(sim->last_power + A_POWER, sim->last_power, A_POWER * sizeof *sim->last_power);
}

/* scale T v1 v2 K1 K2 power of term i, with tables and variables as they stand. */
static inline real term_value(const flight_t *sim, uint32_t i) {
    const term_t *t = &sim->model->term[i];
    real value = sim->scale[i] * sim->slot[t->T] * (sim->var[t->v1] * sim->var[t->v2]);
    if (t->K1 | t->K2) value *= sim->slot[t->K1] * sim->slot[t->K2];
    if (t->power) value *= power_value(sim, t->power - 1);
    return value;
}

/* Tables, terms and the sums over each target of a stage that has terms: sim->slot, sim->sum. */
void evaluate_terms(flight_t *sim, int stage);

static inline void evaluate_stage(flight_t *sim, int stage) {
    const uint32_t *first = sim->model->first_term;
    if (first[stage] < first[stage + 1]) evaluate_terms(sim, stage);
}

/* The same for the coefficients, without the terms that have a coefficient or an implicit
 * variable. */
void evaluate_coefficients(flight_t *sim, real c[COEFFICIENTS]);

/* After scales or anything else has been set anew: which terms have to be evaluated, and how. */
void list_terms(flight_t *sim);

/* term[am_count(AM_TERM)]: contribution of each at the last derivative, implicit variables
 * included. */
void contributions(const flight_t *sim, real *term);

#endif
