/* Wind, turbulence and discrete gust. */
#ifndef AEROMATCH_WEATHER_H
#define AEROMATCH_WEATHER_H

#include "algebra.h"
#include "flight.h"

/* Check the parameters. */
int weather_check(am_sim *sim);

/* Whether the memory, which may come from outside, is one that a simulation can have. */
bool weather_memory_valid(const am_sim *sim);

/* Discrete memory at the start, and from t to t + h [s]. */
void weather_start(am_sim *sim, double t);
void weather_advance(am_sim *sim, double t, double h, const double *u0, const double *u1);

/* Whether the wind is more than its inputs and a shear, or was and has been switched off since:
 * that blows to the end of its step.  What does not move needs no memory. */
static inline bool air_moves(const am_sim *sim) {
    return sim->windy || memory_of(sim, G_WEATHER, 0)[D_LIVE] != 0.0;
}

/* Velocity of the air, north east down [m s-1], and its rotation in now->gust_rate [rad s-1]. */
void weather_wind(am_sim *sim, const double *u, double wind[3]);

/* The same at height h [m] without turbulence and gusts. */
void steady_wind(const am_sim *sim, const double *u, double h, double wind[3]);

void weather_outputs(am_sim *sim, double *y);

/* Wind of the inputs with a shear; par: parameters of the weather. */
static inline void sheared_wind(const real *par, const real *u, real h, real wind[3]) {
    const real above = h - par[P_SHEAR_H];
    for (int i = 0; i < 3; i++) wind[i] = u[U_WIND_N + i] + par[P_SHEAR_N + i] * above;
}

/* Nothing but the inputs and a shear makes the wind; also where it and the gust stand for the
 * outputs. */
static inline void plain_wind(const real *par, const real *u, now_r *now, real total[3],
                              real gust[3], real wind[3]) {
    sheared_wind(par, u, now->h, wind);
    for (int i = 0; i < 3; i++) {
        gust[i] = now->gust_rate[i] = 0.0;
        total[i] = wind[i] += gust[i];
    }
}

/* Outputs of the weather from wind and gust, north east down. */
static inline void air_outputs(const now_r *now, const real wind[3], const real gust[3],
                               real *out) {
    real earth[3];
    for (int i = 0; i < 3; i++) {
        earth[i] = gust[0] * now->north[i] + gust[1] * now->east[i] + gust[2] * now->down[i];
    }
    to_body(now->C, earth, out + Y_AIR_GUST_U);
    for (int i = 0; i < 3; i++) {
        out[Y_AIR_WIND_N + i] = wind[i];
        out[Y_AIR_GUST_P + i] = now->gust_rate[i];
    }
}

#endif
