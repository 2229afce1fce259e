/* What the equations of motion ask of submodels that do not run in lanes throughout: gusts and
 * turbulence. */
#ifndef AEROMATCH_LANED_PARTS_H
#define AEROMATCH_LANED_PARTS_H

#include "laned.h"
#include "laned_tables.h"
#include "parts.h"
#include "weather.h"

/* ---- wind ------------------------------------------------------------------------------------ */

static void laned_wind_of(flight_t *f, const real *u, real wind[3]) {
    const real *par = f->par + place(f->model, AM_PARAMETER, G_WEATHER, 0);
    now_r *now = &f->now;
    if (!f->windy) {
        plain_wind(par, u, now, f->wind, f->gust, wind);
        return;
    }
    for (int l = 0; l < LANES; l++) {
        am_sim *sim = f->lane[l];
        double air[3];
        copy_now_from_lane(f, l, BEFORE_FORCES);
        sim->part = f->part;
        weather_wind(sim, copy_from_lane(u, (size_t)f->model->count[AM_INPUT], l, sim->u_work),
                     air);
        copy_to_lane(air, 3, l, wind);
        copy_to_lane(sim->now.gust_rate, 3, l, now->gust_rate);
        copy_to_lane(work_of(sim, G_WEATHER, 0) + W_WIND, 3, l, f->wind);
        copy_to_lane(work_of(sim, G_WEATHER, 0) + W_GUST, 3, l, f->gust);
    }
}

#endif
