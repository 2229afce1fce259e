/* The fixed names of the kernel, once: each list makes an enumeration and the table of names that am_known shows. */
#ifndef AEROMATCH_CATALOGUE_H
#define AEROMATCH_CATALOGUE_H

#define AM_INPUT_LIST(X) \
    X(U_DELTA_E, "delta_e") X(U_DELTA_A, "delta_a") X(U_DELTA_R, "delta_r") X(U_DELTA_T, "delta_t") \
    X(U_DELTA_TA, "delta_ta") X(U_DELTA_TR, "delta_tr") X(U_DELTA_F, "delta_f") X(U_GEAR, "gear") \
    X(U_SPEEDBRAKE, "speedbrake") X(U_WIND_N, "wind_n") X(U_WIND_E, "wind_e") X(U_WIND_D, "wind_d")
#define AM_ENGINE_INPUT_LIST(X) X(U_THROTTLE, "engine*.throttle") X(U_THRUST_DRIVE, "engine*.thrust_drive")

#define AM_OUTPUT_LIST(X) \
    X(Y_V, "V") X(Y_V_CAS, "V_cas") X(Y_MACH, "mach") X(Y_QBAR, "qbar") X(Y_ALPHA, "alpha") X(Y_BETA, "beta") \
    X(Y_P, "p") X(Y_Q, "q") X(Y_R, "r") X(Y_PHI, "phi") X(Y_THETA, "theta") X(Y_PSI, "psi") \
    X(Y_AX, "ax") X(Y_AY, "ay") X(Y_AZ, "az") X(Y_NZ, "nz") X(Y_H, "h") X(Y_H_AGL, "h_agl") X(Y_HDOT, "hdot") \
    X(Y_GAMMA, "gamma") X(Y_VN, "vn") X(Y_VE, "ve") X(Y_VD, "vd") X(Y_LAT, "lat") X(Y_LON, "lon") \
    X(Y_U, "u") X(Y_V_BODY, "v") X(Y_W, "w") X(Y_P_DOT, "p_dot") X(Y_Q_DOT, "q_dot") X(Y_R_DOT, "r_dot") \
    X(Y_ALPHA_DOT, "alpha_dot") X(Y_BETA_DOT, "beta_dot") \
    X(Y_CL, "CL") X(Y_CD, "CD") X(Y_CY, "CY") X(Y_ROLL, "Cl") X(Y_PITCH, "Cm") X(Y_YAW, "Cn") \
    X(Y_RHO, "rho") X(Y_P_STATIC, "p_static") X(Y_TEMPERATURE, "temperature") \
    X(Y_APPLIED_DELTA_E, "applied.delta_e") X(Y_APPLIED_DELTA_A, "applied.delta_a") X(Y_APPLIED_DELTA_R, "applied.delta_r") \
    X(Y_APPLIED_DELTA_T, "applied.delta_t") X(Y_APPLIED_DELTA_TA, "applied.delta_ta") X(Y_APPLIED_DELTA_TR, "applied.delta_tr") \
    X(Y_APPLIED_DELTA_F, "applied.delta_f") \
    X(Y_TRIM_ALPHA, "trim.alpha") X(Y_TRIM_BETA, "trim.beta") X(Y_TRIM_DELTA_E, "trim.delta_e") \
    X(Y_TRIM_DELTA_A, "trim.delta_a") X(Y_TRIM_DELTA_R, "trim.delta_r") X(Y_TRIM_THRUST, "trim.thrust") \
    X(Y_TRIM_THROTTLE, "trim.throttle") X(Y_TRIM_U_DOT, "trim.u_dot") X(Y_TRIM_V_DOT, "trim.v_dot") X(Y_TRIM_W_DOT, "trim.w_dot") \
    X(Y_TRIM_P_DOT, "trim.p_dot") X(Y_TRIM_Q_DOT, "trim.q_dot") X(Y_TRIM_R_DOT, "trim.r_dot") \
    X(Y_OUT_OF_RANGE, "out_of_range")
#define AM_ENGINE_OUTPUT_LIST(X) X(Y_THRUST, "engine*.thrust")

#define AM_PARAMETER_LIST(X) \
    X(P_V, "init.V") X(P_ALPHA, "init.alpha") X(P_BETA, "init.beta") X(P_GAMMA, "init.gamma") X(P_PHI, "init.phi") \
    X(P_THETA, "init.theta") X(P_PSI, "init.psi") X(P_P, "init.p") X(P_Q, "init.q") X(P_R, "init.r") X(P_H, "init.h") \
    X(P_LAT, "init.lat") X(P_LON, "init.lon") X(P_U_DOT, "init.u_dot") X(P_V_DOT, "init.v_dot") X(P_W_DOT, "init.w_dot") \
    X(P_P_DOT, "init.p_dot") X(P_Q_DOT, "init.q_dot") X(P_R_DOT, "init.r_dot") \
    X(P_MASS, "mass.mass") X(P_X_CG_B, "mass.x_cg_b") X(P_Y_CG_B, "mass.y_cg_b") X(P_Z_CG_B, "mass.z_cg_b") \
    X(P_IXX, "mass.Ixx") X(P_IYY, "mass.Iyy") X(P_IZZ, "mass.Izz") X(P_IXY, "mass.Ixy") X(P_IXZ, "mass.Ixz") X(P_IYZ, "mass.Iyz") \
    X(P_DELTA_T, "env.delta_T") X(P_QNH, "env.qnh") X(P_RUNWAY, "env.runway_elevation") \
    X(P_BIAS_DELTA_E, "bias.delta_e") X(P_BIAS_DELTA_A, "bias.delta_a") X(P_BIAS_DELTA_R, "bias.delta_r") \
    X(P_BIAS_DELTA_T, "bias.delta_t") X(P_BIAS_DELTA_TA, "bias.delta_ta") X(P_BIAS_DELTA_TR, "bias.delta_tr") \
    X(P_BIAS_DELTA_F, "bias.delta_f") X(P_BIAS_THRUST, "bias.thrust") X(P_BIAS_THROTTLE, "bias.throttle") \
    X(P_BIAS_CL, "bias.CL") X(P_BIAS_CD, "bias.CD") X(P_BIAS_CY, "bias.CY") \
    X(P_BIAS_ROLL, "bias.Cl") X(P_BIAS_PITCH, "bias.Cm") X(P_BIAS_YAW, "bias.Cn") \
    X(P_EARTH, "mode.earth") X(P_ENGINE, "mode.engine") X(P_TRIM, "mode.trim") X(P_STEP, "mode.step")
#define AM_ENGINE_PARAMETER_LIST(X) \
    X(P_TIME_CONSTANT, "engine*.time_constant") X(P_ANGULAR_MOMENTUM, "engine*.angular_momentum")

/* Slot 0 of the variables is the constant 1 that stands for an absent factor. */
#define AM_VARIABLE_LIST(X) \
    X(A_ALPHA, "alpha") X(A_BETA, "beta") X(A_MACH, "mach") X(A_H, "h") X(A_H_AGL, "h_agl") X(A_V, "V") X(A_QBAR, "qbar") \
    X(A_PHAT, "phat") X(A_QHAT, "qhat") X(A_RHAT, "rhat") X(A_P, "p") X(A_Q, "q") X(A_R, "r") \
    X(A_ALPHADOTHAT, "alphadothat") X(A_BETADOTHAT, "betadothat") X(A_DNZ, "dnz") \
    X(A_DELTA_E, "delta_e") X(A_DELTA_A, "delta_a") X(A_DELTA_R, "delta_r") X(A_DELTA_T, "delta_t") \
    X(A_DELTA_TA, "delta_ta") X(A_DELTA_TR, "delta_tr") X(A_DELTA_F, "delta_f") X(A_GEAR, "gear") X(A_SPEEDBRAKE, "speedbrake") \
    X(A_X_CG, "x_cg") X(A_PHI, "phi")
#define AM_ENGINE_VARIABLE_LIST(X) X(A_THROTTLE, "engine*.throttle") X(A_THRUST, "engine*.thrust")

#define AM_ENUM(code, name) code,
enum { AM_INPUT_LIST(AM_ENUM) U_FIXED };
enum { AM_OUTPUT_LIST(AM_ENUM) Y_FIXED };
enum { AM_PARAMETER_LIST(AM_ENUM) P_FIXED };
enum { A_ONE, AM_VARIABLE_LIST(AM_ENUM) A_FIXED };
/* the engine lists count from 0 within one engine */
enum { AM_ENGINE_INPUT_LIST(AM_ENUM) U_PER_ENGINE };
enum { AM_ENGINE_OUTPUT_LIST(AM_ENUM) Y_PER_ENGINE };
enum { AM_ENGINE_PARAMETER_LIST(AM_ENUM) P_PER_ENGINE };
enum { AM_ENGINE_VARIABLE_LIST(AM_ENUM) A_PER_ENGINE };
#undef AM_ENUM

#endif
