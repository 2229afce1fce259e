/* One tyre or skid in the ground plane; wheel axes: x forward along the rolling direction, y
 * right. */
#ifndef AEROMATCH_TYRE_H
#define AEROMATCH_TYRE_H

#include "flight.h"

#define TYRE_LAG 0.02 /* shortest time constant of tyre and steering friction [s] */

typedef struct {
    real stiffness; /* of the carcass along the ground [N m-1] */
    real cornering; /* side force per slip angle at this load [N rad-1]; 0: a skid */
    real load;      /* with which it stands on the ground [N] */
    real mu;        /* greatest friction over load */
    real brake;     /* force that turns the wheel against brake and rolling resistance [N] */
    real loss;      /* damping of the carcass over its stiffness [s] */
} tyre_t;

typedef struct {
    real F[2];    /* on the aircraft [N] */
    real rate[2]; /* of the deflection [m s-1] */
    real renewal; /* rate at which rolling replaces the rubber on the ground [s-1] */
} footprint_t;

void tyre_forces(const tyre_t *tyre, const real deflection[2], const real velocity[2],
                 footprint_t *patch);
real cornering_stiffness(real greatest, real load_of_greatest, real load);

#endif
