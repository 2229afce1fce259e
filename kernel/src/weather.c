#include "model.h"

int weather_check(am_sim *sim) { return (void)sim, AM_OK; }
void weather_start(am_sim *sim, double t) { (void)sim, (void)t; }
void weather_advance(am_sim *sim, double t, double h, const double *u0, const double *u1) { (void)sim, (void)t, (void)h, (void)u0, (void)u1; }
void weather_wind(am_sim *sim, const double *u, double wind[3]) { (void)sim; for (int i = 0; i < 3; i++) wind[i] = u[U_WIND_N + i]; }
void weather_outputs(am_sim *sim, double *y) { (void)sim, (void)y; }
