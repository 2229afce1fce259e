/* Engines that turn a propeller, names: group propeller (blades, governor and shaft), group piston
 * and group motor (what turns the shaft; a gas turbine has the group spool).  Every engine has one
 * or none has. */
#ifndef AEROMATCH_PROPELLER_NAMES_H
#define AEROMATCH_PROPELLER_NAMES_H

#define AM_PROPELLER_INPUTS(X) \
    X(U_PROP_COMMAND, "engine*.prop_command") \
    X(U_FEATHER, "engine*.feather") \
    X(U_TORQUE_DRIVE, "engine*.torque_drive") \
    X(U_RPM_DRIVE, "engine*.rpm_drive")
#define AM_PROPELLER_OUTPUTS(X) \
    X(Y_RPM, "engine*.rpm") \
    X(Y_BLADE_ANGLE, "engine*.blade_angle") \
    X(Y_J, "engine*.J") \
    X(Y_TIP_MACH, "engine*.tip_mach") \
    X(Y_CT_PROP, "engine*.CT_prop") \
    X(Y_CP_PROP, "engine*.CP_prop") \
    X(Y_TORQUE, "engine*.torque") \
    X(Y_SHAFT_POWER, "engine*.shaft_power")
#define AM_PROPELLER_PARAMETERS(X) \
    X(P_DIAMETER, "engine*.diameter") \
    X(P_SHAFT_INERTIA, "engine*.inertia") \
    X(P_GEAR_RATIO, "engine*.gear_ratio") \
    X(P_ROTATION, "engine*.rotation") \
    X(P_LOW_PITCH, "engine*.low_pitch") \
    X(P_HIGH_PITCH, "engine*.high_pitch") \
    X(P_FEATHER_PITCH, "engine*.feather_pitch") \
    X(P_PITCH_RATE, "engine*.pitch_rate") \
    X(P_FEATHER_RATE, "engine*.feather_rate") \
    X(P_RPM_LOW, "engine*.rpm_low") \
    X(P_RPM_HIGH, "engine*.rpm_high") \
    X(P_GOVERNOR_GAIN, "engine*.governor_gain") \
    X(P_GOVERNOR_TIME, "engine*.governor_time") \
    X(P_GOVERNED, "engine*.governed") \
    X(P_J_END, "engine*.J_end") \
    X(P_POWER_LIMIT, "engine*.power_limit") \
    X(P_TORQUE_LIMIT, "engine*.torque_limit") \
    X(P_POWER_TIME, "engine*.power_time") \
    X(P_COUPLED, "engine*.coupled")
#define AM_PROPELLER_STATES(X) \
    X(X_RPM, "state.engine*.rpm") \
    X(X_BLADE_ANGLE, "state.engine*.blade_angle") \
    X(X_GOVERNOR, "state.engine*.governor") \
    X(X_SHAFT_POWER, "state.engine*.shaft_power")
#define AM_PROPELLER_VARIABLES(X) \
    X(A_J, "engine*.J", STAGE_ENGINE) \
    X(A_RPM, "engine*.rpm", STAGE_ENGINE) \
    X(A_ENGINE_RPM, "engine*.engine_rpm", STAGE_ENGINE) \
    X(A_BLADE_ANGLE, "engine*.blade_angle", STAGE_ENGINE) \
    X(A_TIP_MACH, "engine*.tip_mach", STAGE_ENGINE) \
    X(A_PROP_COMMAND, "engine*.prop_command", STAGE_ENGINE) \
    X(A_V_EAS, "engine*.V_eas", STAGE_ENGINE) \
    X(A_CT_PROP, "engine*.CT_prop", STAGE_GEAR) \
    X(A_CP_PROP, "engine*.CP_prop", STAGE_GEAR) \
    X(A_TORQUE, "engine*.torque", STAGE_GEAR)
#define AM_PROPELLER_TARGETS(X) \
    X(T_CT_PROP, "engine*.CT_prop", STAGE_ENGINE) \
    X(T_CP_PROP, "engine*.CP_prop", STAGE_ENGINE) \
    X(T_CN_PROP, "engine*.CN_prop", STAGE_ENGINE) \
    X(T_CM_PROP, "engine*.CM_prop", STAGE_ENGINE) \
    X(T_LOW_STOP, "engine*.low_stop", STAGE_ENGINE) \
    X(T_SHAFT_POWER, "engine*.shaft_power", STAGE_ENGINE) \
    X(T_CORRECTED_SHAFT_POWER, "engine*.corrected_shaft_power", STAGE_ENGINE) \
    X(T_SHAFT_BSFC, "engine*.shaft_bsfc", STAGE_ENGINE)

#define AM_PISTON_INPUTS(X) \
    X(U_MIXTURE, "engine*.mixture") \
    X(U_PISTON_CUTOFF, "engine*.cutoff") \
    X(U_PISTON_STARTER, "engine*.starter") \
    X(U_PISTON_FLAMEOUT, "engine*.flameout") \
    X(U_MAP_DRIVE, "engine*.manifold_pressure_drive")
#define AM_PISTON_OUTPUTS(X) \
    X(Y_MANIFOLD_PRESSURE, "engine*.manifold_pressure") \
    X(Y_FUEL_AIR_RATIO, "engine*.fuel_air_ratio") \
    X(Y_PISTON_FUEL_FLOW, "engine*.fuel_flow") \
    X(Y_PISTON_AIR_FLOW, "engine*.air_flow") \
    X(Y_PISTON_BURNING, "engine*.burning")
#define AM_PISTON_PARAMETERS(X) \
    X(P_DISPLACEMENT, "engine*.displacement") \
    X(P_VOLUMETRIC_EFFICIENCY, "engine*.volumetric_efficiency") \
    X(P_COMPRESSION_RATIO, "engine*.compression_ratio") \
    X(P_PUMPING, "engine*.pumping") \
    X(P_RAM_RECOVERY, "engine*.ram_recovery") \
    X(P_INTAKE_IMPEDANCE, "engine*.intake_impedance") \
    X(P_THROTTLE_IMPEDANCE, "engine*.throttle_impedance") \
    X(P_MAP_TIME, "engine*.map_time") \
    X(P_BOOST_RATIO, "engine*.boost_ratio") \
    X(P_BOOST_RPM, "engine*.boost_rpm") \
    X(P_BOOST_LIMIT, "engine*.boost_limit") \
    X(P_FULL_RICH, "engine*.full_rich") \
    X(P_ENRICHMENT, "engine*.enrichment") \
    X(P_CRANK_TORQUE, "engine*.crank_torque") \
    X(P_CRANK_RPM, "engine*.crank_rpm") \
    X(P_FIRE_RPM, "engine*.fire_rpm") \
    X(P_PISTON_FLAME_TIME, "engine*.flame_time")
#define AM_PISTON_STATES(X) \
    X(X_MANIFOLD_PRESSURE, "state.engine*.manifold_pressure") \
    X(X_PISTON_BURNING, "state.engine*.burning")
#define AM_PISTON_VARIABLES(X) \
    X(A_MANIFOLD_PRESSURE, "engine*.manifold_pressure", STAGE_ENGINE) \
    X(A_MIXTURE, "engine*.mixture", STAGE_ENGINE) \
    X(A_FUEL_AIR_RATIO, "engine*.fuel_air_ratio", STAGE_ENGINE) \
    X(A_PISTON_PRESSURE_RATIO, "engine*.pressure_ratio", STAGE_ENGINE) \
    X(A_DENSITY_RATIO, "engine*.density_ratio", STAGE_ENGINE)
#define AM_PISTON_TARGETS(X) \
    X(T_MAP_RATIO, "engine*.map_ratio", STAGE_ENGINE) \
    X(T_POWER, "engine*.power", STAGE_ENGINE) \
    X(T_CORRECTED_POWER, "engine*.corrected_power", STAGE_ENGINE) \
    X(T_FUEL_WORK, "engine*.fuel_work", STAGE_ENGINE) \
    X(T_PISTON_FUEL_FLOW, "engine*.fuel_flow", STAGE_ENGINE) \
    X(T_BSFC, "engine*.bsfc", STAGE_ENGINE) \
    X(T_FRICTION_PRESSURE, "engine*.friction_pressure", STAGE_ENGINE) \
    X(T_FRICTION_POWER, "engine*.friction_power", STAGE_ENGINE) \
    X(T_MOTORING_POWER, "engine*.motoring_power", STAGE_ENGINE)

#define AM_MOTOR_INPUTS(X)
#define AM_MOTOR_OUTPUTS(X) \
    X(Y_CURRENT, "engine*.current") \
    X(Y_BATTERY_VOLTAGE, "engine*.battery_voltage") \
    X(Y_CHARGE, "engine*.charge")
#define AM_MOTOR_PARAMETERS(X) \
    X(P_CHARGE_START, "engine*.charge_start") \
    X(P_SPEED_CONSTANT, "engine*.speed_constant") \
    X(P_MOTOR_RESISTANCE, "engine*.motor_resistance") \
    X(P_IDLE_CURRENT, "engine*.idle_current") \
    X(P_BATTERY_RESISTANCE, "engine*.battery_resistance") \
    X(P_CAPACITY, "engine*.capacity")
#define AM_MOTOR_STATES(X) \
    X(X_CHARGE, "state.engine*.charge")
#define AM_MOTOR_VARIABLES(X) \
    X(A_CHARGE, "engine*.charge", STAGE_ENGINE)
#define AM_MOTOR_TARGETS(X) \
    X(T_OPEN_VOLTAGE, "engine*.open_voltage", STAGE_ENGINE)

#define D_PER_PROPELLER 0
#define D_PER_PISTON 0
#define D_PER_MOTOR 0
/* coefficients, torque of the engine at the shaft of the propeller, its power; turns per second
 * with which the coefficients count */
enum { W_CT_PROP, W_CP_PROP, W_TORQUE, W_SHAFT_POWER, W_TURNS, W_PER_PROPELLER };
enum { W_PISTON_FUEL_FLOW, W_PISTON_AIR_FLOW, W_PER_PISTON };
enum { W_CURRENT, W_BATTERY_VOLTAGE, W_PER_MOTOR };

#endif
