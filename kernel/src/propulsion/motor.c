/* Direct-current motor behind a controller that chops the voltage of a battery.
 *
 *     I   = (d E - w / k) / (R + d^2 R_b), at least 0        d: lever, E: open voltage, w: speed
 *     Q   = (I - I_0) / k                                    k: speed constant [rad s-1 V-1]
 *     I_b = d I,   U = E - R_b I_b                           battery
 *     s'  = - I_b / capacity                                 s: charge, 0 ... 1
 *
 * Power is kept: d I U = I^2 R + w Q + w I_0 / k.  The controller does not brake: no current flows
 * back.  Where the battery is empty there is none. */
#include "motor.h"

#include "algebra.h"
#include "error.h"
#include "shaft_limits.h"

void motor_variables(flight_t *sim, uint32_t i, const real *x) {
    var_of(sim, G_MOTOR, i)[A_CHARGE] = state_of(sim, x, G_MOTOR, i)[X_CHARGE];
}

real motor_torque(flight_t *sim, uint32_t i, real *dx) {
    const real *p = par_of(sim, G_MOTOR, i);
    const real speed = var_of(sim, G_PROPELLER, i)[A_ENGINE_RPM];
    const real charge = var_of(sim, G_MOTOR, i)[A_CHARGE];
    const real open = sum_of(sim, G_MOTOR, i)[T_OPEN_VOLTAGE];
    const real duty = clamp(var_of(sim, G_ENGINE, i)[A_THROTTLE], 0.0, 1.0);
    const real resistance = p[P_MOTOR_RESISTANCE] + duty * duty * p[P_BATTERY_RESISTANCE];
    const real drawn = larger((duty * open - speed / p[P_SPEED_CONSTANT]) / resistance, 0.0);
    const real current = PICK(charge > 0.0, drawn, 0.0);
    real *work = work_of(sim, G_MOTOR, i);
    work[W_CURRENT] = duty * current;
    work[W_BATTERY_VOLTAGE] = open - p[P_BATTERY_RESISTANCE] * work[W_CURRENT];
    rate_of(sim, dx, G_MOTOR, i)[X_CHARGE] = -work[W_CURRENT] / p[P_CAPACITY];
    /* iron and bearings: a torque that opposes the motion, and fades where it ends */
    const real idle = p[P_IDLE_CURRENT] * smaller(speed / SLOW_SHAFT, 1.0);
    return (current - idle) / p[P_SPEED_CONSTANT];
}

void motor_outputs(const flight_t *sim, uint32_t i, real *y) {
    const real *work = work_of(sim, G_MOTOR, i);
    real *to = output_of(sim, y, G_MOTOR, i);
    to[Y_CURRENT] = work[W_CURRENT];
    to[Y_BATTERY_VOLTAGE] = work[W_BATTERY_VOLTAGE];
    to[Y_CHARGE] = var_of(sim, G_MOTOR, i)[A_CHARGE];
}

#if ORIGINAL

void motor_start(am_sim *sim, uint32_t i) {
    rate_of(sim, sim->x, G_MOTOR, i)[X_CHARGE] = par_of(sim, G_MOTOR, i)[P_CHARGE_START];
}

int motor_check(am_sim *sim, uint32_t i) {
    static const uint32_t POSITIVE[] = {P_SPEED_CONSTANT, P_MOTOR_RESISTANCE, P_CAPACITY};
    const uint32_t first = place(sim->model, AM_PARAMETER, G_MOTOR, i);
    const double *p = par_of(sim, G_MOTOR, i);
    for (size_t k = 0; k < sizeof POSITIVE / sizeof POSITIVE[0]; k++) {
        if (!(p[POSITIVE[k]] > 0.0)) return bad_parameter(sim, first + POSITIVE[k], "positive");
    }
    if (!(p[P_IDLE_CURRENT] >= 0.0)) {
        return bad_parameter(sim, first + P_IDLE_CURRENT, "zero or positive");
    }
    if (!(p[P_BATTERY_RESISTANCE] >= 0.0)) {
        return bad_parameter(sim, first + P_BATTERY_RESISTANCE, "zero or positive");
    }
    if (!(p[P_CHARGE_START] >= 0.0 && p[P_CHARGE_START] <= 1.0)) {
        return bad_parameter(sim, first + P_CHARGE_START, "between 0 and 1");
    }
    if (!has_terms(sim->model, G_MOTOR, i, T_OPEN_VOLTAGE)) {
        return fail(sim, AM_BAD_VALUE, "engine%u has a motor without a table open_voltage",
                    (unsigned)(i + 1));
    }
    return AM_OK;
}

#endif
