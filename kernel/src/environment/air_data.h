/* The standard atmosphere and what an aircraft feels of the air. */
#ifndef AEROMATCH_AIR_DATA_H
#define AEROMATCH_AIR_DATA_H

#include "flight.h"

/* US Standard Atmosphere 1976 with a temperature offset [K] and pressure at sea level [Pa]. */
void set_atmosphere(atmosphere_t *atm, double delta_T, double qnh);
void set_standard(atmosphere_t *atm);

/* Height of the standard atmosphere with the static pressure p [Pa]: what an altimeter set to
 * 1013.25 hPa shows. [m] */
real pressure_altitude(const layers_r *standard, real p);

/* Keep the air and the flow in now for the later slopes of a step, which are found from them. */
void anchor_air(const now_r *now, anchor_r *anchor);

/* Temperature [K], pressure [Pa], density [kg m-3] and speed of sound [m s-1] at height h [m].
 * anchor: NULL for none. */
void atmosphere_at(const layers_r *atm, const anchor_r *anchor, real h, real *T, real *p, real *rho,
                   real *a);

/* V, alpha, beta, mach, qbar and their trigonometry from the velocity relative to the air in body
 * axes [m s-1]; now->rho and now->a are set. */
void air_data(now_r *now, const anchor_r *anchor, const real velocity[3]);

/* Calibrated airspeed [m s-1] at a Mach number and static pressure [Pa]. */
real calibrated_airspeed(real mach, real p);

#endif
