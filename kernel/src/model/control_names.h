/* Control circuits: names of the group circuit; one item per column, wheel and pedal that the
 * aircraft describes.
 *
 * Travel s, aft, right and right foot positive; force F of the pilot in the same sense.  Forces
 * F_* of the outputs stand on the pilot's side of [LR743] F = m s'' + W s' + C s + F_aer +
 * F_coul + F_stop + F_g + F_nose: positive is what he has to push. */
#ifndef AEROMATCH_CONTROL_NAMES_H
#define AEROMATCH_CONTROL_NAMES_H

#define AM_CIRCUIT_INPUTS(X) \
    X(U_CIRCUIT_TRAVEL, "*") \
    X(U_CIRCUIT_FORCE, "F_*")
#define AM_CIRCUIT_OUTPUTS(X) \
    X(Y_CIRCUIT_TRAVEL, "applied.*") \
    X(Y_CIRCUIT_RATE, "*.rate") \
    X(Y_CIRCUIT_FORCE, "applied.F_*") \
    X(Y_CIRCUIT_DEFLECTION, "*.deflection") \
    X(Y_CIRCUIT_SYMMETRIC, "*.symmetric") \
    X(Y_CIRCUIT_HINGE_MOMENT, "*.hinge_moment") \
    X(Y_CIRCUIT_F_AER, "*.F_aer") \
    X(Y_CIRCUIT_F_COUL, "*.F_coul") \
    X(Y_CIRCUIT_F_STOP, "*.F_stop") \
    X(Y_CIRCUIT_F_G, "*.F_g") \
    X(Y_CIRCUIT_F_NOSE, "*.F_nose") \
    X(Y_CIRCUIT_TRIM_FORCE, "trim.F_*")
#define AM_CIRCUIT_PARAMETERS(X) \
    X(P_CIRCUIT_ORDER, "*.order") \
    X(P_CIRCUIT_STEP, "*.step") \
    X(P_CIRCUIT_S_HINGE, "*.S_hinge") \
    X(P_CIRCUIT_C_HINGE, "*.c_hinge") \
    X(P_CIRCUIT_GEARING, "*.gearing") \
    X(P_CIRCUIT_GEARING_SLOPE, "*.gearing_slope") \
    X(P_CIRCUIT_RIGGING, "*.rigging") \
    X(P_CIRCUIT_MASS, "*.mass") \
    X(P_CIRCUIT_INERTIA, "*.inertia") \
    X(P_CIRCUIT_DAMPING, "*.damping") \
    X(P_CIRCUIT_HINGE_DAMPING, "*.hinge_damping") \
    X(P_CIRCUIT_STIFFNESS, "*.stiffness") \
    X(P_CIRCUIT_NEUTRAL, "*.neutral") \
    X(P_CIRCUIT_NEUTRAL_TRIM, "*.neutral_trim") \
    X(P_CIRCUIT_PRELOAD, "*.preload") \
    X(P_CIRCUIT_FRICTION, "*.friction") \
    X(P_CIRCUIT_STICTION, "*.stiction") \
    X(P_CIRCUIT_HINGE_FRICTION, "*.hinge_friction") \
    X(P_CIRCUIT_LOW, "*.stop_low") \
    X(P_CIRCUIT_HIGH, "*.stop_high") \
    X(P_CIRCUIT_RESTITUTION, "*.restitution") \
    X(P_CIRCUIT_DELTA_LOW, "*.delta_low") \
    X(P_CIRCUIT_DELTA_HIGH, "*.delta_high") \
    X(P_CIRCUIT_CABLE, "*.cable_stiffness") \
    X(P_CIRCUIT_CABLE_DAMPING, "*.cable_damping") \
    X(P_CIRCUIT_BOB, "*.bob_weight") \
    X(P_CIRCUIT_UNBALANCE, "*.unbalance") \
    X(P_CIRCUIT_ARM, "*.arm") \
    X(P_CIRCUIT_TAB_LEFT, "*.tab_left") \
    X(P_CIRCUIT_TAB_RIGHT, "*.tab_right") \
    X(P_CIRCUIT_BIAS_FORCE, "bias.F_*") \
    X(P_CIRCUIT_TRIM_LIMIT, "*.trim_limit") \
    X(P_CIRCUIT_TRIM_FRICTION, "*.trim_friction") \
    X(P_CIRCUIT_NOSE_SPRING, "*.nose_spring")
#define AM_CIRCUIT_STATES(X)
#define AM_CIRCUIT_VARIABLES(X)
#define AM_CIRCUIT_TARGETS(X)

/* Memory: travel, rate and acceleration of up to three bodies, friction and stop reactions on
 * them; deflection at both ends of the last step and its length, zero at the start; biases that
 * were in the deflection at the start; force added by the trim. */
enum {
    D_TRAVEL,
    D_RATE = 3,
    D_ACCELERATION = 6,
    D_FRICTION = 9,
    D_STOP = 12,
    D_FROM = 15,
    D_TO,
    D_STEP,
    D_OFFSET,
    D_TRIM_FORCE,
    D_PER_CIRCUIT
};
#define W_PER_CIRCUIT 0

#endif
