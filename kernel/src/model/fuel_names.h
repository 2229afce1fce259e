/* Fuel, names: what is in the tanks and what it does to mass, centre of gravity and inertia. */
#ifndef AEROMATCH_FUEL_NAMES_H
#define AEROMATCH_FUEL_NAMES_H

#define AM_FUEL_INPUTS(X)
#define AM_FUEL_OUTPUTS(X) \
    X(Y_FUEL, "fuel") \
    X(Y_X_CG_B, "x_cg_b") \
    X(Y_Y_CG_B, "y_cg_b") \
    X(Y_Z_CG_B, "z_cg_b") \
    X(Y_IXX, "Ixx") \
    X(Y_IYY, "Iyy") \
    X(Y_IZZ, "Izz") \
    X(Y_IXY, "Ixy") \
    X(Y_IXZ, "Ixz") \
    X(Y_IYZ, "Iyz")
#define AM_FUEL_PARAMETERS(X) \
    X(P_FUEL_START, "init.fuel") \
    X(P_FUEL_X, "fuel.x") \
    X(P_FUEL_Y, "fuel.y") \
    X(P_FUEL_Z, "fuel.z")
#define AM_FUEL_STATES(X) \
    X(X_FUEL, "state.fuel")
#define AM_FUEL_VARIABLES(X) \
    X(A_FUEL, "fuel", STAGE_MASS)
#define AM_FUEL_TARGETS(X) \
    X(T_MOMENT_X, "fuel.moment_x", STAGE_MASS) \
    X(T_MOMENT_Y, "fuel.moment_y", STAGE_MASS) \
    X(T_MOMENT_Z, "fuel.moment_z", STAGE_MASS) \
    X(T_FUEL_IXX, "fuel.Ixx", STAGE_MASS) \
    X(T_FUEL_IYY, "fuel.Iyy", STAGE_MASS) \
    X(T_FUEL_IZZ, "fuel.Izz", STAGE_MASS) \
    X(T_FUEL_IXY, "fuel.Ixy", STAGE_MASS) \
    X(T_FUEL_IXZ, "fuel.Ixz", STAGE_MASS) \
    X(T_FUEL_IYZ, "fuel.Iyz", STAGE_MASS)

#define D_PER_FUEL 9 /* first and second moments of the fuel at the start */
#define W_PER_FUEL 0

#endif
