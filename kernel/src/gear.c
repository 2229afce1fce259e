#include "model.h"

int gear_check(am_sim *sim) { return (void)sim, AM_OK; }
void gear_start(am_sim *sim, double t) { (void)sim, (void)t; }
void gear_forces(am_sim *sim, const double *x, const double *u, double F[3], double M[3], double *dx) { (void)sim, (void)x, (void)u, (void)dx; for (int i = 0; i < 3; i++) F[i] = M[i] = 0.0; }
void gear_outputs(am_sim *sim, double *y) { (void)sim, (void)y; }
