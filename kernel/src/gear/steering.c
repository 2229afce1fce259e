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
 * mu Fz scrub, and holds the rest when the pull ends; rolling reduces it over the relaxation
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

static real steering_command(const flight_t *sim, const real *u) {
    const real *p = par_of(sim, G_GEAR, 0);
    const real limit = p[P_STEERING_LIMIT];
    return clamp(
        input_of(sim, u, G_GEAR, 0)[U_DELTA_NW] - p[P_STEERING_RUDDER] * sim->var[A_DELTA_R],
        -limit, limit);
}

#if ORIGINAL

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

void steering_start(am_sim *sim, double *x) {
    double *own = rate_of(sim, x, G_GEAR, 0);
    for (int i = 0; i < X_PER_GEAR; i++) own[i] = 0.0;
    if (par_of(sim, G_GEAR, 0)[P_STEERING_STIFFNESS] > 0.0) {
        own[X_STEERING] = own[X_ARM] = steering_command(sim, sim->u);
    }
}

#endif

real steering_angle(const flight_t *sim, const real *x) {
    const real limit = par_of(sim, G_GEAR, 0)[P_STEERING_LIMIT];
    return clamp(state_of(sim, x, G_GEAR, 0)[X_STEERING], -limit, limit);
}

/* The wheel runs after its pivot: across = 0 for a contact a trail behind. */
static real castor_rate(const real *p, const steered_t *wheel, real angle) {
    const real limit = p[P_STEERING_LIMIT];
    const mask_t stands = wheel->grip > 0.0;
    const real centring = -angle / TYRE_LAG;
    if (!ANY(stands)) return centring;
    const real rate = wheel->across / larger(p[P_STEERING_TRAIL], TYRE_LAG * wheel->speed)
                      - wheel->yaw;
    const real least = (-limit - angle) / TYRE_LAG;
    return PICK(stands, clamp(rate, least, (limit - angle) / TYRE_LAG), centring);
}

static real quasi_static_rate(const real *p, const steered_t *wheel, real angle, real aim) {
    const real K = p[P_STEERING_STIFFNESS];
    const real limit = p[P_STEERING_LIMIT];
    const mask_t castor = NOT(K > 0.0);
    if (EVERY(castor)) return castor_rate(p, wheel, angle);
    const real held = wheel->grip * p[P_STEERING_SCRUB] / K;
    const real off = clamp(aim - p[P_STEERING_TRAIL] * wheel->side / K, -limit, limit) - angle;
    const real beyond = off - clamp(off, -held, held);
    const real rate = beyond / TYRE_LAG + wheel->renewal * (off - beyond);
    return ANY(castor) ? PICK(castor, castor_rate(p, wheel, angle), rate) : rate;
}

static real wheel_acceleration(const real *p, const steered_t *wheel, const real *own,
                               real spring) {
    const real I = p[P_STEERING_INERTIA];
    const real angle = own[X_STEERING];
    const real rate = own[X_STEERING_RATE];
    const real limit = p[P_STEERING_LIMIT];
    const real over = angle - clamp(angle, -limit, limit);
    const real stop = PICK(over != 0.0, I * STOP_RATE * (STOP_RATE * over + 2.0 * rate), 0.0);
    const real scrub = wheel->grip * p[P_STEERING_SCRUB] * own[X_TWIST] / TWIST;
    return (spring - p[P_STEERING_DAMPING] * rate - p[P_STEERING_TRAIL] * wheel->side - scrub
            - stop)
           / I;
}

/* An airborne wheel has arrived: without this it would go on for ever by ever smaller, and
 * slower, numbers. */
static void arrive(const steered_t *wheel, real *rate) {
    mask_t moves = wheel->grip > 0.0;
    for (int i = 0; i < X_PER_GEAR; i++) {
        if (EVERY(moves)) return;
        moves |= size_of(rate[i]) > ARRIVED;
    }
    for (int i = 0; i < X_PER_GEAR; i++) rate[i] = PICK(moves, rate[i], 0.0);
}

/* Rates of the states; returns the moment of the spring on the wheel. */
real steering_derivative(flight_t *sim, const real *x, const real *u, const steered_t *wheel,
                         real *dx) {
    const real *p = par_of(sim, G_GEAR, 0);
    const real *own = state_of(sim, x, G_GEAR, 0);
    const real aim = steering_command(sim, u);
    real *rate = rate_of(sim, dx, G_GEAR, 0);
    const double order = FIRST(p[P_STEERING_ORDER]);
    const real from = order == FOURTH_ORDER ? own[X_ARM] : aim;
    const real spring = p[P_STEERING_STIFFNESS] * (from - own[X_STEERING]);
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
