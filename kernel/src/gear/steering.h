/* Nose-wheel steering: what the steered wheels hand to it, and its calls. */
#ifndef AEROMATCH_STEERING_H
#define AEROMATCH_STEERING_H

#include "flight.h"
#include "tyre.h"

typedef struct {
    real side;    /* force to the right [N] */
    real grip;    /* friction coefficient times load [N] */
    real renewal; /* of the rubber on the ground by rolling [s-1] */
    real speed;   /* of the wheel over ground [m s-1] */
    real across;  /* its part across the wheel, right [m s-1] */
    real yaw;     /* rate of the aircraft about the vertical [rad s-1] */
} steered_t;

int steering_check(am_sim *sim);
void steering_start(am_sim *sim, double *x);
real steering_angle(const flight_t *sim, const real *x);
real steering_derivative(flight_t *sim, const real *x, const real *u, const steered_t *wheel,
                         real *dx);

#endif
