/* What the equations of motion ask of submodels that do not run in lanes throughout: gusts and
 * turbulence, gear on the ground. */
#ifndef AEROMATCH_LANED_PARTS_H
#define AEROMATCH_LANED_PARTS_H

#include "gear.h"
#include "laned.h"
#include "laned_tables.h"
#include "parts.h"
#include "terms.h"
#include "weather.h"

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

/* ---- gear ------------------------------------------------------------------------------------ */

/* Rates of the states, variables and what was found, from a lane. */
static void take_gear(flight_t *f, int l, real *dx) {
    const am_model *m = f->model;
    const am_sim *sim = f->lane[l];
    const uint32_t n = items(m, G_CONTACT);
    take(state_of(sim, sim->k, G_GEAR, 0), X_PER_GEAR, l, state_of(f, dx, G_GEAR, 0));
    take(state_of(sim, sim->k, G_CONTACT, 0), n * X_PER_CONTACT, l, state_of(f, dx, G_CONTACT, 0));
    take(var_of(sim, G_CONTACT, 0), n * A_PER_CONTACT, l, var_of(f, G_CONTACT, 0));
    take(work_of(sim, G_GEAR, 0), W_PER_GEAR, l, work_of(f, G_GEAR, 0));
    take(work_of(sim, G_CONTACT, 0), n * W_PER_CONTACT, l, work_of(f, G_CONTACT, 0));
}

/* Away from the ground in lanes; near it, where legs differ in what they do, in the simulation of
 * each lane. */
static void gear_loads(flight_t *f, const real *x, const real *u, real F[3], real M[3], real *dx) {
    for (int k = 0; k < 3; k++) F[k] = M[k] = 0.0;
    if (!items(f->model, G_GEAR)) return;
    if (EVERY(gear_clear(f, x))) {
        gear_away(f, x, u, dx);
        return;
    }
    f->away = false;
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        double loads[2][3];
        give_condition(f, l, x, u);
        give(f->now.thrust, items(f->model, G_ENGINE), l, sim->now.thrust);
        gear_forces(sim, sim->x_work, sim->u_work, loads[0], loads[1], sim->k);
        take(loads[0], 3, l, F);
        take(loads[1], 3, l, M);
        take_gear(f, l, dx);
    }
    settle_lanes(f, STAGE_GEAR);
}

#endif
