/* The names of the kernel, once: each list makes an enumeration and the table of names that
 * am_known shows.
 *
 * Names come in groups.  The core and the weather are always there, the others once per item
 * that the aircraft has; a star in a pattern stands for the name of the item.  X(code,
 * "pattern"); variables and targets have a stage behind it: the first stage that may use the
 * variable, the stage that evaluates the target. */
#ifndef AEROMATCH_CATALOGUE_H
#define AEROMATCH_CATALOGUE_H

#include "control_names.h"
#include "device_names.h"
#include "earth_names.h"
#include "engine_names.h"
#include "envelope_names.h"
#include "fuel_names.h"
#include "gear_names.h"
#include "propeller_names.h"
#include "separation_names.h"
#include "weather_names.h"

/* most coefficients in a row that depend on each other: six of them make five steps */
#define LEVELS 5

/* Tables and terms of a stage are evaluated together, in this order.  Tables over a coefficient
 * stand in the stages from STAGE_LATE on, one for each level of dependence.  STAGE_SEPARATION goes
 * before STAGE_AERO; it stands last, so that the stages of blocks without it keep their numbers. */
enum {
    STAGE_MASS,
    STAGE_ENGINE,
    STAGE_GEAR,
    STAGE_AERO,
    STAGE_LATE,
    STAGE_HINGE = STAGE_LATE + LEVELS,
    STAGE_SEPARATION,
    STAGES
};

#define AM_CORE_INPUTS(X) \
    X(U_DELTA_E, "delta_e") \
    X(U_DELTA_A, "delta_a") \
    X(U_DELTA_R, "delta_r") \
    X(U_DELTA_T, "delta_t") \
    X(U_DELTA_TA, "delta_ta") \
    X(U_DELTA_TR, "delta_tr") \
    X(U_DELTA_F, "delta_f") \
    X(U_DELTA_S, "delta_s") \
    X(U_DELTA_D, "delta_d") \
    X(U_GEAR, "gear") \
    X(U_SPEEDBRAKE, "speedbrake") \
    X(U_WIND_N, "wind_n") \
    X(U_WIND_E, "wind_e") \
    X(U_WIND_D, "wind_d")

#define AM_CORE_OUTPUTS(X) \
    X(Y_V, "V") \
    X(Y_V_CAS, "V_cas") \
    X(Y_MACH, "mach") \
    X(Y_QBAR, "qbar") \
    X(Y_ALPHA, "alpha") \
    X(Y_BETA, "beta") \
    X(Y_P, "p") \
    X(Y_Q, "q") \
    X(Y_R, "r") \
    X(Y_PHI, "phi") \
    X(Y_THETA, "theta") \
    X(Y_PSI, "psi") \
    X(Y_AX, "ax") \
    X(Y_AY, "ay") \
    X(Y_AZ, "az") \
    X(Y_NZ, "nz") \
    X(Y_H, "h") \
    X(Y_H_AGL, "h_agl") \
    X(Y_HDOT, "hdot") \
    X(Y_GAMMA, "gamma") \
    X(Y_VN, "vn") \
    X(Y_VE, "ve") \
    X(Y_VD, "vd") \
    X(Y_LAT, "lat") \
    X(Y_LON, "lon") \
    X(Y_U, "u") \
    X(Y_V_BODY, "v") \
    X(Y_W, "w") \
    X(Y_P_DOT, "p_dot") \
    X(Y_Q_DOT, "q_dot") \
    X(Y_R_DOT, "r_dot") \
    X(Y_ALPHA_DOT, "alpha_dot") \
    X(Y_BETA_DOT, "beta_dot") \
    X(Y_CL, "CL") \
    X(Y_CD, "CD") \
    X(Y_CY, "CY") \
    X(Y_ROLL, "Cl") \
    X(Y_PITCH, "Cm") \
    X(Y_YAW, "Cn") \
    X(Y_RHO, "rho") \
    X(Y_P_STATIC, "p_static") \
    X(Y_TEMPERATURE, "temperature") \
    X(Y_H_BARO, "h_baro") \
    X(Y_MASS, "mass") \
    X(Y_APPLIED_DELTA_E, "applied.delta_e") \
    X(Y_APPLIED_DELTA_A, "applied.delta_a") \
    X(Y_APPLIED_DELTA_R, "applied.delta_r") \
    X(Y_APPLIED_DELTA_T, "applied.delta_t") \
    X(Y_APPLIED_DELTA_TA, "applied.delta_ta") \
    X(Y_APPLIED_DELTA_TR, "applied.delta_tr") \
    X(Y_APPLIED_DELTA_F, "applied.delta_f") \
    X(Y_APPLIED_DELTA_S, "applied.delta_s") \
    X(Y_APPLIED_DELTA_D, "applied.delta_d") \
    X(Y_TRIM_ALPHA, "trim.alpha") \
    X(Y_TRIM_BETA, "trim.beta") \
    X(Y_TRIM_DELTA_E, "trim.delta_e") \
    X(Y_TRIM_DELTA_A, "trim.delta_a") \
    X(Y_TRIM_DELTA_R, "trim.delta_r") \
    X(Y_TRIM_THRUST, "trim.thrust") \
    X(Y_TRIM_THROTTLE, "trim.throttle") \
    X(Y_TRIM_U_DOT, "trim.u_dot") \
    X(Y_TRIM_V_DOT, "trim.v_dot") \
    X(Y_TRIM_W_DOT, "trim.w_dot") \
    X(Y_TRIM_P_DOT, "trim.p_dot") \
    X(Y_TRIM_Q_DOT, "trim.q_dot") \
    X(Y_TRIM_R_DOT, "trim.r_dot") \
    X(Y_OUT_OF_RANGE, "out_of_range")

#define AM_CORE_PARAMETERS(X) \
    X(P_V, "init.V") \
    X(P_ALPHA, "init.alpha") \
    X(P_BETA, "init.beta") \
    X(P_GAMMA, "init.gamma") \
    X(P_PHI, "init.phi") \
    X(P_THETA, "init.theta") \
    X(P_PSI, "init.psi") \
    X(P_P, "init.p") \
    X(P_Q, "init.q") \
    X(P_R, "init.r") \
    X(P_H, "init.h") \
    X(P_LAT, "init.lat") \
    X(P_LON, "init.lon") \
    X(P_U_DOT, "init.u_dot") \
    X(P_V_DOT, "init.v_dot") \
    X(P_W_DOT, "init.w_dot") \
    X(P_P_DOT, "init.p_dot") \
    X(P_Q_DOT, "init.q_dot") \
    X(P_R_DOT, "init.r_dot") \
    X(P_PSI_DOT, "init.psi_dot") \
    X(P_PHI_RANGE, "init.phi_range") \
    X(P_MASS, "mass.mass") \
    X(P_X_CG_B, "mass.x_cg_b") \
    X(P_Y_CG_B, "mass.y_cg_b") \
    X(P_Z_CG_B, "mass.z_cg_b") \
    X(P_IXX, "mass.Ixx") \
    X(P_IYY, "mass.Iyy") \
    X(P_IZZ, "mass.Izz") \
    X(P_IXY, "mass.Ixy") \
    X(P_IXZ, "mass.Ixz") \
    X(P_IYZ, "mass.Iyz") \
    X(P_DELTA_T, "env.delta_T") \
    X(P_QNH, "env.qnh") \
    X(P_RUNWAY, "env.runway_elevation") \
    X(P_BIAS_DELTA_E, "bias.delta_e") \
    X(P_BIAS_DELTA_A, "bias.delta_a") \
    X(P_BIAS_DELTA_R, "bias.delta_r") \
    X(P_BIAS_DELTA_T, "bias.delta_t") \
    X(P_BIAS_DELTA_TA, "bias.delta_ta") \
    X(P_BIAS_DELTA_TR, "bias.delta_tr") \
    X(P_BIAS_DELTA_F, "bias.delta_f") \
    X(P_BIAS_DELTA_S, "bias.delta_s") \
    X(P_BIAS_DELTA_D, "bias.delta_d") \
    X(P_BIAS_THRUST, "bias.thrust") \
    X(P_BIAS_THROTTLE, "bias.throttle") \
    X(P_BIAS_CL, "bias.CL") \
    X(P_BIAS_CD, "bias.CD") \
    X(P_BIAS_CY, "bias.CY") \
    X(P_BIAS_ROLL, "bias.Cl") \
    X(P_BIAS_PITCH, "bias.Cm") \
    X(P_BIAS_YAW, "bias.Cn") \
    X(P_EARTH, "mode.earth") \
    X(P_ENGINE, "mode.engine") \
    X(P_CONTROLS, "mode.controls") \
    X(P_RATES, "mode.rates") \
    X(P_TRIM, "mode.trim") \
    X(P_STEP, "mode.step")

/* Position and velocity in Earth axes, quaternion Earth to body, body rates relative to inertial
 * space. */
#define AM_CORE_STATES(X) \
    X(X_X, "state.x") \
    X(X_Y, "state.y") \
    X(X_Z, "state.z") \
    X(X_VX, "state.vx") \
    X(X_VY, "state.vy") \
    X(X_VZ, "state.vz") \
    X(X_Q0, "state.q0") \
    X(X_Q1, "state.q1") \
    X(X_Q2, "state.q2") \
    X(X_Q3, "state.q3") \
    X(X_P, "state.p") \
    X(X_Q, "state.q") \
    X(X_R, "state.r")

#define AM_CORE_VARIABLES(X) \
    X(A_ALPHA, "alpha", STAGE_ENGINE) \
    X(A_BETA, "beta", STAGE_ENGINE) \
    X(A_MACH, "mach", STAGE_ENGINE) \
    X(A_H, "h", STAGE_ENGINE) \
    X(A_H_AGL, "h_agl", STAGE_ENGINE) \
    X(A_V, "V", STAGE_ENGINE) \
    X(A_QBAR, "qbar", STAGE_ENGINE) \
    X(A_PHAT, "phat", STAGE_ENGINE) \
    X(A_QHAT, "qhat", STAGE_ENGINE) \
    X(A_RHAT, "rhat", STAGE_ENGINE) \
    X(A_P, "p", STAGE_ENGINE) \
    X(A_Q, "q", STAGE_ENGINE) \
    X(A_R, "r", STAGE_ENGINE) \
    X(A_ALPHADOTHAT, "alphadothat", STAGE_AERO) \
    X(A_BETADOTHAT, "betadothat", STAGE_AERO) \
    X(A_DNZ, "dnz", STAGE_AERO) \
    X(A_DELTA_E, "delta_e", STAGE_ENGINE) \
    X(A_DELTA_A, "delta_a", STAGE_ENGINE) \
    X(A_DELTA_R, "delta_r", STAGE_ENGINE) \
    X(A_DELTA_T, "delta_t", STAGE_ENGINE) \
    X(A_DELTA_TA, "delta_ta", STAGE_ENGINE) \
    X(A_DELTA_TR, "delta_tr", STAGE_ENGINE) \
    X(A_DELTA_F, "delta_f", STAGE_ENGINE) \
    X(A_DELTA_S, "delta_s", STAGE_ENGINE) \
    X(A_DELTA_D, "delta_d", STAGE_ENGINE) \
    X(A_GEAR, "gear", STAGE_ENGINE) \
    X(A_SPEEDBRAKE, "speedbrake", STAGE_ENGINE) \
    X(A_X_CG, "x_cg", STAGE_ENGINE) \
    X(A_PHI, "phi", STAGE_ENGINE) \
    X(A_CT, "CT", STAGE_GEAR) \
    X(A_CL, "CL", STAGE_LATE) \
    X(A_CD, "CD", STAGE_LATE) \
    X(A_CY, "CY", STAGE_LATE) \
    X(A_ROLL, "Cl", STAGE_LATE) \
    X(A_PITCH, "Cm", STAGE_LATE) \
    X(A_YAW, "Cn", STAGE_LATE) \
    X(A_CX, "CX", STAGE_LATE) \
    X(A_CZ, "CZ", STAGE_LATE)

/* CL CD CY Cl Cm Cn; with body force axes the first two are CX CZ. */
#define AM_CORE_TARGETS(X) \
    X(T_CL, "CL", STAGE_AERO) \
    X(T_CD, "CD", STAGE_AERO) \
    X(T_CY, "CY", STAGE_AERO) \
    X(T_ROLL, "Cl", STAGE_AERO) \
    X(T_PITCH, "Cm", STAGE_AERO) \
    X(T_YAW, "Cn", STAGE_AERO) \
    X(T_HINGE_E, "Ch_e", STAGE_HINGE) \
    X(T_HINGE_A, "Ch_a", STAGE_HINGE) \
    X(T_HINGE_R, "Ch_r", STAGE_HINGE)

#define D_PER_CORE 0
#define W_PER_CORE 0

/* G(group, lists, "word before the colon in am_known") in the order of a block */
#define AM_GROUP_LIST(G) \
    G(G_CORE, CORE, "") \
    G(G_WEATHER, WEATHER, "weather") \
    G(G_ENGINE, ENGINE, "engine") \
    G(G_SPOOL, SPOOL, "spool") \
    G(G_PROPELLER, PROPELLER, "propeller") \
    G(G_PISTON, PISTON, "piston") \
    G(G_MOTOR, MOTOR, "motor") \
    G(G_FUEL, FUEL, "fuel") \
    G(G_GEAR, GEAR, "gear") \
    G(G_CONTACT, CONTACT, "contact") \
    G(G_CIRCUIT, CIRCUIT, "circuit") \
    G(G_DEVICE, DEVICE, "device") \
    G(G_EARTH, EARTH, "earth") \
    G(G_SEPARATION, SEPARATION, "separation") \
    G(G_ENVELOPE, ENVELOPE, "envelope") \
    G(G_TANKS, TANKS, "tanks") \
    G(G_TANK, TANK, "tank") \
    G(G_FEED, FEED, "feed") \
    G(G_TRANSFER, TRANSFER, "transfer")

#define AM_GROUP_ENUM(group, lists, word) group,
enum { AM_GROUP_LIST(AM_GROUP_ENUM) GROUPS };
#undef AM_GROUP_ENUM

#define AM_ENUM(code, name) code,
#define AM_ENUM_STAGED(code, name, stage) code,
/* codes count from 0 within one item of a group; variable 0 of the core is the constant 1 that
 * stands for an absent factor */
enum { A_ONE, AM_CORE_VARIABLES(AM_ENUM_STAGED) A_PER_CORE };
#define AM_CODES(GROUP)                                              \
    enum { AM_##GROUP##_INPUTS(AM_ENUM) U_PER_##GROUP };             \
    enum { AM_##GROUP##_OUTPUTS(AM_ENUM) Y_PER_##GROUP };            \
    enum { AM_##GROUP##_PARAMETERS(AM_ENUM) P_PER_##GROUP };         \
    enum { AM_##GROUP##_STATES(AM_ENUM) X_PER_##GROUP };             \
    enum { AM_##GROUP##_TARGETS(AM_ENUM_STAGED) T_PER_##GROUP };
#define AM_ITEM_CODES(GROUP) \
    AM_CODES(GROUP) \
    enum { AM_##GROUP##_VARIABLES(AM_ENUM_STAGED) A_PER_##GROUP };
AM_CODES(CORE)
AM_ITEM_CODES(WEATHER)
AM_ITEM_CODES(ENGINE)
AM_ITEM_CODES(SPOOL)
AM_ITEM_CODES(PROPELLER)
AM_ITEM_CODES(PISTON)
AM_ITEM_CODES(MOTOR)
AM_ITEM_CODES(FUEL)
AM_ITEM_CODES(GEAR)
AM_ITEM_CODES(CONTACT)
AM_ITEM_CODES(CIRCUIT)
AM_ITEM_CODES(DEVICE)
AM_ITEM_CODES(EARTH)
AM_ITEM_CODES(SEPARATION)
AM_ITEM_CODES(ENVELOPE)
AM_ITEM_CODES(TANKS)
AM_ITEM_CODES(TANK)
AM_ITEM_CODES(FEED)
AM_ITEM_CODES(TRANSFER)
#undef AM_ITEM_CODES
#undef AM_CODES
#undef AM_ENUM_STAGED
#undef AM_ENUM

#endif
