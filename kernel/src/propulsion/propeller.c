/* Propeller on its shaft: coefficients over the advance ratio, blades, governor, and what the
 * aircraft feels of it.
 *
 *     n' = max(n, V_a / (J_end D)),  J = V_a / (n' D)    n: rev/s, V_a: at the hub, along the line
 *     T  = CT rho n'^2 D^4                               along the thrust line
 *     Q  = CP rho n'^2 D^5 / (2 pi)                      torque of the air, opposes the rotation
 *     w' = (Q_e - Q) / inertia                           Q_e: torque of the engine at the shaft
 *     H  = rotation inertia w,   M = - rotation Q_e      along the line; Q_e = Q + inertia w'
 *
 * Below V_a / (J_end D), where the tables end, T and Q depend on the airspeed alone:
 * T / (rho V^2 D^2) of a propeller that slows down to a stop stays that of J_end.
 *
 * With the flow at the hub v across the thrust line d, of size V sin(inflow):
 *
 *     F = - CN rho n'^2 D^4 v / V        M = - rotation CM rho n'^2 D^5 v / V
 *
 * F is the force in the disk, M the moment of the thrust that moves to the blade that goes down
 * (P-factor): a propeller that turns right-handed at positive alpha yaws the nose to the left.
 *
 * A recorded torque is Q_e (mode.engine 3).  A governor holds a recorded speed (mode.engine 3 to 5)
 * with blades that balance the torque at it; without a governor it is that of the shaft
 * (mode.engine 4).
 *
 * The governor turns the blades by the error of the speed, with a lag and within a rate; the low
 * stop may be a table over the lever (beta range and reverse). */
#include "propeller.h"

#include "algebra.h"
#include "error.h"
#include "thrust.h"

#include <math.h>

#define TWO_PI 6.283185307179586
#define LEAST_TURNS 1e-3      /* least n of an advance ratio [rev/s] */
#define DENSITY_SEA 1.225     /* of the equivalent airspeed [kg m-3] */
/* A governor that holds a recorded speed: lags of speed and blades [s], and the slope of CP over
 * the blade angle that its gain counts with [rad-1], 0.15 to 0.4 of light propellers. */
#define FOLLOW_TIME 0.15
#define BLADE_TIME 0.05
#define CP_SLOPE 0.25
#define LEAST_TORQUE 1.0 /* [N m] */
#define QUICKEST_SHAFT 0.02   /* least time constant, for RK4 with 10 ms [s] */

/* Velocity of the hub relative to the air, body axes. */
static inline void hub_velocity(const flight_t *sim, uint32_t i, real velocity[3]) {
    const now_r *now = &sim->now;
    const real *at = par_of(sim, G_ENGINE, i) + P_ENGINE_X;
    const real arm[3] = {at[0] - now->cg[0], at[1] - now->cg[1], at[2] - now->cg[2]};
    real rate[3];
    for (int k = 0; k < 3; k++) rate[k] = now->rate[k] - now->gust_rate[k];
    cross(rate, arm, velocity);
    velocity[0] += now->u;
    velocity[1] += now->v;
    velocity[2] += now->w;
}

/* Turns per second with which the coefficients count. */
static inline real turns_of(const real *p, real speed, real axial) {
    const real least = larger(axial / (p[P_J_END] * p[P_DIAMETER]), LEAST_TURNS);
    return larger(speed / TWO_PI, least);
}

void propeller_variables(flight_t *sim, uint32_t i, const real *x, const real *u) {
    const now_r *now = &sim->now;
    const real *p = par_of(sim, G_PROPELLER, i);
    const real *s = state_of(sim, x, G_PROPELLER, i);
    real *v = var_of(sim, G_PROPELLER, i);
    real velocity[3];
    hub_velocity(sim, i, velocity);
    const real axial = dot(velocity, par_of(sim, G_ENGINE, i) + P_DIRECTION_X);
    const real speed = larger(s[X_RPM], 0.0);
    const real tip = 0.5 * speed * p[P_DIAMETER];
    const real turns = turns_of(p, speed, axial);
    work_of(sim, G_PROPELLER, i)[W_TURNS] = turns;
    v[A_J] = axial / (turns * p[P_DIAMETER]);
    v[A_RPM] = speed;
    v[A_ENGINE_RPM] = speed * p[P_GEAR_RATIO];
    v[A_BLADE_ANGLE] = s[X_BLADE_ANGLE];
    v[A_TIP_MACH] = root(tip * tip + axial * axial) / now->a;
    v[A_PROP_COMMAND] = input_of(sim, u, G_PROPELLER, i)[U_PROP_COMMAND];
    v[A_V_EAS] = root(2.0 / DENSITY_SEA * now->qbar);
    /* a gas generator on the shaft of the propeller turns with it */
    if (!items(sim->model, G_SPOOL) || FIRST(p[P_COUPLED]) == 0.0) return;
    real *spool = var_of(sim, G_SPOOL, i);
    const real n1 = v[A_ENGINE_RPM] / size_of(par_of(sim, G_SPOOL, i)[P_N1_RATED]);
    spool[A_N1] = n1;
    spool[A_CORRECTED_N1] = n1 / root(spool[A_TEMPERATURE_RATIO]);
}

/* Rate of a blade angle with which the shaft follows a recorded speed: the torque of the air
 * becomes that of the engine less what the rotor takes.  excess: torque on the rotor [N m]; unit:
 * torque of the air over CP [N m]. */
static inline real balance_torque(const flight_t *sim, uint32_t i, const real *u, real excess,
                                  real unit) {
    const real *p = par_of(sim, G_PROPELLER, i);
    const real gap = commanded_rpm(sim, i, u) - var_of(sim, G_PROPELLER, i)[A_RPM];
    const real wanted = p[P_SHAFT_INERTIA] * gap / FOLLOW_TIME;
    return (excess - wanted) / (larger(unit, LEAST_TORQUE) * CP_SLOPE * BLADE_TIME);
}

/* Rates of blade angle and governor.  Without a governor the lever moves the blades. */
static void turn_blades(const flight_t *sim, uint32_t i, const real *x, const real *u, real excess,
                        real unit, real *rate) {
    const real *p = par_of(sim, G_PROPELLER, i);
    const real *s = state_of(sim, x, G_PROPELLER, i);
    const real *v = var_of(sim, G_PROPELLER, i);
    const real angle = s[X_BLADE_ANGLE];
    const real lever = clamp(v[A_PROP_COMMAND], 0.0, 1.0);
    const mask_t feathers = input_of(sim, u, G_PROPELLER, i)[U_FEATHER] > SWITCHED;
    const mask_t governed = p[P_GOVERNED] != 0.0;
    const mask_t lags = p[P_GOVERNOR_TIME] > 0.0;
    const real wanted = p[P_GOVERNOR_GAIN] * (v[A_RPM] - commanded_rpm(sim, i, u));
    const real set = p[P_LOW_PITCH] + lever * (p[P_HIGH_PITCH] - p[P_LOW_PITCH]);
    real held = PICK(lags, s[X_GOVERNOR], wanted);
    if (sim->drive >= TORQUE_DRIVEN) {
        const mask_t recorded = input_of(sim, u, G_PROPELLER, i)[U_RPM_DRIVE] > 0.0;
        held = PICK(recorded, balance_torque(sim, i, u, excess, unit), held);
    }
    const real moved = PICK(governed, held, (set - angle) / STOP_TIME);
    const real most = PICK(feathers, p[P_FEATHER_RATE], p[P_PITCH_RATE]);
    const real low = (lowest_blade_angle(sim, i) - angle) / STOP_TIME;
    const real high = (PICK(feathers, p[P_FEATHER_PITCH], p[P_HIGH_PITCH]) - angle) / STOP_TIME;
    const real free = clamp(PICK(feathers, most, moved), -most, most);
    rate[X_BLADE_ANGLE] = clamp(clamp(free, low, high), -most, most);
    rate[X_GOVERNOR] = PICK(lags, (clamp(wanted, -most, most) - s[X_GOVERNOR])
                                      / p[P_GOVERNOR_TIME], 0.0);
}

/* Power of the tables at the shaft, settled, within the limits. */
static inline real settled_power(const flight_t *sim, uint32_t i) {
    const real *p = par_of(sim, G_PROPELLER, i);
    const real *sum = sum_of(sim, G_PROPELLER, i);
    real power = sum[T_SHAFT_POWER];
    if (has_terms(sim->model, G_PROPELLER, i, T_CORRECTED_SHAFT_POWER)) {
        const real *spool = var_of(sim, G_SPOOL, i);
        power += spool[A_PRESSURE_RATIO] * root(spool[A_TEMPERATURE_RATIO])
                 * sum[T_CORRECTED_SHAFT_POWER];
    }
    const real speed = larger(var_of(sim, G_PROPELLER, i)[A_RPM], SLOW_SHAFT);
    return smaller(smaller(power, p[P_POWER_LIMIT]), p[P_TORQUE_LIMIT] * speed);
}

real propeller_power(const flight_t *sim, uint32_t i, const real *x) {
    return PICK(par_of(sim, G_PROPELLER, i)[P_POWER_TIME] > 0.0,
                state_of(sim, x, G_PROPELLER, i)[X_SHAFT_POWER], settled_power(sim, i));
}

/* Force in the disk and moment of the thrust that moves sideways. */
static void add_inflow(flight_t *sim, uint32_t i, real load, real F[restrict 3],
                       real M[restrict 3]) {
    const am_model *m = sim->model;
    const bool lifts = has_terms(m, G_PROPELLER, i, T_CN_PROP);
    if (!lifts && !has_terms(m, G_PROPELLER, i, T_CM_PROP)) return;
    const real *p = par_of(sim, G_PROPELLER, i);
    const real *sum = sum_of(sim, G_PROPELLER, i);
    const real *line = par_of(sim, G_ENGINE, i) + P_DIRECTION_X;
    real velocity[3];
    hub_velocity(sim, i, velocity);
    const real axial = dot(velocity, line);
    const real size = root(dot(velocity, velocity));
    const real per_V = PICK(size > V_FLOOR, 1.0 / size, 0.0);
    const real lift = load * sum[T_CN_PROP];
    const real turn = load * p[P_DIAMETER] * p[P_ROTATION] * sum[T_CM_PROP];
    real across[3], force[3];
    for (int k = 0; k < 3; k++) {
        across[k] = (velocity[k] - axial * line[k]) * per_V;
        force[k] = -lift * across[k];
        M[k] -= turn * across[k];
    }
    push(force, par_of(sim, G_ENGINE, i) + P_ENGINE_X, sim->now.cg, F, M);
}

real propeller_loads(flight_t *sim, uint32_t i, const real *x, const real *u, real torque, real own,
                     real F[restrict 3], real M[restrict 3], real H[restrict 3], real *dx) {
    const real *p = par_of(sim, G_PROPELLER, i);
    const real *sum = sum_of(sim, G_PROPELLER, i);
    const real *line = par_of(sim, G_ENGINE, i) + P_DIRECTION_X;
    const real D = p[P_DIAMETER];
    real *v = var_of(sim, G_PROPELLER, i);
    real *rate = rate_of(sim, dx, G_PROPELLER, i);
    real *work = work_of(sim, G_PROPELLER, i);
    const real n = work[W_TURNS];
    const real load = sim->now.rho * n * n * D * D * D * D;
    const real power = own * propeller_power(sim, i, x);
    const real made = p[P_GEAR_RATIO] * torque + power / larger(v[A_RPM], SLOW_SHAFT);
    const real *in = input_of(sim, u, G_PROPELLER, i);
    const real drive = sim->drive == TORQUE_DRIVEN ? in[U_TORQUE_DRIVE] : made;
    const real resist = load * D * sum[T_CP_PROP] / TWO_PI;
    const real speed = state_of(sim, x, G_PROPELLER, i)[X_RPM];
    /* at rest: no load turns a propeller backwards */
    const mask_t rests = (speed <= 0.0) & (drive < resist);
    rate[X_RPM] = PICK(rests, -speed / STOP_TIME, (drive - resist) / p[P_SHAFT_INERTIA]);
    real held = PICK(rests, resist, drive);
    if (sim->drive == RPM_DRIVEN) {
        /* without a governor the shaft follows the recorded speed, whatever torque that takes */
        const mask_t follows = p[P_GOVERNED] == 0.0;
        const real pulled = (larger(in[U_RPM_DRIVE], 0.0) - speed) / STOP_TIME;
        rate[X_RPM] = PICK(follows, pulled, rate[X_RPM]);
        held = PICK(follows, resist + p[P_SHAFT_INERTIA] * pulled, held);
    }
    const real lag = settled_power(sim, i) - state_of(sim, x, G_PROPELLER, i)[X_SHAFT_POWER];
    rate[X_SHAFT_POWER] = PICK(p[P_POWER_TIME] > 0.0, lag / p[P_POWER_TIME], 0.0);
    turn_blades(sim, i, x, u, drive - resist, load * D / TWO_PI, rate);
    for (int k = 0; k < 3; k++) {
        H[k] += p[P_ROTATION] * p[P_SHAFT_INERTIA] * v[A_RPM] * line[k];
        M[k] -= p[P_ROTATION] * held * line[k];
    }
    add_inflow(sim, i, load, F, M);
    work[W_CT_PROP] = v[A_CT_PROP] = sum[T_CT_PROP];
    work[W_CP_PROP] = v[A_CP_PROP] = sum[T_CP_PROP];
    work[W_TORQUE] = v[A_TORQUE] = held;
    work[W_SHAFT_POWER] = held * v[A_RPM];
    return load * sum[T_CT_PROP];
}

void propeller_outputs(const flight_t *sim, uint32_t i, real *y) {
    const real *v = var_of(sim, G_PROPELLER, i);
    const real *work = work_of(sim, G_PROPELLER, i);
    real *to = output_of(sim, y, G_PROPELLER, i);
    to[Y_RPM] = v[A_RPM];
    to[Y_BLADE_ANGLE] = v[A_BLADE_ANGLE];
    to[Y_J] = v[A_J];
    to[Y_TIP_MACH] = v[A_TIP_MACH];
    to[Y_CT_PROP] = work[W_CT_PROP];
    to[Y_CP_PROP] = work[W_CP_PROP];
    to[Y_TORQUE] = work[W_TORQUE];
    to[Y_SHAFT_POWER] = work[W_SHAFT_POWER];
}

#if ORIGINAL

void propeller_settle(am_sim *sim, uint32_t i) {
    double *s = rate_of(sim, sim->x, G_PROPELLER, i);
    s[X_SHAFT_POWER] = settled_power(sim, i);
    s[X_GOVERNOR] = 0.0;
}

int propeller_check(am_sim *sim, uint32_t i) {
    static const uint32_t POSITIVE[] = {P_DIAMETER, P_SHAFT_INERTIA, P_GEAR_RATIO,
                                        P_RPM_HIGH, P_J_END,         P_POWER_LIMIT, P_TORQUE_LIMIT};
    static const uint32_t NOT_NEGATIVE[] = {P_PITCH_RATE, P_FEATHER_RATE, P_RPM_LOW,
                                            P_GOVERNOR_GAIN};
    static const uint32_t TIMES[] = {P_GOVERNOR_TIME, P_POWER_TIME};
    const uint32_t first = place(sim->model, AM_PARAMETER, G_PROPELLER, i);
    const double *p = par_of(sim, G_PROPELLER, i);
    for (size_t k = 0; k < sizeof POSITIVE / sizeof POSITIVE[0]; k++) {
        if (!(p[POSITIVE[k]] > 0.0)) return bad_parameter(sim, first + POSITIVE[k], "positive");
    }
    for (size_t k = 0; k < sizeof NOT_NEGATIVE / sizeof NOT_NEGATIVE[0]; k++) {
        if (!(p[NOT_NEGATIVE[k]] >= 0.0)) {
            return bad_parameter(sim, first + NOT_NEGATIVE[k], "zero or positive");
        }
    }
    for (size_t k = 0; k < sizeof TIMES / sizeof TIMES[0]; k++) {
        if (p[TIMES[k]] != 0.0 && !(p[TIMES[k]] >= QUICKEST_SHAFT)) {
            return bad_parameter(sim, first + TIMES[k], "0, or 0.02 s or more");
        }
    }
    if (!(fabs(p[P_ROTATION]) == 1.0)) {
        return bad_parameter(sim, first + P_ROTATION,
                             "1 (right-handed about the thrust) or -1 (left-handed)");
    }
    if (!(p[P_HIGH_PITCH] >= p[P_LOW_PITCH])) {
        return bad_parameter(sim, first + P_HIGH_PITCH, "at least low_pitch");
    }
    if (!(p[P_RPM_HIGH] >= p[P_RPM_LOW])) {
        return bad_parameter(sim, first + P_RPM_HIGH, "at least rpm_low");
    }
    if (p[P_COUPLED] != 0.0 && !(items(sim->model, G_SPOOL)
                                 && par_of(sim, G_SPOOL, i)[P_N1_RATED] != 0.0)) {
        return bad_parameter(sim, first + P_COUPLED, "0 without a deck that has n1_rated");
    }
    return AM_OK;
}

#endif
