/* One propeller on its shaft: blades, governor, speed, loads on the aircraft; engine.c calls it. */
#ifndef AEROMATCH_PROPELLER_H
#define AEROMATCH_PROPELLER_H

#include "algebra.h"
#include "flight.h"
#include "shaft_limits.h"

int propeller_check(am_sim *sim, uint32_t engine);
/* advance ratio, speeds and what else the tables depend on */
void propeller_variables(flight_t *sim, uint32_t engine, const real *x, const real *u);
/* Thrust along the thrust line [N]; adds the other loads to F and M, the angular momentum to H, and
 * sets the rates of the shaft.  torque: of the engine, at the crankshaft [N m]; own: what the
 * tables of shaft power count with, 0 ... 1. */
real propeller_loads(flight_t *sim, uint32_t engine, const real *x, const real *u, real torque,
                     real own, real F[restrict 3], real M[restrict 3], real H[restrict 3],
                     real *dx);
void propeller_outputs(const flight_t *sim, uint32_t engine, real *y);

/* Power of the tables of shaft power, behind its lag [W]. */
real propeller_power(const flight_t *sim, uint32_t engine, const real *x);
/* shaft power to its steady value at the present tables, governor at rest */
void propeller_settle(am_sim *sim, uint32_t engine);

/* Lowest blade angle that the governor may set. */
static inline real lowest_blade_angle(const flight_t *sim, uint32_t i) {
    return has_terms(sim->model, G_PROPELLER, i, T_LOW_STOP)
               ? sum_of(sim, G_PROPELLER, i)[T_LOW_STOP]
               : par_of(sim, G_PROPELLER, i)[P_LOW_PITCH];
}

/* Speed that the governor holds: that of the lever, or the recorded one. */
static inline real commanded_rpm(const flight_t *sim, uint32_t i, const real *u) {
    const real *p = par_of(sim, G_PROPELLER, i);
    const real lever = var_of(sim, G_PROPELLER, i)[A_PROP_COMMAND];
    const real set = p[P_RPM_LOW] + clamp(lever, 0.0, 1.0) * (p[P_RPM_HIGH] - p[P_RPM_LOW]);
    if (sim->drive < TORQUE_DRIVEN) return set;
    const real recorded = input_of(sim, u, G_PROPELLER, i)[U_RPM_DRIVE];
    return PICK(recorded > 0.0, recorded, set);
}

#endif
