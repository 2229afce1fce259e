/* The submodels of simulations that fly side by side: wind of the inputs and lagged thrust in
 * lanes; decks, fuel, gear, circuits and gusts in the simulation of each lane. */
#ifndef AEROMATCH_LANED_PARTS_H
#define AEROMATCH_LANED_PARTS_H

#include "fuel.h"
#include "gear.h"
#include "laned.h"
#include "parts.h"
#include "terms.h"
#include "thrust.h"
#include "weather.h"

/* As control_drive.h, where recorded surfaces drive. [rad] */
static real deflection(const flight_t *f, const real *u, int control) {
    const real trim = control <= U_DELTA_R ? f->trim.delta[control] : (real)0.0;
    return u[control] + f->par[P_BIAS_DELTA_E + control] + trim;
}

/* ---- wind ------------------------------------------------------------------------------------ */

static void wind_of(flight_t *f, const real *u, real wind[3]) {
    const real *par = f->par + place(f->model, AM_PARAMETER, G_WEATHER, 0);
    now_r *now = &f->now;
    for (int i = 0; i < 3; i++) f->gust[i] = now->gust_rate[i] = 0.0;
    if (!f->windy) {
        sheared_wind(par, u, now->h, wind);
        for (int i = 0; i < 3; i++) f->wind[i] = wind[i] += f->gust[i];
        return;
    }
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        double air[3];
        give_now(f, l, BEFORE_FORCES);
        sim->part = f->part;
        weather_wind(sim, give(u, (size_t)f->model->count[AM_INPUT], l, sim->u_work), air);
        take(air, 3, l, wind);
        take(sim->now.gust_rate, 3, l, now->gust_rate);
        take(work_of(sim, G_WEATHER, 0) + W_WIND, 3, l, f->wind);
        take(work_of(sim, G_WEATHER, 0) + W_GUST, 3, l, f->gust);
    }
}

/* ---- mass, engines, gear --------------------------------------------------------------------- */

static void mass_of(flight_t *f, const real *x, const real *u) {
    now_r *now = &f->now;
    (void)u;
    if (!items(f->model, G_FUEL)) return;
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        mass_now(sim, give(x, (size_t)am_state_count(f->model), l, sim->x_work));
        take(&sim->now.mass, 1, l, &now->mass);
        take(sim->now.cg, 3, l, now->cg);
        take(sim->now.J[0], 9, l, now->J[0]);
        take(sim->now.J_inverse[0], 9, l, now->J_inverse[0]);
        take(var_of(sim, G_FUEL, 0), A_PER_FUEL, l,
             f->var + place(f->model, AM_VARIABLE, G_FUEL, 0));
    }
}

/* Rates of the states of the submodels, and their variables, from a lane. */
static void take_parts(flight_t *f, int l, real *dx) {
    const am_sim *sim = f->lane[l];
    const size_t states = (size_t)am_state_count(f->model);
    take(sim->k + X_PER_CORE, states - X_PER_CORE, l, dx + X_PER_CORE);
    take(sim->var + A_PER_CORE, f->model->total[AM_VARIABLE] - A_PER_CORE, l, f->var + A_PER_CORE);
}

static void deck_loads(flight_t *f, const real *x, const real *u, real F[3], real M[3], real H[3],
                       real *dx) {
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        double loads[3][3];
        give_condition(f, l, x, u);
        engine_forces(sim, sim->x_work, sim->u_work, loads[0], loads[1], loads[2], sim->k);
        take(loads[0], 3, l, F);
        take(loads[1], 3, l, M);
        take(loads[2], 3, l, H);
        take(sim->now.thrust, items(f->model, G_ENGINE), l, f->now.thrust);
        take_parts(f, l, dx);
    }
}

/* As run_engine of engine.c without a deck. */
static void engine_loads(flight_t *f, const real *x, const real *u, real F[3], real M[3],
                         real H[3], real *dx) {
    const am_model *m = f->model;
    const uint32_t n = items(m, G_ENGINE);
    if (items(m, G_SPOOL)) {
        deck_loads(f, x, u, F, M, H, dx);
        return;
    }
    for (int k = 0; k < 3; k++) F[k] = M[k] = H[k] = 0.0;
    for (uint32_t i = 0; i < n; i++) {
        f->var[place(m, AM_VARIABLE, G_ENGINE, i) + A_THROTTLE] =
            u[place(m, AM_INPUT, G_ENGINE, i) + U_THROTTLE] + f->par[P_BIAS_THROTTLE]
            + f->trim.throttle;
    }
    evaluate_stage(f, STAGE_ENGINE);
    for (uint32_t i = 0; i < n; i++) {
        const real *p = f->par + place(m, AM_PARAMETER, G_ENGINE, i);
        const real table = f->sum[place(m, AM_TARGET, G_ENGINE, i) + T_THRUST];
        const uint32_t state = place(m, AM_STATE, G_ENGINE, i) + X_LAGGED;
        const bool recorded = f->drive == THRUST_DRIVEN;
        const mask_t lags = p[P_TIME_CONSTANT] > 0.0;
        const real own = recorded ? u[place(m, AM_INPUT, G_ENGINE, i) + U_THRUST_DRIVE]
                                  : PICK(lags, x[state], table);
        const real thrust = own + f->par[P_BIAS_THRUST] + f->trim.thrust;
        dx[state] = recorded ? (real)0.0
                             : PICK(lags, (table - x[state]) / p[P_TIME_CONSTANT], 0.0);
        add_thrust(p, thrust, (real)0.0, (real)0.0, f->now.cg, F, M, H);
        f->now.thrust[i] = f->var[place(m, AM_VARIABLE, G_ENGINE, i) + A_THRUST] =
            thrust - 0.0 * f->now.V;
    }
    if (items(m, G_FUEL)) {
        const uint32_t fuel = place(m, AM_STATE, G_FUEL, 0) + X_FUEL;
        dx[fuel] = PICK(x[fuel] > 0.0, -0.0, 0.0);
    }
}

static void gear_loads(flight_t *f, const real *x, const real *u, real F[3], real M[3], real *dx) {
    const size_t states = (size_t)am_state_count(f->model);
    for (int k = 0; k < 3; k++) F[k] = M[k] = 0.0;
    if (!items(f->model, G_GEAR)) return;
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        double loads[2][3];
        if (items(f->model, G_SPOOL)) {
            give(f->var + A_CT, 1, l, sim->var + A_CT); /* the rest stands there */
        } else {
            give_condition(f, l, x, u);
            give(f->now.thrust, items(f->model, G_ENGINE), l, sim->now.thrust);
            give(dx + X_PER_CORE, states - X_PER_CORE, l, sim->k + X_PER_CORE);
        }
        gear_forces(sim, sim->x_work, sim->u_work, loads[0], loads[1], sim->k);
        take(loads[0], 3, l, F);
        take(loads[1], 3, l, M);
        take_parts(f, l, dx);
    }
}

#endif
