/* Nose-wheel steering: what the steered wheels hand to it, and its calls. */
#ifndef AEROMATCH_STEERING_H
#define AEROMATCH_STEERING_H

#include "simulation.h"
#include "tyre.h"

typedef struct {
    double side;    /* force to the right [N] */
    double grip;    /* friction coefficient times load [N] */
    double renewal; /* of the rubber on the ground by rolling [s-1] */
    double speed;   /* of the wheel over ground [m s-1] */
    double across;  /* its part across the wheel, right [m s-1] */
    double yaw;     /* rate of the aircraft about the vertical [rad s-1] */
} steered_t;

int steering_check(am_sim *sim);
void steering_start(am_sim *sim, double *x);
double steering_angle(const am_sim *sim, const double *x);
double steering_derivative(am_sim *sim, const double *x, const double *u, const steered_t *wheel,
                           double *dx);

#endif
