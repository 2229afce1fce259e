/* Place and motion in Earth-fixed and inertial axes, names: outputs that a model has on request.
 * Both axes coincide at the time zero.  On the flat Earth they point north, east and down. */
#ifndef AEROMATCH_EARTH_NAMES_H
#define AEROMATCH_EARTH_NAMES_H

#define AM_EARTH_INPUTS(X)
#define AM_EARTH_OUTPUTS(X) \
    X(Y_EARTH_X, "earth.x") \
    X(Y_EARTH_Y, "earth.y") \
    X(Y_EARTH_Z, "earth.z") \
    X(Y_EARTH_VX, "earth.vx") \
    X(Y_EARTH_VY, "earth.vy") \
    X(Y_EARTH_VZ, "earth.vz") \
    X(Y_INERTIAL_X, "inertial.x") \
    X(Y_INERTIAL_Y, "inertial.y") \
    X(Y_INERTIAL_Z, "inertial.z") \
    X(Y_INERTIAL_VX, "inertial.vx") \
    X(Y_INERTIAL_VY, "inertial.vy") \
    X(Y_INERTIAL_VZ, "inertial.vz") \
    X(Y_GRAVITATION, "gravitation")
#define AM_EARTH_PARAMETERS(X)
#define AM_EARTH_STATES(X)
#define AM_EARTH_VARIABLES(X)
#define AM_EARTH_TARGETS(X)

#define D_PER_EARTH 0
#define W_PER_EARTH 0

#endif
