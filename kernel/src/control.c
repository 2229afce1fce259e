#include "model.h"

int control_check(am_sim *sim) { return (void)sim, AM_OK; }
void control_start(am_sim *sim, double t) { (void)sim, (void)t; }
void control_advance(am_sim *sim, double t, double h, const double *u0, const double *u1) { (void)sim, (void)t, (void)h, (void)u0, (void)u1; }
double control_deflection(const am_sim *sim, const double *u, int control) { (void)sim; return u[control]; }
void control_outputs(am_sim *sim, double *y) { (void)sim, (void)y; }
