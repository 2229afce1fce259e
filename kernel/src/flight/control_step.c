/* The control circuits through a step of the flight.
 *
 * The circuits are stiff and set-valued and so live in the memory: before every step of the
 * rigid body they go from t to t + h in sub-steps (linkage.c).  The load over the step is linear
 * in time and in travel: from the derivative at t, which the step needs anyway, one at the state
 * that an Euler step predicts for t + h, and a difference along the travel.  So the coupling
 * with the flight is of second order.  The derivative takes the deflection linearly between both
 * ends of the step.
 *
 * Modes 1 and 2 start at rest.  In mode 2 the circuit starts at the deflection of the trim; the
 * force that holds it there and the recorded force differ by trim.F_*, which stays added, up to
 * *.trim_limit, less what dry friction holds: the share *.trim_friction of it. */
#include "control_step.h"

#include "algebra.h"
#include "control_drive.h"
#include "sixdof.h"

#include <math.h>
#include <string.h>

#define PROBE 1e-4  /* least part of the travel over which the slope of the load is taken */
#define SETTLING 12 /* iterations of the cable stretch at the start */

/* of a cable less what the air takes from it, in parts of the cable: holds the iteration
 * together */
#define LEAST_STIFFNESS 0.1

static bool any_moves(const flight_t *sim) {
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (circuit_moves(sim, i)) return true;
    }
    return false;
}

static real *scratch_slope(const flight_t *sim) { return sim->k + am_state_count(sim->model); }

static real least_move(const real *p) { return PROBE * (p[P_CIRCUIT_HIGH] - p[P_CIRCUIT_LOW]); }

/* Loads at q and their slope along the travel of each body. */
static void probe(flight_t *sim, uint32_t item, const real *u, const real *q, const real *move,
                  loads_t *at, real *slope) {
    const real offset = circuit_offset(sim, item);
    real there[LINKAGE_BODIES];
    loads_t beyond;
    for (int i = 0; i < LINKAGE_BODIES; i++) there[i] = q[i] + move[i];
    circuit_loads(sim, item, sim->x, u, q, offset, at);
    circuit_loads(sim, item, sim->x, u, there, offset, &beyond);
    for (int i = 0; i < LINKAGE_BODIES; i++) slope[i] = (beyond.on[i] - at->on[i]) / move[i];
}

#if LANES == 1

/* ---- start ----------------------------------------------------------------------------------- */

static void hold_between_stops(const linkage_t *c, double *q) {
    for (int i = 0; i < c->bodies; i++) q[i] = clamp(q[i], c->low[i], c->high[i]);
}

/* Move the surfaces until their cables end at the same place, with the control deflected as
 * wanted; put the cockpit end there. */
static void meet(const am_sim *sim, uint32_t item, double wanted, const loads_t *at,
                 const double *slope, double *q) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const double C = p[P_CIRCUIT_CABLE];
    const int n = circuit_bodies(p);
    double end = 0.0;
    double mean = 0.0;
    for (int i = 1; i < n; i++) end += (q[i] - at->on[i] / C) / (n - 1);
    for (int i = 1; i < n; i++) {
        q[i] += (end - (q[i] - at->on[i] / C)) / fmax(1.0 - slope[i] / C, LEAST_STIFFNESS);
        mean += q[i] / (n - 1);
    }
    const double shift = (wanted - control_of_travel(sim, item, q)) / surface_slope(p, mean);
    for (int i = 1; i < n; i++) q[i] += shift;
    q[0] = end;
}

/* Surfaces at rest on the cables of a cockpit end that does not move. */
static void rest_on_cables(const am_sim *sim, uint32_t item, const loads_t *at, const double *slope,
                           double *q) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const double C = p[P_CIRCUIT_CABLE];
    for (int i = 1; i < circuit_bodies(p); i++) {
        q[i] += (at->on[i] - C * (q[i] - q[0])) / fmax(C - slope[i], LEAST_STIFFNESS * C);
    }
}

static void stretch_cables(am_sim *sim, uint32_t item, double wanted, double *q) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    double move[LINKAGE_BODIES], slope[LINKAGE_BODIES];
    loads_t at;
    set_rigid(move, least_move(p));
    for (int iteration = 0; iteration < SETTLING; iteration++) {
        double before[LINKAGE_BODIES];
        memcpy(before, q, sizeof before);
        probe(sim, item, sim->u, q, move, &at, slope);
        if (sim->controls == FORCE_DRIVEN) meet(sim, item, wanted, &at, slope, q);
        else rest_on_cables(sim, item, &at, slope, q);
        if (memcmp(before, q, sizeof before) == 0) break; /* settled to the last bit */
    }
}

/* The force that holds the circuit at rest at q. */
static double holding_force(am_sim *sim, uint32_t item, const double *q) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    loads_t at;
    circuit_loads(sim, item, sim->x, sim->u, q, circuit_offset(sim, item), &at);
    double force = p[P_CIRCUIT_PRELOAD] * sign_of(q[0] - circuit_neutral(sim, item, sim->u));
    for (int i = 0; i < LINKAGE_BODIES; i++) force -= at.on[i];
    return force;
}

/* What remains of a force that the dry friction of all bodies at rest may hold in part. */
static double beyond_friction(const linkage_t *c, double share, double force) {
    double band = 0.0;
    for (int i = 0; i < c->bodies; i++) band += share * c->breakout[i];
    return force - clamp(force, -band, band);
}

static void start_travel(am_sim *sim, uint32_t item) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const int control = circuit_control(sim->model, item);
    const bool forced = sim->controls == FORCE_DRIVEN;
    double *d = memory_of(sim, G_CIRCUIT, item);
    linkage_t c;
    memset(d, 0, sizeof(double) * D_PER_CIRCUIT);
    const double delta = sim->u[control] + control_bias(sim, control);
    const double even = control == U_DELTA_A ? delta / p[P_CIRCUIT_GEARING]
                                             : surface_travel(p, delta);
    set_rigid(d + D_TRAVEL,
              sim->controls == POSITION_DRIVEN ? cockpit_travel(sim, item, sim->u) : even);
    if (sim->controls == SURFACE_DRIVEN) return;
    circuit_linkage(sim, item, &c);
    hold_between_stops(&c, d + D_TRAVEL);
    d[D_FROM] = d[D_TO] = control_of_travel(sim, item, d + D_TRAVEL);
    d[D_OFFSET] = forced ? control_bias(sim, control) : 0.0;
}

/* At rest: cables stretched by the loads, and in mode 2 the force that the record lacks. */
static void start_at_rest(am_sim *sim, uint32_t item) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const double *u = input_of(sim, sim->u, G_CIRCUIT, item);
    double *d = memory_of(sim, G_CIRCUIT, item);
    double *q = d + D_TRAVEL;
    linkage_t c;
    circuit_linkage(sim, item, &c);
    if (c.bodies > 1) stretch_cables(sim, item, d[D_TO], q);
    hold_between_stops(&c, q);
    d[D_FROM] = d[D_TO] = control_of_travel(sim, item, q);
    if (sim->controls != FORCE_DRIVEN) return;
    const double lacking = holding_force(sim, item, q) - u[U_CIRCUIT_FORCE]
                           - p[P_CIRCUIT_BIAS_FORCE];
    d[D_TRIM_FORCE] = clamp(beyond_friction(&c, p[P_CIRCUIT_TRIM_FRICTION], lacking),
                            -p[P_CIRCUIT_TRIM_LIMIT], p[P_CIRCUIT_TRIM_LIMIT]);
}

void control_start(am_sim *sim) {
    for (uint32_t i = 0; i < circuits(sim); i++) start_travel(sim, i);
    if (!any_moves(sim)) return;
    derivative(sim, sim->x, sim->u, scratch_slope(sim));
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (circuit_moves(sim, i)) start_at_rest(sim, i);
    }
}

#endif

/* ---- a step ---------------------------------------------------------------------------------- */

/* The load of one circuit over a step. */
typedef struct {
    loads_t start, end; /* both at the travel of the start */
    real slope[LINKAGE_BODIES], force[2], neutral[2];
} loading_t;

static void begin_course(flight_t *sim, uint32_t item, double h, const real *u, loading_t *course) {
    const real *d = memory_of(sim, G_CIRCUIT, item);
    const real least = least_move(par_of(sim, G_CIRCUIT, item));
    real move[LINKAGE_BODIES];
    for (int i = 0; i < LINKAGE_BODIES; i++) {
        const real reach = h * d[D_RATE + i];
        move[i] = PICK(size_of(reach) > least, reach, PICK(reach < 0.0, -least, least));
    }
    probe(sim, item, u, d + D_TRAVEL, move, &course->start, course->slope);
    course->force[0] = pilot_force(sim, item, u);
    course->neutral[0] = circuit_neutral(sim, item, u);
}

static void end_course(flight_t *sim, uint32_t item, const real *x, const real *u,
                       loading_t *course) {
    circuit_loads(sim, item, x, u, memory_of(sim, G_CIRCUIT, item) + D_TRAVEL,
                  circuit_offset(sim, item), &course->end);
    course->force[1] = pilot_force(sim, item, u);
    course->neutral[1] = circuit_neutral(sim, item, u);
}

#if LANES == 1

/* The derivative at the start of a step, unless the last call left it. */
static void one_find_start(am_sim *sim, double t, const double *u0) {
    const size_t size = sizeof(double) * (size_t)sim->model->count[AM_INPUT];
    if (sim->fresh && memcmp(u0, sim->u, size) == 0) return;
    sim->part = 0.0;
    sim->clock = t;
    derivative(sim, sim->x, u0, sim->k);
    sim->fresh = false;
}

/* A circuit of one simulation. */
static void one_move_bodies(const flight_t *sim, uint32_t item, double h, const linkage_t *c,
                            motion_t *m) {
    linkage_advance(c, m, h, sub_steps(h, par_of(sim, G_CIRCUIT, item)[P_CIRCUIT_STEP]));
}

#endif

/* Courses of all circuits that move, from the flight at both ends of the step. */
static void find_courses(flight_t *sim, double t, double h, const real *u0, const real *u1,
                         loading_t *course) {
    const int n = am_state_count(sim->model);
    HOOK(find_start)(sim, t, u0);
    for (uint32_t i = 0; i < circuits(sim); i++) {
        real *d = memory_of(sim, G_CIRCUIT, i);
        if (!circuit_moves(sim, i)) continue;
        begin_course(sim, i, h, u0, course + i);
        real there[LINKAGE_BODIES];
        for (int k = 0; k < LINKAGE_BODIES; k++) there[k] = d[D_TRAVEL + k] + h * d[D_RATE + k];
        d[D_TO] = control_of_travel(sim, i, there);
    }
    for (int i = 0; i < n; i++) sim->x_work[i] = sim->x[i] + h * sim->k[i];
    sim->part = 1.0;
    sim->clock = t + h;
    derivative(sim, sim->x_work, u1, scratch_slope(sim));
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (circuit_moves(sim, i)) end_course(sim, i, sim->x_work, u1, course + i);
    }
}

static void set_loads(const flight_t *sim, uint32_t item, double h, const loading_t *course,
                      linkage_t *c) {
    const real *d = memory_of(sim, G_CIRCUIT, item);
    for (int i = 0; i < c->bodies; i++) {
        c->load[i] = course->start.on[i];
        c->load_rate[i] = (course->end.on[i] - course->start.on[i]) / h;
        c->stiffness[i] = -course->slope[i];
        c->origin[i] = d[D_TRAVEL + i];
    }
    c->neutral = 0.5 * (course->neutral[0] + course->neutral[1]);
    if (sim->controls != FORCE_DRIVEN) return;
    c->load[0] += course->force[0];
    c->load_rate[0] += (course->force[1] - course->force[0]) / h;
}

static void advance_bodies(flight_t *sim, uint32_t item, double h, const loading_t *course,
                           real drive) {
    real *d = memory_of(sim, G_CIRCUIT, item);
    linkage_t c;
    motion_t m;
    memset(&m, 0, sizeof m);
    circuit_linkage(sim, item, &c);
    set_loads(sim, item, h, course, &c);
    c.driven = sim->controls == POSITION_DRIVEN;
    c.drive = drive;
    memcpy(m.q, d + D_TRAVEL, sizeof m.q);
    memcpy(m.v, d + D_RATE, sizeof m.v);
    HOOK(move_bodies)(sim, item, h, &c, &m);
    for (int i = 1; i < c.bodies; i++) d[D_ACCELERATION + i] = (m.v[i] - d[D_RATE + i]) / h;
    memcpy(d + D_TRAVEL, m.q, sizeof m.q);
    memcpy(d + D_RATE, m.v, sizeof m.v);
    memcpy(d + D_FRICTION, m.friction, sizeof m.friction);
    memcpy(d + D_STOP, m.stop, sizeof m.stop);
    d[D_TO] = control_of_travel(sim, item, m.q);
}

/* A driven circuit over a step: travel and rate at its end, and the second difference of the travel
 * for the force that accelerates it; none at the start.  Bodies on cables move in between. */
static inline void drive_circuit(flight_t *sim, uint32_t item, double h, real from, real to,
                                 const loading_t *course) {
    real *d = memory_of(sim, G_CIRCUIT, item);
    const real rate = (to - from) / h;
    d[D_ACCELERATION] = PICK(d[D_STEP] > 0.0, 2.0 * (rate - d[D_RATE]) / (h + d[D_STEP]), 0.0);
    d[D_TRAVEL] = from;
    if (course) advance_bodies(sim, item, h, course, rate);
    d[D_TRAVEL] = to;
    d[D_RATE] = rate;
    d[D_STEP] = h;
}

static void advance_circuit(flight_t *sim, uint32_t item, double h, const real *u0, const real *u1,
                            const loading_t *course) {
    if (sim->controls == FORCE_DRIVEN) {
        advance_bodies(sim, item, h, course, (real)0.0);
        memory_of(sim, G_CIRCUIT, item)[D_STEP] = h;
        return;
    }
    const real from = driven_travel(sim, item, u0);
    const real to = u1 == u0 ? from : driven_travel(sim, item, u1);
    drive_circuit(sim, item, h, from, to, circuit_moves(sim, item) ? course : NULL);
}

static void advance_all(flight_t *sim, double t, double h, const real *u0, const real *u1) {
    loading_t course[MAX_CIRCUITS];
    if (any_moves(sim)) find_courses(sim, t, h, u0, u1, course);
    for (uint32_t i = 0; i < circuits(sim); i++) advance_circuit(sim, i, h, u0, u1, course + i);
}

void control_advance(flight_t *sim, double t, double h, const real *u0, const real *u1) {
    if (!circuits(sim) || !(h > 0.0)) return;
    const uint32_t n = circuits(sim);
    for (uint32_t i = 0; i < n; i++) {
        real *d = memory_of(sim, G_CIRCUIT, i);
        d[D_FROM] = d[D_TO];
    }
    if (sim->controls != SURFACE_DRIVEN) {
        advance_all(sim, t, h, u0, u1);
        return;
    }
    for (uint32_t i = 0; i < n; i++) {
        const real from = recorded_travel(sim, i, u0);
        const real to = u1 == u0 ? from : recorded_travel(sim, i, u1);
        drive_circuit(sim, i, h, from, to, NULL);
    }
}
