#ifndef AEROMATCH_ENGINE_H
#define AEROMATCH_ENGINE_H
#define AM_ENGINE_INPUTS(X) X(U_THROTTLE, "engine*.throttle") X(U_THRUST_DRIVE, "engine*.thrust_drive")
#define AM_ENGINE_OUTPUTS(X) X(Y_THRUST, "engine*.thrust")
#define AM_ENGINE_PARAMETERS(X) \
    X(P_TIME_CONSTANT, "engine*.time_constant") X(P_ANGULAR_MOMENTUM, "engine*.angular_momentum") \
    X(P_ENGINE_X, "engine*.x") X(P_ENGINE_Y, "engine*.y") X(P_ENGINE_Z, "engine*.z") \
    X(P_DIRECTION_X, "engine*.direction_x") X(P_DIRECTION_Y, "engine*.direction_y") X(P_DIRECTION_Z, "engine*.direction_z")
#define AM_ENGINE_STATES(X) X(X_LAGGED, "state.engine*.thrust")
#define AM_ENGINE_VARIABLES(X) X(A_THROTTLE, "engine*.throttle", STAGE_ENGINE) X(A_THRUST, "engine*.thrust", STAGE_GEAR)
#define AM_ENGINE_TARGETS(X) X(T_THRUST, "engine*.thrust", STAGE_ENGINE)
#define D_PER_ENGINE 0
#define W_PER_ENGINE 0
#define AM_SPOOL_INPUTS(X)
#define AM_SPOOL_OUTPUTS(X)
#define AM_SPOOL_PARAMETERS(X)
#define AM_SPOOL_STATES(X)
#define AM_SPOOL_VARIABLES(X)
#define AM_SPOOL_TARGETS(X)
#define D_PER_SPOOL 0
#define W_PER_SPOOL 0
#endif
