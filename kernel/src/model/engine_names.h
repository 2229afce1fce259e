/* Engines, names: group engine (thrust with a lag, every engine) and group spool (a full deck,
 * every engine or none). */
#ifndef AEROMATCH_ENGINE_NAMES_H
#define AEROMATCH_ENGINE_NAMES_H

#include "delay.h"

#define AM_ENGINE_INPUTS(X) \
    X(U_THROTTLE, "engine*.throttle") \
    X(U_THRUST_DRIVE, "engine*.thrust_drive")
#define AM_ENGINE_OUTPUTS(X) \
    X(Y_THRUST, "engine*.thrust")
#define AM_ENGINE_PARAMETERS(X) \
    X(P_TIME_CONSTANT, "engine*.time_constant") \
    X(P_ANGULAR_MOMENTUM, "engine*.angular_momentum") \
    X(P_ENGINE_X, "engine*.x") \
    X(P_ENGINE_Y, "engine*.y") \
    X(P_ENGINE_Z, "engine*.z") \
    X(P_DIRECTION_X, "engine*.direction_x") \
    X(P_DIRECTION_Y, "engine*.direction_y") \
    X(P_DIRECTION_Z, "engine*.direction_z")
#define AM_ENGINE_STATES(X) \
    X(X_LAGGED, "state.engine*.thrust")
#define AM_ENGINE_VARIABLES(X) \
    X(A_THROTTLE, "engine*.throttle", STAGE_ENGINE) \
    X(A_THRUST, "engine*.thrust", STAGE_GEAR)
#define AM_ENGINE_TARGETS(X) \
    X(T_THRUST, "engine*.thrust", STAGE_ENGINE)

/* Where both spools have a name, that of n2 follows that of n1: engine.c counts spools 0 and 1. */
#define AM_SPOOL_INPUTS(X) \
    X(U_CUTOFF, "engine*.cutoff") \
    X(U_STARTER, "engine*.starter") \
    X(U_IGNITION, "engine*.ignition") \
    X(U_FLAMEOUT, "engine*.flameout") \
    X(U_N1_DRIVE, "engine*.n1_drive")
#define AM_SPOOL_OUTPUTS(X) \
    X(Y_N1, "engine*.n1") \
    X(Y_N2, "engine*.n2") \
    X(Y_ITT, "engine*.itt") \
    X(Y_FUEL_FLOW, "engine*.fuel_flow") \
    X(Y_GROSS_THRUST, "engine*.gross_thrust") \
    X(Y_RAM_DRAG, "engine*.ram_drag") \
    X(Y_AIR_FLOW, "engine*.air_flow") \
    X(Y_PLA, "engine*.pla") \
    X(Y_BURNING, "engine*.burning")
#define AM_SPOOL_PARAMETERS(X) \
    X(P_LEVER_DELAY, "engine*.lever_delay") \
    X(P_PLA_IDLE, "engine*.pla_idle") \
    X(P_PLA_FULL, "engine*.pla_full") \
    X(P_N1_RUNDOWN, "engine*.n1_rundown") \
    X(P_N2_RUNDOWN, "engine*.n2_rundown") \
    X(P_STARTER_SPEED, "engine*.starter_speed") \
    X(P_STARTER_TIME, "engine*.starter_time") \
    X(P_LIGHT_SPEED, "engine*.light_speed") \
    X(P_SUSTAIN_SPEED, "engine*.sustain_speed") \
    X(P_FLAME_TIME, "engine*.flame_time") \
    X(P_ITT_TIME, "engine*.itt_time") \
    X(P_N1_RATED, "engine*.n1_rated") \
    X(P_N2_RATED, "engine*.n2_rated") \
    X(P_N1_INERTIA, "engine*.n1_inertia") \
    X(P_N2_INERTIA, "engine*.n2_inertia") \
    X(P_INLET_X, "engine*.x_inlet") \
    X(P_INLET_Y, "engine*.y_inlet") \
    X(P_INLET_Z, "engine*.z_inlet")
#define AM_SPOOL_STATES(X) \
    X(X_N1, "state.engine*.n1") \
    X(X_N2, "state.engine*.n2") \
    X(X_BURNING, "state.engine*.burning") \
    X(X_ITT, "state.engine*.itt")
#define AM_SPOOL_VARIABLES(X) \
    X(A_PLA, "engine*.pla", STAGE_ENGINE) \
    X(A_N1, "engine*.n1", STAGE_ENGINE) \
    X(A_N2, "engine*.n2", STAGE_ENGINE) \
    X(A_CORRECTED_N1, "engine*.corrected_n1", STAGE_ENGINE) \
    X(A_CORRECTED_N2, "engine*.corrected_n2", STAGE_ENGINE) \
    X(A_TEMPERATURE_RATIO, "engine*.temperature_ratio", STAGE_ENGINE) \
    X(A_PRESSURE_RATIO, "engine*.pressure_ratio", STAGE_ENGINE)
#define AM_SPOOL_TARGETS(X) \
    X(T_CORRECTED_THRUST, "engine*.corrected_thrust", STAGE_ENGINE) \
    X(T_WINDMILL_THRUST, "engine*.windmill_thrust", STAGE_ENGINE) \
    X(T_AIR_FLOW, "engine*.air_flow", STAGE_ENGINE) \
    X(T_CORRECTED_AIR_FLOW, "engine*.corrected_air_flow", STAGE_ENGINE) \
    X(T_FUEL_FLOW, "engine*.fuel_flow", STAGE_ENGINE) \
    X(T_CORRECTED_FUEL_FLOW, "engine*.corrected_fuel_flow", STAGE_ENGINE) \
    X(T_ITT, "engine*.itt", STAGE_ENGINE) \
    X(T_CORRECTED_ITT, "engine*.corrected_itt", STAGE_ENGINE) \
    X(T_N1_COMMAND, "engine*.n1_command", STAGE_ENGINE) \
    X(T_N2_COMMAND, "engine*.n2_command", STAGE_ENGINE) \
    X(T_CORRECTED_N1_COMMAND, "engine*.corrected_n1_command", STAGE_ENGINE) \
    X(T_CORRECTED_N2_COMMAND, "engine*.corrected_n2_command", STAGE_ENGINE) \
    X(T_N1_UP_TIME, "engine*.n1_up_time", STAGE_ENGINE) \
    X(T_N2_UP_TIME, "engine*.n2_up_time", STAGE_ENGINE) \
    X(T_N1_DOWN_TIME, "engine*.n1_down_time", STAGE_ENGINE) \
    X(T_N2_DOWN_TIME, "engine*.n2_down_time", STAGE_ENGINE) \
    X(T_N1_UP_LIMIT, "engine*.n1_up_limit", STAGE_ENGINE) \
    X(T_N2_UP_LIMIT, "engine*.n2_up_limit", STAGE_ENGINE) \
    X(T_N1_DOWN_LIMIT, "engine*.n1_down_limit", STAGE_ENGINE) \
    X(T_N2_DOWN_LIMIT, "engine*.n2_down_limit", STAGE_ENGINE) \
    X(T_CORRECTED_N1_WINDMILL, "engine*.corrected_n1_windmill", STAGE_ENGINE) \
    X(T_CORRECTED_N2_WINDMILL, "engine*.corrected_n2_windmill", STAGE_ENGINE) \
    X(T_CORRECTED_N2_DRIVEN, "engine*.corrected_n2_driven", STAGE_ENGINE) \
    X(T_BURN_MARGIN, "engine*.burn_margin", STAGE_ENGINE) \
    X(T_LIGHT_MARGIN, "engine*.light_margin", STAGE_ENGINE)

#define D_PER_ENGINE 0
#define W_PER_ENGINE 0
#define D_PER_SPOOL DELAY_DOUBLES /* the lever */
enum { W_ITT, W_FUEL_FLOW, W_GROSS_THRUST, W_RAM_DRAG, W_AIR_FLOW, W_PER_SPOOL };

#endif
