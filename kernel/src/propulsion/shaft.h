/* What turns a propeller, and both together: rates, loads and steady state; engine.c calls it. */
#ifndef AEROMATCH_SHAFT_H
#define AEROMATCH_SHAFT_H

#include "flight.h"

static inline bool propelled(const am_model *m) { return items(m, G_PROPELLER) > 0; }

int shaft_check(am_sim *sim, uint32_t engine);
/* what the tables depend on; those of the spools are set */
void shaft_variables(flight_t *sim, uint32_t engine, const real *x, const real *u);
/* Thrust along the thrust line [N]; adds the other loads to F and M and the angular momentum to H,
 * adds to the fuel flow [kg s-1], sets the rates of shaft and engine.  The rates of the spools are
 * set before. */
real shaft_loads(flight_t *sim, uint32_t engine, const real *x, const real *u, real *fuel_flow,
                 real F[restrict 3], real M[restrict 3], real H[restrict 3], real *dx);
void shaft_outputs(const flight_t *sim, uint32_t engine, real *y);
/* The rated speed, from which shaft_start looks for the steady one. */
void shaft_guess(am_sim *sim, uint32_t engine);
/* Steady speed, blade angle, manifold pressure and power of an engine; look: finds variables and
 * tables of all engines at the present state. */
void shaft_start(am_sim *sim, uint32_t engine, void (*look)(am_sim *));

#endif
