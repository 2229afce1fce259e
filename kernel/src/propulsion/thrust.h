/* Thrust and rotors of an engine as loads on the aircraft. */
#ifndef AEROMATCH_THRUST_H
#define AEROMATCH_THRUST_H

#include "algebra.h"
#include "catalogue.h"

static inline void push(const real force[3], const real at[3], const real cg[3],
                        real F[restrict 3], real M[restrict 3]) {
    const real arm[3] = {at[0] - cg[0], at[1] - cg[1], at[2] - cg[2]};
    real moment[3];
    cross(arm, force, moment);
    for (int k = 0; k < 3; k++) {
        F[k] += force[k];
        M[k] += moment[k];
    }
}

/* Along the thrust line at the engine.  p: parameters of the engine. */
static inline void add_thrust(const real *p, real thrust, const real cg[3], real F[restrict 3],
                              real M[restrict 3]) {
    const real *line = p + P_DIRECTION_X;
    const real force[3] = {thrust * line[0], thrust * line[1], thrust * line[2]};
    push(force, p + P_ENGINE_X, cg, F, M);
}

/* The rotors add momentum, and torque as they spin up. */
static inline void add_rotors(const real *p, real momentum, real torque, real M[restrict 3],
                              real H[restrict 3]) {
    const real *line = p + P_DIRECTION_X;
    for (int k = 0; k < 3; k++) {
        H[k] += (p[P_ANGULAR_MOMENTUM] + momentum) * line[k];
        M[k] -= torque * line[k];
    }
}

#endif
