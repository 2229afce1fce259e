/* Fuel, names: what is in the tanks and what it does to mass, centre of gravity and inertia.
 * Group fuel has one state for all fuel.  Groups tanks (all of them), tank (each), feed (from a
 * tank to an engine, item 1.NAME) and transfer (from a tank to a tank, item FROM.TO) have one for
 * each tank.  An aircraft has the first or the others. */
#ifndef AEROMATCH_FUEL_NAMES_H
#define AEROMATCH_FUEL_NAMES_H

/* Of both ways to have fuel; Y: what their codes begin with. */
#define AM_MASS_OUTPUTS(X, Y) \
    X(Y##FUEL, "fuel") \
    X(Y##X_CG_B, "x_cg_b") \
    X(Y##Y_CG_B, "y_cg_b") \
    X(Y##Z_CG_B, "z_cg_b") \
    X(Y##IXX, "Ixx") \
    X(Y##IYY, "Iyy") \
    X(Y##IZZ, "Izz") \
    X(Y##IXY, "Ixy") \
    X(Y##IXZ, "Ixz") \
    X(Y##IYZ, "Iyz")

#define AM_FUEL_INPUTS(X)
#define AM_FUEL_OUTPUTS(X) AM_MASS_OUTPUTS(X, Y_)
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

#define AM_TANKS_INPUTS(X) \
    X(U_CROSSFEED, "crossfeed")
#define AM_TANKS_OUTPUTS(X) AM_MASS_OUTPUTS(X, Y_TANKS_)
#define AM_TANKS_PARAMETERS(X)
#define AM_TANKS_STATES(X)
#define AM_TANKS_VARIABLES(X)
#define AM_TANKS_TARGETS(X)

#define AM_TANK_INPUTS(X) \
    X(U_TANK_CUTOFF, "tank.*.cutoff")
#define AM_TANK_OUTPUTS(X) \
    X(Y_TANK, "tank.*.fuel")
#define AM_TANK_PARAMETERS(X) \
    X(P_TANK_START, "init.tank.*.fuel") \
    X(P_TANK_WEIGHED, "mass.tank.*.fuel") \
    X(P_TANK_CAPACITY, "tank.*.capacity") \
    X(P_TANK_ORDER, "tank.*.order") \
    X(P_TANK_X, "tank.*.x") \
    X(P_TANK_Y, "tank.*.y") \
    X(P_TANK_Z, "tank.*.z")
#define AM_TANK_STATES(X) \
    X(X_TANK, "state.tank.*.fuel")
#define AM_TANK_VARIABLES(X)
#define AM_TANK_TARGETS(X)

#define AM_FEED_INPUTS(X)
#define AM_FEED_OUTPUTS(X)
#define AM_FEED_PARAMETERS(X) \
    X(P_FEED, "feed.engine*")
#define AM_FEED_STATES(X)
#define AM_FEED_VARIABLES(X)
#define AM_FEED_TARGETS(X)

#define AM_TRANSFER_INPUTS(X) \
    X(U_TRANSFER, "transfer.*.pump")
#define AM_TRANSFER_OUTPUTS(X) \
    X(Y_TRANSFER, "transfer.*.flow")
#define AM_TRANSFER_PARAMETERS(X) \
    X(P_TRANSFER_RATE, "transfer.*.rate") \
    X(P_TRANSFER_LEAVE, "transfer.*.leave") \
    X(P_TRANSFER_FILL, "transfer.*.fill") \
    X(P_TRANSFER_BAND, "transfer.*.band")
#define AM_TRANSFER_STATES(X)
#define AM_TRANSFER_VARIABLES(X)
#define AM_TRANSFER_TARGETS(X)

#define D_PER_FUEL 9   /* first and second moments of the fuel at the start */
#define D_PER_TANKS 10 /* those of the fuel that is part of mass.*, and its mass */
#define D_PER_TANK 0
#define D_PER_FEED 0
#define D_PER_TRANSFER 0
#define W_PER_FUEL 0
enum { W_FUEL, W_PER_TANKS }; /* in all tanks */
#define W_PER_TANK 0
#define W_PER_FEED 0
enum { W_TRANSFER, W_PER_TRANSFER }; /* flow [kg s-1] */

#endif
