/* Landing gear: names of the groups gear (one per aircraft) and contact (one per wheel or skid),
 * calls of the core.
 *
 * Signs: wheel axes lie in the ground plane, x forward along the rolling direction, y right; Fz
 * is the load, positive when the ground pushes up.  Angles of the nose wheel are positive when
 * it points right. */
#ifndef AEROMATCH_GEAR_NAMES_H
#define AEROMATCH_GEAR_NAMES_H

#define AM_GEAR_INPUTS(X) \
    X(U_DELTA_NW, "delta_nw") \
    X(U_BRAKE_LEFT, "brake_left") \
    X(U_BRAKE_RIGHT, "brake_right")
#define AM_GEAR_OUTPUTS(X) \
    X(Y_GEAR_FX, "gear.Fx") \
    X(Y_GEAR_FY, "gear.Fy") \
    X(Y_GEAR_FZ, "gear.Fz") \
    X(Y_GEAR_MX, "gear.Mx") \
    X(Y_GEAR_MY, "gear.My") \
    X(Y_GEAR_MZ, "gear.Mz") \
    X(Y_GEAR_STEERING, "gear.steering") \
    X(Y_GEAR_STEERING_MOMENT, "gear.steering_moment")
#define AM_GEAR_PARAMETERS(X) \
    X(P_RUNWAY_CONDITION, "runway.condition") \
    X(P_MU_DRY, "runway.mu_dry") \
    X(P_MU_WET_0, "runway.mu_wet_0") \
    X(P_MU_WET_1, "runway.mu_wet_1") \
    X(P_MU_WET_2, "runway.mu_wet_2") \
    X(P_MU_WET_3, "runway.mu_wet_3") \
    X(P_MU_ICY, "runway.mu_icy") \
    X(P_SKID_RATIO, "runway.skid_ratio") \
    X(P_ANTISKID, "gear.antiskid") \
    X(P_STEERING_ORDER, "steering.order") \
    X(P_STEERING_LIMIT, "steering.limit") \
    X(P_STEERING_STIFFNESS, "steering.stiffness") \
    X(P_STEERING_DAMPING, "steering.damping") \
    X(P_STEERING_INERTIA, "steering.inertia") \
    X(P_STEERING_TRAIL, "steering.trail") \
    X(P_STEERING_SCRUB, "steering.scrub") \
    X(P_STEERING_RUDDER, "steering.rudder") \
    X(P_ARM_STIFFNESS, "steering.arm_stiffness") \
    X(P_ARM_DAMPING, "steering.arm_damping") \
    X(P_ARM_INERTIA, "steering.arm_inertia")
#define AM_GEAR_STATES(X) \
    X(X_STEERING, "state.gear.steering") \
    X(X_STEERING_RATE, "state.gear.steering_rate") \
    X(X_ARM, "state.gear.steering_arm") \
    X(X_ARM_RATE, "state.gear.steering_arm_rate") \
    X(X_TWIST, "state.gear.steering_twist")
#define AM_GEAR_VARIABLES(X)
#define AM_GEAR_TARGETS(X)

#define AM_CONTACT_INPUTS(X)
#define AM_CONTACT_OUTPUTS(X) \
    X(Y_CONTACT_WOW, "wow_*") \
    X(Y_CONTACT_COMPRESSION, "gear.*.compression") \
    X(Y_CONTACT_TYRE, "gear.*.tyre_deflection") \
    X(Y_CONTACT_FX, "gear.*.Fx") \
    X(Y_CONTACT_FY, "gear.*.Fy") \
    X(Y_CONTACT_FZ, "gear.*.Fz") \
    X(Y_CONTACT_SLIP, "gear.*.slip_angle") \
    X(Y_CONTACT_BRAKE, "gear.*.brake_force")
#define AM_CONTACT_PARAMETERS(X) \
    X(P_CONTACT_X, "gear.*.x") \
    X(P_CONTACT_Y, "gear.*.y") \
    X(P_CONTACT_Z, "gear.*.z") \
    X(P_CONTACT_RADIUS, "gear.*.radius") \
    X(P_CONTACT_STIFFNESS, "gear.*.stiffness") \
    X(P_CONTACT_PRELOAD, "gear.*.preload") \
    X(P_CONTACT_STROKE, "gear.*.stroke") \
    X(P_CONTACT_DAMPING, "gear.*.damping") \
    X(P_CONTACT_DAMPING_EXT, "gear.*.damping_ext") \
    X(P_CONTACT_ORIFICE, "gear.*.orifice") \
    X(P_CONTACT_ORIFICE_EXT, "gear.*.orifice_ext") \
    X(P_CONTACT_TYRE, "gear.*.tyre_stiffness") \
    X(P_CONTACT_SIDE, "gear.*.side_stiffness") \
    X(P_CONTACT_CORNERING, "gear.*.cornering_stiffness") \
    X(P_CONTACT_CORNERING_LOAD, "gear.*.cornering_load") \
    X(P_CONTACT_LOSS, "gear.*.loss") \
    X(P_CONTACT_ROLLING, "gear.*.rolling") \
    X(P_CONTACT_BRAKE, "gear.*.brake") \
    X(P_CONTACT_BRAKE_FRICTION, "gear.*.brake_friction") \
    X(P_CONTACT_STEERING, "gear.*.steering") \
    X(P_CONTACT_FRICTION, "gear.*.friction") \
    X(P_CONTACT_RETRACTS, "gear.*.retracts")
#define AM_CONTACT_STATES(X) \
    X(X_CONTACT_STROKE, "state.gear.*.stroke") \
    X(X_CONTACT_LONG, "state.gear.*.tyre_x") \
    X(X_CONTACT_SIDE, "state.gear.*.tyre_y")
#define AM_CONTACT_VARIABLES(X) \
    X(A_CONTACT_COMPRESSION, "gear.*.compression", STAGE_GEAR)
#define AM_CONTACT_TARGETS(X) \
    X(T_CONTACT_STRUT, "gear.*.strut", STAGE_GEAR)

/* What the last derivative found: the outputs of the group. */
#define W_PER_GEAR 8
#define W_PER_CONTACT 8
#define D_PER_GEAR 0
#define D_PER_CONTACT 0

#endif
