/* Between lanes and the simulation of each: numbers of one lane, given to it or taken from it. */
#ifndef AEROMATCH_LANED_H
#define AEROMATCH_LANED_H

#include "flight.h"

static inline double *give(const real *from, size_t n, int lane, double *to) {
    for (size_t i = 0; i < n; i++) to[i] = from[i][lane];
    return to;
}

static inline void take(const double *from, size_t n, int lane, real *to) {
    for (size_t i = 0; i < n; i++) to[i][lane] = from[i];
}

/* now_r is made of real, as now_t of double. */
static inline void give_now(const flight_t *f, int lane) {
    give((const real *)&f->now, sizeof(now_t) / sizeof(double), lane, (double *)&f->lane[lane]->now);
}

/* What the submodels look at in a derivative: state and inputs stand in x_work and u_work. */
static inline void give_condition(const flight_t *f, int lane, const real *x, const real *u) {
    am_sim *sim = f->lane[lane];
    give_now(f, lane);
    give(f->var, f->model->total[AM_VARIABLE], lane, sim->var);
    give(x, (size_t)am_state_count(f->model), lane, sim->x_work);
    give(u, (size_t)f->model->count[AM_INPUT], lane, sim->u_work);
    sim->part = f->part;
    sim->clock = f->clock;
}

#endif
