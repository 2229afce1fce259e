/* An engine with a propeller: the torque of piston, motor or turbine on the shaft, and the balance
 * of torques at the start. */
#include "shaft.h"

#include "motor.h"
#include "piston.h"
#include "propeller.h"

static inline bool turbine(const am_model *m) { return items(m, G_SPOOL) > 0; }

/* Whether the gas generator turns with the propeller. */
static inline bool coupled(const flight_t *sim, uint32_t i) {
    return turbine(sim->model) && FIRST(par_of(sim, G_PROPELLER, i)[P_COUPLED]) != 0.0;
}

void shaft_variables(flight_t *sim, uint32_t i, const real *x, const real *u) {
    propeller_variables(sim, i, x, u);
    if (items(sim->model, G_PISTON)) piston_variables(sim, i, x, u);
    if (items(sim->model, G_MOTOR)) motor_variables(sim, i, x);
}

/* The starter of a gas generator on the shaft of the propeller turns both; its speed follows. */
static void couple(flight_t *sim, uint32_t i, const real *u, real *dx) {
    const real *p = par_of(sim, G_PROPELLER, i);
    const real *q = par_of(sim, G_SPOOL, i);
    const real per_n1 = size_of(q[P_N1_RATED]) / p[P_GEAR_RATIO];
    const real gap = q[P_STARTER_SPEED] * per_n1 - var_of(sim, G_PROPELLER, i)[A_RPM];
    const mask_t below = gap > 0.0;
    const mask_t cranked = (input_of(sim, u, G_SPOOL, i)[U_STARTER] > SWITCHED) & below;
    real *rate = rate_of(sim, dx, G_PROPELLER, i) + X_RPM;
    real *spool = rate_of(sim, dx, G_SPOOL, i) + X_N1;
    *rate += PICK(cranked, gap / q[P_STARTER_TIME], 0.0);
    *spool = *rate / per_n1;
}

real shaft_loads(flight_t *sim, uint32_t i, const real *x, const real *u, real *fuel_flow,
                 real F[restrict 3], real M[restrict 3], real H[restrict 3], real *dx) {
    const am_model *m = sim->model;
    real torque = 0.0;
    real flow = 0.0;
    real own = 1.0;
    if (items(m, G_PISTON)) torque = piston_torque(sim, i, x, u, &flow, dx);
    if (items(m, G_MOTOR)) torque = motor_torque(sim, i, dx);
    if (turbine(m)) {
        own = state_of(sim, x, G_SPOOL, i)[X_BURNING];
        const real power = larger(propeller_power(sim, i, x), 0.0);
        flow = own * sum_of(sim, G_PROPELLER, i)[T_SHAFT_BSFC] * power;
    }
    *fuel_flow += flow;
    const real thrust = propeller_loads(sim, i, x, u, torque, own, F, M, H, dx);
    if (coupled(sim, i)) couple(sim, i, u, dx);
    return thrust;
}

void shaft_outputs(const flight_t *sim, uint32_t i, real *y) {
    propeller_outputs(sim, i, y);
    if (items(sim->model, G_PISTON)) piston_outputs(sim, i, y);
    if (items(sim->model, G_MOTOR)) motor_outputs(sim, i, y);
}

#if ORIGINAL

int shaft_check(am_sim *sim, uint32_t i) {
    int status = propeller_check(sim, i);
    if (status == AM_OK && items(sim->model, G_PISTON)) status = piston_check(sim, i);
    if (status == AM_OK && items(sim->model, G_MOTOR)) status = motor_check(sim, i);
    return status;
}

/* ---- steady state ---------------------------------------------------------------------------- */

#define SCANS 96      /* speeds among which the balance of torque is looked for */
#define HALVINGS 60   /* of a bracket, to the last bits */
#define DOUBLINGS 6   /* of the highest speed that is looked at */

typedef struct {
    am_sim *sim;
    uint32_t engine;
    void (*look)(am_sim *);
} shaft_t;

/* Rate of the speed at a speed and blade angle, all else steady. */
static double excess(const shaft_t *shaft, double speed, double angle) {
    am_sim *sim = shaft->sim;
    const uint32_t i = shaft->engine;
    double *s = rate_of(sim, sim->x, G_PROPELLER, i);
    double F[3], M[3], H[3], flow;
    s[X_RPM] = speed;
    s[X_BLADE_ANGLE] = angle;
    shaft->look(sim);
    if (items(sim->model, G_PISTON)) {
        piston_settle(sim, i);
        shaft->look(sim);
    }
    propeller_settle(sim, i);
    for (int k = 0; k < 3; k++) F[k] = M[k] = H[k] = 0.0;
    shaft_loads(sim, i, sim->x, sim->u, &flow, F, M, H, sim->k);
    return rate_of(sim, sim->k, G_PROPELLER, i)[X_RPM];
}

/* Zero of the excess between two speeds, or between two blade angles. */
static void halve(const shaft_t *shaft, double speed[2], double angle[2]) {
    for (int k = 0; k < HALVINGS; k++) {
        const double middle = 0.5 * (speed[0] + speed[1]);
        const double blade = 0.5 * (angle[0] + angle[1]);
        const int side = excess(shaft, middle, blade) > 0.0 ? 0 : 1;
        speed[side] = middle;
        angle[side] = blade;
    }
}

/* The highest speed at which the torques balance and a faster propeller slows down; 0 where there
 * is none. */
static double balanced(const shaft_t *shaft, double angle) {
    double top = 2.0 * par_of(shaft->sim, G_PROPELLER, shaft->engine)[P_RPM_HIGH];
    for (int k = 0; k < DOUBLINGS && excess(shaft, top, angle) > 0.0; k++) top *= 2.0;
    double above = top;
    for (int k = SCANS - 1; k >= 0; k--) {
        const double below = top * k / SCANS;
        if (excess(shaft, below, angle) > 0.0) {
            double speed[2] = {below, above};
            double blade[2] = {angle, angle};
            halve(shaft, speed, blade);
            return speed[0];
        }
        above = below;
    }
    return 0.0;
}

static void settle_shaft(const shaft_t *shaft) {
    am_sim *sim = shaft->sim;
    const uint32_t i = shaft->engine;
    const double *p = par_of(sim, G_PROPELLER, i);
    shaft->look(sim);
    const bool feathers = input_of(sim, sim->u, G_PROPELLER, i)[U_FEATHER] > SWITCHED
                          && p[P_FEATHER_RATE] > 0.0;
    const double lever = clamp(var_of(sim, G_PROPELLER, i)[A_PROP_COMMAND], 0.0, 1.0);
    double angle[2] = {lowest_blade_angle(sim, i), p[P_HIGH_PITCH]};
    const double commanded = commanded_rpm(sim, i, sim->u);
    double speed[2] = {commanded, commanded};
    if (feathers) {
        angle[0] = p[P_FEATHER_PITCH];
    } else if (p[P_GOVERNED] == 0.0) {
        angle[0] = fmax(angle[0], p[P_LOW_PITCH] + lever * (p[P_HIGH_PITCH] - p[P_LOW_PITCH]));
    } else if (excess(shaft, speed[0], angle[1]) > 0.0) {
        angle[0] = angle[1];
    } else if (excess(shaft, speed[0], angle[0]) > 0.0) {
        halve(shaft, speed, angle);
        excess(shaft, speed[0], angle[0]);
        return;
    }
    const double steady = balanced(shaft, angle[0]);
    excess(shaft, steady, angle[0]);
}

void shaft_guess(am_sim *sim, uint32_t i) {
    const double *p = par_of(sim, G_PROPELLER, i);
    double *s = rate_of(sim, sim->x, G_PROPELLER, i);
    for (int k = 0; k < X_PER_PROPELLER; k++) s[k] = 0.0;
    s[X_RPM] = p[P_RPM_HIGH];
    s[X_BLADE_ANGLE] = p[P_LOW_PITCH];
    if (items(sim->model, G_PISTON)) piston_start(sim, i);
    if (items(sim->model, G_MOTOR)) motor_start(sim, i);
}

void shaft_start(am_sim *sim, uint32_t i, void (*look)(am_sim *)) {
    const shaft_t shaft = {sim, i, look};
    settle_shaft(&shaft);
    if (items(sim->model, G_PISTON) && piston_stalls(sim, i)) settle_shaft(&shaft);
}


#endif
