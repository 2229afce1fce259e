/* Flow separation, names: a separation point per wing half, what it does to the tables, and the
 * buffet. */
#ifndef AEROMATCH_SEPARATION_NAMES_H
#define AEROMATCH_SEPARATION_NAMES_H

#define AM_SEPARATION_INPUTS(X)
#define AM_SEPARATION_OUTPUTS(X) \
    X(Y_SEPARATION_LEFT, "stall.X_left") \
    X(Y_SEPARATION_RIGHT, "stall.X_right") \
    X(Y_BUFFET_RMS, "stall.buffet_rms") \
    X(Y_BUFFET_FREQUENCY, "stall.buffet_frequency") \
    X(Y_BUFFET_DAMPING, "stall.buffet_damping")
#define AM_SEPARATION_PARAMETERS(X) \
    X(P_STATION, "stall.station")
#define AM_SEPARATION_STATES(X) \
    X(X_SEPARATION_LEFT, "state.X_left") \
    X(X_SEPARATION_RIGHT, "state.X_right")
#define AM_SEPARATION_VARIABLES(X) \
    X(A_SEPARATION_LEFT, "X_left", STAGE_AERO) \
    X(A_SEPARATION_RIGHT, "X_right", STAGE_AERO) \
    X(A_SEPARATION, "X", STAGE_AERO) \
    X(A_SEPARATION_DIFF, "X_diff", STAGE_AERO) \
    X(A_SEPARATION_LIFT, "X_lift", STAGE_AERO) \
    X(A_SEPARATION_LIFT_DIFF, "X_lift_diff", STAGE_AERO)
#define AM_SEPARATION_TARGETS(X) \
    X(T_A1, "stall.a1", STAGE_SEPARATION) \
    X(T_ALPHA_STAR, "stall.alpha_star", STAGE_SEPARATION) \
    X(T_ASYMMETRY, "stall.asymmetry", STAGE_SEPARATION) \
    X(T_TAU1, "stall.tau1", STAGE_SEPARATION) \
    X(T_TAU2, "stall.tau2", STAGE_SEPARATION) \
    X(T_BUFFET_RMS, "stall.buffet_rms", STAGE_SEPARATION) \
    X(T_BUFFET_FREQUENCY, "stall.buffet_frequency", STAGE_SEPARATION) \
    X(T_BUFFET_DAMPING, "stall.buffet_damping", STAGE_SEPARATION)

#define D_PER_SEPARATION 0
#define W_PER_SEPARATION 0

#endif
