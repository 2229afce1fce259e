/* Nose-wheel steering.  The command, delta_nw and the share of the rudder pedals, pulls the
 * wheel through a spring; the side force behind the pivot (trail) turns it back, and on a wheel
 * that does not roll the ground holds it by friction (scrub).
 *
 *     steering.order 0   quasi-static; without stiffness a castor:
 *                            stiffness (command - angle) = trail Fy + scrub moment
 *                    2   inertia angle'' = stiffness (command - angle) - damping angle'
 *                                          - trail Fy - scrub moment
 *                    4   the same behind an arm with inertia, damping and spring to the command
 *
 * LR-743 4.5.4 identified orders 2 and 4 and flew the quasi-static model.  The scrub moment is a
 * return map like that of the tyre: a wheel at rest stays where it is until the spring exceeds
 * mu Fz scrub, and keeps the rest when the pull ends; rolling takes it away over the relaxation
 * length.  An airborne wheel follows the command, a castor centres. */
#include "steering.h"

#include "algebra.h"
#include "error.h"

#include <math.h>

/* of springs over inertia and dampers over inertia: what the integration follows [rad s-1] */
#define FASTEST 100.0
#define TWIST 0.1      /* of the tyre at which all of its patch slips [rad] */
#define ARRIVED 1e-9   /* rates of an airborne wheel that are none [rad s-1, rad s-2] */
#define STOP_RATE 50.0 /* undamped frequency of wheel and stop [rad s-1] */

enum { QUASI_STATIC = 0, SECOND_ORDER = 2, FOURTH_ORDER = 4 };

int steering_check(am_sim *sim) {
    const double *p = par_of(sim, G_GEAR, 0);
    const double order = p[P_STEERING_ORDER];
    const double K = p[P_STEERING_STIFFNESS];
    const double I = p[P_STEERING_INERTIA];
    for (int code = P_STEERING_LIMIT; code <= P_ARM_INERTIA; code++) {
        if (code != P_STEERING_TRAIL && code != P_STEERING_RUDDER && !(p[code] >= 0.0)) {
            return bad_value(sim, p + code, "zero or positive");
        }
    }
    if (order != QUASI_STATIC && order != SECOND_ORDER && order != FOURTH_ORDER) {
        return bad_value(sim, p + P_STEERING_ORDER, "0 (quasi-static), 2 or 4");
    }
    if (order == QUASI_STATIC && K == 0.0 && !(p[P_STEERING_TRAIL] > 0.0)) {
        return bad_value(sim, p + P_STEERING_TRAIL, "positive for a castor (steering.stiffness 0)");
    }
    if (order != QUASI_STATIC
        && !(I > 0.0 && K <= FASTEST * FASTEST * I && p[P_STEERING_DAMPING] <= FASTEST * I)) {
        return bad_value(sim, p + P_STEERING_INERTIA,
                         "positive, at least steering.stiffness / 1e4 and steering.damping / 100");
    }
    const double both = K + p[P_ARM_STIFFNESS];
    const double arm = p[P_ARM_INERTIA];
    if (order == FOURTH_ORDER
        && !(arm > 0.0 && both <= FASTEST * FASTEST * arm && p[P_ARM_DAMPING] <= FASTEST * arm)) {
        return bad_value(
            sim, p + P_ARM_INERTIA,
            "positive, at least (stiffness + arm_stiffness) / 1e4 and arm_damping / 100 of "
            "steering");
    }
    return AM_OK;
}

static double command(const am_sim *sim, const double *u) {
    const double *p = par_of(sim, G_GEAR, 0);
    const double limit = p[P_STEERING_LIMIT];
    return clamp(
        input_of(sim, u, G_GEAR, 0)[U_DELTA_NW] - p[P_STEERING_RUDDER] * sim->var[A_DELTA_R],
        -limit, limit);
}

void steering_start(am_sim *sim, double *x) {
    double *own = rate_of(sim, x, G_GEAR, 0);
    for (int i = 0; i < X_PER_GEAR; i++) own[i] = 0.0;
    if (par_of(sim, G_GEAR, 0)[P_STEERING_STIFFNESS] > 0.0) {
        own[X_STEERING] = own[X_ARM] = command(sim, sim->u);
    }
}

double steering_angle(const am_sim *sim, const double *x) {
    const double limit = par_of(sim, G_GEAR, 0)[P_STEERING_LIMIT];
    return clamp(state_of(sim, x, G_GEAR, 0)[X_STEERING], -limit, limit);
}

/* The wheel runs after its pivot: across = 0 for a contact a trail behind. */
static double castor_rate(const double *p, const steered_t *wheel, double angle) {
    const double limit = p[P_STEERING_LIMIT];
    if (!(wheel->grip > 0.0)) return -angle / TYRE_LAG;
    const double rate = wheel->across / fmax(p[P_STEERING_TRAIL], TYRE_LAG * wheel->speed)
                        - wheel->yaw;
    return clamp(rate, (-limit - angle) / TYRE_LAG, (limit - angle) / TYRE_LAG);
}

static double quasi_static_rate(const double *p, const steered_t *wheel, double angle, double aim) {
    const double K = p[P_STEERING_STIFFNESS];
    const double limit = p[P_STEERING_LIMIT];
    if (!(K > 0.0)) return castor_rate(p, wheel, angle);
    const double held = wheel->grip * p[P_STEERING_SCRUB] / K;
    const double off = clamp(aim - p[P_STEERING_TRAIL] * wheel->side / K, -limit, limit) - angle;
    const double beyond = off - clamp(off, -held, held);
    return beyond / TYRE_LAG + wheel->renewal * (off - beyond);
}

static double wheel_acceleration(const double *p, const steered_t *wheel, const double *own,
                                 double spring) {
    const double I = p[P_STEERING_INERTIA];
    const double angle = own[X_STEERING];
    const double rate = own[X_STEERING_RATE];
    const double limit = p[P_STEERING_LIMIT];
    const double over = angle - clamp(angle, -limit, limit);
    const double stop = over != 0.0 ? I * STOP_RATE * (STOP_RATE * over + 2.0 * rate) : 0.0;
    const double scrub = wheel->grip * p[P_STEERING_SCRUB] * own[X_TWIST] / TWIST;
    return (spring - p[P_STEERING_DAMPING] * rate - p[P_STEERING_TRAIL] * wheel->side - scrub
            - stop)
           / I;
}

/* An airborne wheel has arrived: without this it would go on for ever by ever smaller, and
 * slower, numbers. */
static void arrive(const steered_t *wheel, double *rate) {
    if (wheel->grip > 0.0) return;
    for (int i = 0; i < X_PER_GEAR; i++) {
        if (fabs(rate[i]) > ARRIVED) return;
    }
    for (int i = 0; i < X_PER_GEAR; i++) rate[i] = 0.0;
}

/* Rates of the states; returns the moment of the spring on the wheel. */
double steering_derivative(am_sim *sim, const double *x, const double *u, const steered_t *wheel,
                           double *dx) {
    const double *p = par_of(sim, G_GEAR, 0);
    const double *own = state_of(sim, x, G_GEAR, 0);
    const double aim = command(sim, u);
    double *rate = rate_of(sim, dx, G_GEAR, 0);
    const double order = p[P_STEERING_ORDER];
    const double from = order == FOURTH_ORDER ? own[X_ARM] : aim;
    const double spring = p[P_STEERING_STIFFNESS] * (from - own[X_STEERING]);
    for (int i = 0; i < X_PER_GEAR; i++) rate[i] = 0.0;
    if (order == QUASI_STATIC) {
        rate[X_STEERING] = quasi_static_rate(p, wheel, own[X_STEERING], aim);
        arrive(wheel, rate);
        return spring;
    }
    rate[X_STEERING] = own[X_STEERING_RATE];
    rate[X_STEERING_RATE] = wheel_acceleration(p, wheel, own, spring);
    rate[X_TWIST] =
        (clamp(own[X_TWIST] + TYRE_LAG * own[X_STEERING_RATE], -TWIST, TWIST) - own[X_TWIST])
        / TYRE_LAG;
    rate[X_TWIST] -= wheel->renewal * own[X_TWIST];
    if (order == FOURTH_ORDER) {
        rate[X_ARM] = own[X_ARM_RATE];
        rate[X_ARM_RATE] =
            (p[P_ARM_STIFFNESS] * (aim - own[X_ARM]) - p[P_ARM_DAMPING] * own[X_ARM_RATE] - spring)
            / p[P_ARM_INERTIA];
    }
    arrive(wheel, rate);
    return spring;
}
