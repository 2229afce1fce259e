/* Wind, turbulence and discrete gust. */
#ifndef AEROMATCH_WEATHER_H
#define AEROMATCH_WEATHER_H

#include "simulation.h"

/* Check the parameters. */
int weather_check(am_sim *sim);

/* Whether the memory, which may come from outside, is one that a simulation can have. */
bool weather_memory_valid(const am_sim *sim);

/* Discrete memory at the start, and from t to t + h [s]. */
void weather_start(am_sim *sim, double t);
void weather_advance(am_sim *sim, double t, double h, const double *u0, const double *u1);

/* Velocity of the air, north east down [m s-1], and its rotation in now->gust_rate [rad s-1]. */
void weather_wind(am_sim *sim, const double *u, double wind[3]);

/* The same at height h [m] without turbulence and gusts. */
void steady_wind(const am_sim *sim, const double *u, double h, double wind[3]);

void weather_outputs(am_sim *sim, double *y);

#endif
