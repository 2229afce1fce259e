/* Geometry of a control circuit, masses and friction reduced to the travel in the cockpit, and
 * the loads on it.
 *
 * The surface follows its end of the linkage, travel s there: delta = rigging + gearing s +
 * gearing_slope s^2 / 2.  Of two ailerons the right one has delta(s), the left one delta(-s), so
 * that gearing_slope is their differential.  A moment H about the hinge is the force H
 * d(delta)/ds; masses and dampers at the hinge are reduced with the gearing at s = 0, as the
 * constant mass of [LR743] is.
 *
 *     H = qbar S_hinge c_hinge Ch           each aileron: half the area, its own deflection,
 *                                           and alpha +- p arm / V
 *     unbalance (specific force at hinge)   a tail-heavy surface falls
 *     bob_weight (specific force at the c.g.)
 *     stiffness (neutral - s)               neutral moves with the trim actuator of the circuit
 *     spring of the nose-wheel steering     on the rudder, which commands it (steering.c)
 *     nose_spring s                         while a steered wheel is on the ground */
#include "control_loads.h"

#include "algebra.h"
#include "elementary_real.h"
#include "terms.h"

#include <math.h>
#include <string.h>

int circuit_bodies(const real *p) { return (int)FIRST(p[P_CIRCUIT_ORDER]) / 2; }

real surface_deflection(const real *p, real s) {
    return p[P_CIRCUIT_RIGGING] + (p[P_CIRCUIT_GEARING] + 0.5 * p[P_CIRCUIT_GEARING_SLOPE] * s) * s;
}

real surface_slope(const real *p, real s) {
    return p[P_CIRCUIT_GEARING] + p[P_CIRCUIT_GEARING_SLOPE] * s;
}

static bool is_wheel(const flight_t *sim, uint32_t item) {
    return circuit_control(sim->model, item) == U_DELTA_A;
}

/* Bodies that the surfaces are on: the same one twice unless each aileron has its own. */
static int left_body(const real *p) { return circuit_bodies(p) > 1 ? 1 : 0; }
static int right_body(const real *p) { return circuit_bodies(p) - 1; }

real control_of_travel(const flight_t *sim, uint32_t item, const real *q) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const real right = surface_deflection(p, q[right_body(p)]);
    return is_wheel(sim, item) ? 0.5 * (right - surface_deflection(p, -q[left_body(p)])) : right;
}

real symmetric_deflection(const flight_t *sim, uint32_t item, const real *q) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    if (!is_wheel(sim, item)) return (real)0.0;
    return 0.5
           * (surface_deflection(p, q[right_body(p)]) + surface_deflection(p, -q[left_body(p)]));
}

real circuit_neutral(const flight_t *sim, uint32_t item, const real *u) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const int tab = U_DELTA_T + circuit_control(sim->model, item) - U_DELTA_E;
    return p[P_CIRCUIT_NEUTRAL] + p[P_CIRCUIT_NEUTRAL_TRIM] * biased_deflection(sim, u[tab], tab);
}

static void set_stops(const flight_t *sim, uint32_t item, linkage_t *c) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const real a = surface_travel(p, p[P_CIRCUIT_DELTA_LOW]);
    const real b = surface_travel(p, p[P_CIRCUIT_DELTA_HIGH]);
    for (int i = 0; i < c->bodies; i++) {
        c->low[i] = -HUGE_VAL;
        c->high[i] = HUGE_VAL;
    }
    c->low[0] = p[P_CIRCUIT_LOW];
    c->high[0] = p[P_CIRCUIT_HIGH];
    const int right = right_body(p);
    const int left = left_body(p);
    c->low[right] = larger(c->low[right], smaller(a, b));
    c->high[right] = smaller(c->high[right], larger(a, b));
    if (!is_wheel(sim, item)) return;
    c->low[left] = larger(c->low[left], -larger(a, b));
    c->high[left] = smaller(c->high[left], -smaller(a, b));
}

void circuit_masses(const flight_t *sim, uint32_t item, linkage_t *c) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const real G = p[P_CIRCUIT_GEARING];
    memset(c, 0, sizeof *c);
    c->bodies = circuit_bodies(p);
    c->mass[0] = p[P_CIRCUIT_MASS];
    c->damping[0] = p[P_CIRCUIT_DAMPING];
    c->friction[0] = p[P_CIRCUIT_FRICTION];
    const double share = c->bodies == 3 ? 0.5 : 1.0;
    for (int i = left_body(p); i <= right_body(p); i++) {
        c->mass[i] += share * p[P_CIRCUIT_INERTIA] * G * G;
        c->damping[i] += share * p[P_CIRCUIT_HINGE_DAMPING] * G * G;
        c->friction[i] += share * p[P_CIRCUIT_HINGE_FRICTION] * size_of(G);
    }
    for (int i = 0; i < c->bodies; i++) c->breakout[i] = c->friction[i];
    c->breakout[0] += p[P_CIRCUIT_STICTION];
    c->preload = p[P_CIRCUIT_PRELOAD];
    c->restitution = p[P_CIRCUIT_RESTITUTION];
    c->cable_stiffness = c->bodies > 1 ? p[P_CIRCUIT_CABLE] : (real)0.0;
    c->cable_damping = c->bodies > 1 ? p[P_CIRCUIT_CABLE_DAMPING] : (real)0.0;
}

void circuit_linkage(const flight_t *sim, uint32_t item, linkage_t *c) {
    circuit_masses(sim, item, c);
    set_stops(sim, item, c);
}

/* Hinge-moment coefficient of a surface at its deflection; side -1 is the left aileron, 1 the
 * right one, 0 another surface. */
static real hinge_coefficient(flight_t *sim, uint32_t item, int side, real delta) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const int control = circuit_control(sim->model, item) - U_DELTA_E;
    if (!has_terms(sim->model, G_CORE, 0, (uint32_t)(T_HINGE_E + control))) {
        return (real)0.0;
    }
    real *var = sim->var;
    const real alpha = var[A_ALPHA];
    const real deflection = var[A_DELTA_E + control];
    const real tab = var[A_DELTA_TA];
    var[A_DELTA_E + control] = delta;
    if (side) {
        var[A_ALPHA] += side * ATAN2(var[A_P] * p[P_CIRCUIT_ARM], larger(var[A_V], V_FLOOR));
        var[A_DELTA_TA] *= p[side > 0 ? P_CIRCUIT_TAB_RIGHT : P_CIRCUIT_TAB_LEFT];
    }
    evaluate_stage(sim, STAGE_HINGE);
    var[A_ALPHA] = alpha;
    var[A_DELTA_E + control] = deflection;
    var[A_DELTA_TA] = tab;
    return sum_of(sim, G_CORE, 0)[T_HINGE_E + control];
}

/* Specific force that turns a tail-heavy surface towards positive deflection: upward at elevator
 * and ailerons, right at the rudder. */
static real turning_acceleration(const flight_t *sim, uint32_t item, int side) {
    const now_r *now = &sim->now;
    const real arm = par_of(sim, G_CIRCUIT, item)[P_CIRCUIT_ARM];
    const real per_mass = 1.0 / now->mass;
    switch (circuit_control(sim->model, item)) {
    case U_DELTA_E:
        return -(now->F[2] * per_mass - now->angular[1] * (arm - now->cg[0]));
    case U_DELTA_A:
        return -(now->F[2] * per_mass + side * now->angular[0] * arm);
    default:
        return now->F[1] * per_mass + now->angular[2] * (arm - now->cg[0]);
    }
}

/* Moments about the hinge of one surface, as forces on the body it is on. */
static void load_surface(flight_t *sim, uint32_t item, int side, real s, real offset, loads_t *to) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const int body = side < 0 ? left_body(p) : right_body(p);
    const double share = side ? 0.5 : 1.0;
    const double sense = side < 0 ? -1.0 : 1.0;
    const real slope = sense * surface_slope(p, sense * s);
    const real delta = surface_deflection(p, sense * s) + sense * offset;
    const real H = share * sim->now.qbar * p[P_CIRCUIT_S_HINGE] * p[P_CIRCUIT_C_HINGE]
                   * hinge_coefficient(sim, item, side, delta);
    const real H_g = share * p[P_CIRCUIT_UNBALANCE] * turning_acceleration(sim, item, side);
    to->hinge_moment += sense * H;
    to->aero -= H * slope;
    to->mass -= H_g * slope;
    to->on[body] += (H + H_g) * slope;
}

static mask_t steered_wheel_stands(const flight_t *sim) {
    mask_t stands = everywhere(false);
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
        const mask_t steered = par_of(sim, G_CONTACT, i)[P_CONTACT_STEERING] != 0.0;
        stands |= steered & (work_of(sim, G_CONTACT, i)[Y_CONTACT_WOW] > 0.0);
    }
    return stands;
}

/* The spring between the cockpit and a steered wheel that the ground holds, as identified from
 * pedal forces without the angle of the wheel. */
static void load_nose_spring(const flight_t *sim, uint32_t item, const real *q, loads_t *to) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const mask_t sprung = p[P_CIRCUIT_NOSE_SPRING] > 0.0;
    if (!ANY(sprung)) return;
    const mask_t holds = sprung & steered_wheel_stands(sim);
    const real force = p[P_CIRCUIT_NOSE_SPRING] * q[0];
    to->nose = PICK(holds, to->nose + force, to->nose);
    to->on[0] = PICK(holds, to->on[0] - force, to->on[0]);
}

/* The spring between the command of the steering, delta_nw - steering.rudder delta_r, and wheel
 * or steering arm. */
static void load_nose_wheel(const flight_t *sim, uint32_t item, const real *x, const real *u,
                            const real *q, real offset, loads_t *to) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    if (!items(sim->model, G_GEAR) || circuit_control(sim->model, item) != U_DELTA_R) return;
    const real *gear = par_of(sim, G_GEAR, 0);
    const real *wheel = state_of(sim, x, G_GEAR, 0);
    const bool arm = FIRST(gear[P_STEERING_ORDER]) == 4.0;
    const int body = right_body(p);
    const real rudder = surface_deflection(p, q[body]) + offset;
    const real aim = input_of(sim, u, G_GEAR, 0)[U_DELTA_NW] - gear[P_STEERING_RUDDER] * rudder;
    const real moment = gear[arm ? P_ARM_STIFFNESS : P_STEERING_STIFFNESS]
                        * (aim - wheel[arm ? X_ARM : X_STEERING]);
    const real force = moment * gear[P_STEERING_RUDDER] * surface_slope(p, q[body]);
    to->nose -= force;
    to->on[body] += force;
}

void circuit_loads(flight_t *sim, uint32_t item, const real *x, const real *u, const real *q,
                   real offset, loads_t *to) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const now_r *now = &sim->now;
    const real half = 0.5 / larger(now->V, V_FLOOR);
    const real nz = -now->F[2] / (now->mass * G0);
    memset(to, 0, sizeof *to);
    sim->var[A_ALPHADOTHAT] = now->alpha_dot * sim->model->cbar * half;
    sim->var[A_BETADOTHAT] = now->beta_dot * sim->model->b * half;
    sim->var[A_DNZ] = nz - 1.0;
    if (is_wheel(sim, item)) {
        load_surface(sim, item, -1, q[left_body(p)], offset, to);
        load_surface(sim, item, 1, q[right_body(p)], offset, to);
    } else {
        load_surface(sim, item, 0, q[right_body(p)], offset, to);
    }
    load_nose_wheel(sim, item, x, u, q, offset, to);
    load_nose_spring(sim, item, q, to);
    const bool column = circuit_control(sim->model, item) == U_DELTA_E;
    const real bob = p[P_CIRCUIT_BOB] * (column ? nz * G0 : now->F[1] / now->mass);
    to->mass += bob;
    to->on[0] += p[P_CIRCUIT_STIFFNESS] * (circuit_neutral(sim, item, u) - q[0]) - bob;
}
