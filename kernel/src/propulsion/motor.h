/* One direct-current motor with its controller and battery; engine.c calls it. */
#ifndef AEROMATCH_MOTOR_H
#define AEROMATCH_MOTOR_H

#include "flight.h"

int motor_check(am_sim *sim, uint32_t engine);
void motor_variables(flight_t *sim, uint32_t engine, const real *x);
/* Torque at the shaft of the motor [N m]; sets the rate of the charge. */
real motor_torque(flight_t *sim, uint32_t engine, real *dx);
void motor_outputs(const flight_t *sim, uint32_t engine, real *y);
void motor_start(am_sim *sim, uint32_t engine);

#endif
