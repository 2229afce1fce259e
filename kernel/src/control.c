/* Control circuits in the simulation: what drives them, their way through a step, forces and
 * outputs.
 *
 *     mode.controls 0   recorded surfaces drive; travel and the force that holds them follow
 *                   1   recorded cockpit positions drive; beyond order 2 cables move the surfaces
 *                   2   recorded pilot forces drive
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
 * *.trim_limit. */
#include "control.h"

#include "control_loads.h"

#include <math.h>
#include <string.h>

#define PROBE 1e-4  /* least part of the travel over which the slope of the load is taken */
#define SETTLING 12 /* iterations of the cable stretch at the start */
/* of a cable less what the air takes from it, in parts of the cable: holds the iteration
 * together */
#define LEAST_STIFFNESS 0.1
#define LARGEST 1e9    /* of any constant, so that no product of them overflows */
#define MOST_PARTS 1e6 /* sub-steps of one step */

static double limited(double x, double low, double high) {
    return x < low ? low : x > high ? high : x;
}

static double sign(double x) { return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : 0.0; }

static uint32_t circuits(const am_sim *sim) { return items(sim->model, G_CIRCUIT); }

/* ---- parameters ------------------------------------------------------------------------------ */

static int refuse(am_sim *sim, const double *parameter, const char *rule) {
    return bad_parameter(sim, (uint32_t)(parameter - sim->par), rule);
}

static bool order_fits(int control, double order) {
    return order == 2.0 || order == 4.0 || (control == U_DELTA_A && order == 6.0);
}

static int check_values(am_sim *sim, const double *p) {
    static const int POSITIVE[] = {P_CIRCUIT_MASS, P_CIRCUIT_STEP, P_CIRCUIT_S_HINGE,
                                   P_CIRCUIT_C_HINGE};
    static const int NOT_NEGATIVE[] = {
        P_CIRCUIT_INERTIA,       P_CIRCUIT_DAMPING,        P_CIRCUIT_HINGE_DAMPING,
        P_CIRCUIT_STIFFNESS,     P_CIRCUIT_PRELOAD,        P_CIRCUIT_FRICTION,
        P_CIRCUIT_STICTION,      P_CIRCUIT_HINGE_FRICTION, P_CIRCUIT_CABLE,
        P_CIRCUIT_CABLE_DAMPING, P_CIRCUIT_TRIM_LIMIT};
    for (size_t k = 0; k < sizeof POSITIVE / sizeof *POSITIVE; k++) {
        if (!(p[POSITIVE[k]] >= 1.0 / LARGEST)) {
            return refuse(sim, p + POSITIVE[k], "at least 1e-9");
        }
    }
    for (size_t k = 0; k < sizeof NOT_NEGATIVE / sizeof *NOT_NEGATIVE; k++) {
        if (!(p[NOT_NEGATIVE[k]] >= 0.0)) {
            return refuse(sim, p + NOT_NEGATIVE[k], "zero or positive");
        }
    }
    for (int code = 0; code < P_PER_CIRCUIT; code++) {
        if (code != P_CIRCUIT_TRIM_LIMIT && !(fabs(p[code]) <= LARGEST)) {
            return refuse(sim, p + code, "between -1e9 and 1e9");
        }
    }
    if (!(p[P_CIRCUIT_STEP] >= 1e-6)) return refuse(sim, p + P_CIRCUIT_STEP, "at least 1e-6 s");
    const double e = p[P_CIRCUIT_RESTITUTION];
    if (!(e >= 0.0 && e <= 1.0)) return refuse(sim, p + P_CIRCUIT_RESTITUTION, "between 0 and 1");
    return AM_OK;
}

static int check_geometry(am_sim *sim, uint32_t item) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const double G = p[P_CIRCUIT_GEARING];
    if (!(fabs(G) >= 1e-6)) return refuse(sim, p + P_CIRCUIT_GEARING, "other than zero");
    if (!(p[P_CIRCUIT_LOW] < p[P_CIRCUIT_HIGH])) {
        return refuse(sim, p + P_CIRCUIT_LOW, "below stop_high");
    }
    if (!(p[P_CIRCUIT_DELTA_LOW] < p[P_CIRCUIT_DELTA_HIGH])) {
        return refuse(sim, p + P_CIRCUIT_DELTA_LOW, "below delta_high");
    }
    const double reach = fmax(fabs(p[P_CIRCUIT_LOW]), fabs(p[P_CIRCUIT_HIGH]));
    if (!(fabs(p[P_CIRCUIT_GEARING_SLOPE]) * reach < 0.9 * fabs(G))) {
        return refuse(sim, p + P_CIRCUIT_GEARING_SLOPE,
                      "so small that the gearing keeps a tenth of itself up to the stops");
    }
    const bool cable = circuit_bodies(p) > 1;
    if (cable && !(p[P_CIRCUIT_CABLE] > 0.0)) {
        return refuse(sim, p + P_CIRCUIT_CABLE, "positive when the order is 4 or 6");
    }
    if (cable && !(p[P_CIRCUIT_INERTIA] * G * G >= 1.0 / LARGEST)) {
        return refuse(sim, p + P_CIRCUIT_INERTIA, "positive when the order is 4 or 6");
    }
    linkage_t c;
    circuit_linkage(sim, item, &c);
    for (int i = 0; i < c.bodies; i++) {
        if (!(c.low[i] < c.high[i])) {
            return refuse(sim, p + P_CIRCUIT_DELTA_LOW,
                          "such that the surface and the stops leave some travel");
        }
    }
    return AM_OK;
}

int control_check(am_sim *sim) {
    for (uint32_t i = 0; i < circuits(sim); i++) {
        const double *p = par_of(sim, G_CIRCUIT, i);
        const int control = circuit_control(sim->model, i);
        if (control < 0 || i >= MAX_CIRCUITS) {
            return fail(sim, AM_BAD_VALUE, "circuit %s is unknown; allowed: column, wheel, pedal",
                        sim->model->item[G_CIRCUIT][i]);
        }
        if (!order_fits(control, p[P_CIRCUIT_ORDER])) {
            return refuse(sim, p + P_CIRCUIT_ORDER, control == U_DELTA_A ? "2, 4 or 6" : "2 or 4");
        }
        int status = check_values(sim, p);
        if (status == AM_OK) status = check_geometry(sim, i);
        if (status != AM_OK) return status;
    }
    return AM_OK;
}

/* ---- deflections ----------------------------------------------------------------------------- */

/* Biases that the core adds to the deflection of a control. */
static double added(const am_sim *sim, int control) {
    return sim->par[P_BIAS_DELTA_E + control] + sim->trim.delta[control];
}

/* What the air sees beyond the deflection of the linkage. */
static double offset_of(const am_sim *sim, uint32_t item) {
    if (sim->controls == SURFACE_DRIVEN) return 0.0;
    return added(sim, circuit_control(sim->model, item))
           - memory_of(sim, G_CIRCUIT, item)[D_OFFSET];
}

static double cockpit_travel(const am_sim *sim, uint32_t item, const double *u) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    return limited(input_of(sim, u, G_CIRCUIT, item)[U_CIRCUIT_TRAVEL], p[P_CIRCUIT_LOW],
                   p[P_CIRCUIT_HIGH]);
}

static void set_rigid(double *q, double s) {
    for (int i = 0; i < LINKAGE_BODIES; i++) q[i] = s;
}

static bool rigid_drive(const am_sim *sim, uint32_t item) {
    return sim->controls == POSITION_DRIVEN && circuit_bodies(par_of(sim, G_CIRCUIT, item)) == 1;
}

double control_deflection(const am_sim *sim, const double *u, int control) {
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (circuit_control(sim->model, i) != control) continue;
        const double *d = memory_of(sim, G_CIRCUIT, i);
        double q[LINKAGE_BODIES];
        set_rigid(q, cockpit_travel(sim, i, u));
        if (rigid_drive(sim, i)) return control_of_travel(sim, i, q);
        return d[D_FROM] + sim->part * (d[D_TO] - d[D_FROM]) - d[D_OFFSET];
    }
    return u[control];
}

/* ---- start ----------------------------------------------------------------------------------- */

static void hold_between_stops(const linkage_t *c, double *q) {
    for (int i = 0; i < c->bodies; i++) q[i] = limited(q[i], c->low[i], c->high[i]);
}

/* Loads at q and their slope along the travel of each body. */
static void probe(am_sim *sim, uint32_t item, const double *u, const double *q, const double *move,
                  loads_t *at, double *slope) {
    const double offset = offset_of(sim, item);
    double there[LINKAGE_BODIES];
    loads_t beyond;
    for (int i = 0; i < LINKAGE_BODIES; i++) there[i] = q[i] + move[i];
    circuit_loads(sim, item, sim->x, u, q, offset, at);
    circuit_loads(sim, item, sim->x, u, there, offset, &beyond);
    for (int i = 0; i < LINKAGE_BODIES; i++) slope[i] = (beyond.on[i] - at->on[i]) / move[i];
}

static double least_move(const double *p) { return PROBE * (p[P_CIRCUIT_HIGH] - p[P_CIRCUIT_LOW]); }

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

/* Let the surfaces hang at rest on the cables of a cockpit end that stays where it is. */
static void hang(const am_sim *sim, uint32_t item, const loads_t *at, const double *slope,
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
        probe(sim, item, sim->u, q, move, &at, slope);
        if (sim->controls == FORCE_DRIVEN) meet(sim, item, wanted, &at, slope, q);
        else hang(sim, item, &at, slope, q);
    }
}

/* The force that holds the circuit at rest at q. */
static double holding_force(am_sim *sim, uint32_t item, const double *q) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    loads_t at;
    circuit_loads(sim, item, sim->x, sim->u, q, offset_of(sim, item), &at);
    double force = p[P_CIRCUIT_PRELOAD] * sign(q[0] - circuit_neutral(sim, item, sim->u));
    for (int i = 0; i < LINKAGE_BODIES; i++) force -= at.on[i];
    return force;
}

static void start_travel(am_sim *sim, uint32_t item) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const int control = circuit_control(sim->model, item);
    const bool forced = sim->controls == FORCE_DRIVEN;
    double *d = memory_of(sim, G_CIRCUIT, item);
    linkage_t c;
    memset(d, 0, sizeof(double) * D_PER_CIRCUIT);
    const double delta = sim->u[control] + added(sim, control);
    const double even = control == U_DELTA_A ? delta / p[P_CIRCUIT_GEARING]
                                             : surface_travel(p, delta);
    set_rigid(d + D_TRAVEL,
              sim->controls == POSITION_DRIVEN ? cockpit_travel(sim, item, sim->u) : even);
    if (sim->controls == SURFACE_DRIVEN) return;
    circuit_linkage(sim, item, &c);
    hold_between_stops(&c, d + D_TRAVEL);
    d[D_FROM] = d[D_TO] = control_of_travel(sim, item, d + D_TRAVEL);
    d[D_OFFSET] = forced ? added(sim, control) : 0.0;
}

/* At rest: cables stretched by the loads, and in mode 2 the force that the record lacks. */
static void settle(am_sim *sim, uint32_t item) {
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
    d[D_TRIM_FORCE] = limited(lacking, -p[P_CIRCUIT_TRIM_LIMIT], p[P_CIRCUIT_TRIM_LIMIT]);
}

static double *scratch_slope(const am_sim *sim) { return sim->k + am_state_count(sim->model); }

/* A circuit whose bodies move by their own equations. */
static bool moves(const am_sim *sim, uint32_t item) {
    return sim->controls != SURFACE_DRIVEN && !rigid_drive(sim, item);
}

static bool any_moves(const am_sim *sim) {
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (moves(sim, i)) return true;
    }
    return false;
}

void control_start(am_sim *sim, double t) {
    (void)t;
    for (uint32_t i = 0; i < circuits(sim); i++) start_travel(sim, i);
    if (!any_moves(sim)) return;
    derivative(sim, sim->x, sim->u, scratch_slope(sim));
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (moves(sim, i)) settle(sim, i);
    }
}

/* ---- a step ---------------------------------------------------------------------------------- */

/* The load of one circuit over a step. */
typedef struct {
    loads_t start, end; /* both at the travel of the start */
    double slope[LINKAGE_BODIES], force[2], neutral[2];
} course_t;

static double pilot_force(const am_sim *sim, uint32_t item, const double *u) {
    return input_of(sim, u, G_CIRCUIT, item)[U_CIRCUIT_FORCE]
           + par_of(sim, G_CIRCUIT, item)[P_CIRCUIT_BIAS_FORCE]
           + memory_of(sim, G_CIRCUIT, item)[D_TRIM_FORCE];
}

static void begin_course(am_sim *sim, uint32_t item, double h, const double *u, course_t *course) {
    const double *d = memory_of(sim, G_CIRCUIT, item);
    const double least = least_move(par_of(sim, G_CIRCUIT, item));
    double move[LINKAGE_BODIES];
    for (int i = 0; i < LINKAGE_BODIES; i++) {
        const double reach = h * d[D_RATE + i];
        move[i] = fabs(reach) > least ? reach : reach < 0.0 ? -least : least;
    }
    probe(sim, item, u, d + D_TRAVEL, move, &course->start, course->slope);
    course->force[0] = pilot_force(sim, item, u);
    course->neutral[0] = circuit_neutral(sim, item, u);
}

static void end_course(am_sim *sim, uint32_t item, const double *x, const double *u,
                       course_t *course) {
    circuit_loads(sim, item, x, u, memory_of(sim, G_CIRCUIT, item) + D_TRAVEL, offset_of(sim, item),
                  &course->end);
    course->force[1] = pilot_force(sim, item, u);
    course->neutral[1] = circuit_neutral(sim, item, u);
}

/* Courses of all circuits that move, from the flight at both ends of the step. */
static void find_courses(am_sim *sim, double t, double h, const double *u0, const double *u1,
                         course_t *course) {
    const int n = am_state_count(sim->model);
    if (!sim->fresh
        || memcmp(u0, sim->u, sizeof(double) * (size_t)sim->model->count[AM_INPUT]) != 0) {
        sim->part = 0.0;
        sim->clock = t;
        derivative(sim, sim->x, u0, sim->k);
        sim->fresh = false;
    }
    for (uint32_t i = 0; i < circuits(sim); i++) {
        double *d = memory_of(sim, G_CIRCUIT, i);
        if (!moves(sim, i)) continue;
        begin_course(sim, i, h, u0, course + i);
        double there[LINKAGE_BODIES];
        for (int k = 0; k < LINKAGE_BODIES; k++) there[k] = d[D_TRAVEL + k] + h * d[D_RATE + k];
        d[D_TO] = control_of_travel(sim, i, there);
    }
    for (int i = 0; i < n; i++) sim->x_work[i] = sim->x[i] + h * sim->k[i];
    sim->part = 1.0;
    sim->clock = t + h;
    derivative(sim, sim->x_work, u1, scratch_slope(sim));
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (moves(sim, i)) end_course(sim, i, sim->x_work, u1, course + i);
    }
}

static void set_loads(const am_sim *sim, uint32_t item, double h, const course_t *course,
                      linkage_t *c) {
    const double *d = memory_of(sim, G_CIRCUIT, item);
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

/* Second difference of a driven travel, for the force that accelerates it; none at the start. */
static double acceleration(const double *d, double rate, double h) {
    return d[D_STEP] > 0.0 ? 2.0 * (rate - d[D_RATE]) / (h + d[D_STEP]) : 0.0;
}

static void advance_bodies(am_sim *sim, uint32_t item, double h, const course_t *course,
                           double drive) {
    double *d = memory_of(sim, G_CIRCUIT, item);
    linkage_t c;
    motion_t m = {0};
    circuit_linkage(sim, item, &c);
    set_loads(sim, item, h, course, &c);
    c.driven = sim->controls == POSITION_DRIVEN;
    c.drive = drive;
    memcpy(m.q, d + D_TRAVEL, sizeof m.q);
    memcpy(m.v, d + D_RATE, sizeof m.v);
    linkage_advance(&c, &m, h,
                    (int)limited(ceil(h / par_of(sim, G_CIRCUIT, item)[P_CIRCUIT_STEP] - 1e-9), 1.0,
                                 MOST_PARTS));
    for (int i = 1; i < c.bodies; i++) d[D_ACCELERATION + i] = (m.v[i] - d[D_RATE + i]) / h;
    memcpy(d + D_TRAVEL, m.q, sizeof m.q);
    memcpy(d + D_RATE, m.v, sizeof m.v);
    memcpy(d + D_FRICTION, m.friction, sizeof m.friction);
    memcpy(d + D_STOP, m.stop, sizeof m.stop);
    d[D_TO] = control_of_travel(sim, item, m.q);
}

/* Travel of the cockpit end of a circuit that is driven, mode 0 or 1. */
static double driven_travel(const am_sim *sim, uint32_t item, const double *u) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const int control = circuit_control(sim->model, item);
    if (sim->controls == POSITION_DRIVEN) return cockpit_travel(sim, item, u);
    const double delta = applied(sim, u, control);
    return control == U_DELTA_A ? delta / p[P_CIRCUIT_GEARING] : surface_travel(p, delta);
}

static void advance_circuit(am_sim *sim, uint32_t item, double h, const double *u0,
                            const double *u1, const course_t *course) {
    double *d = memory_of(sim, G_CIRCUIT, item);
    if (sim->controls == FORCE_DRIVEN) {
        advance_bodies(sim, item, h, course, 0.0);
    } else {
        const double from = driven_travel(sim, item, u0);
        const double to = driven_travel(sim, item, u1);
        const double rate = (to - from) / h;
        d[D_ACCELERATION] = acceleration(d, rate, h);
        d[D_TRAVEL] = from;
        if (moves(sim, item)) advance_bodies(sim, item, h, course, rate);
        d[D_TRAVEL] = to;
        d[D_RATE] = rate;
    }
    d[D_STEP] = h;
}

void control_advance(am_sim *sim, double t, double h, const double *u0, const double *u1) {
    course_t course[MAX_CIRCUITS];
    if (!circuits(sim) || !(h > 0.0)) return;
    for (uint32_t i = 0; i < circuits(sim); i++) {
        double *d = memory_of(sim, G_CIRCUIT, i);
        d[D_FROM] = d[D_TO];
    }
    if (any_moves(sim)) find_courses(sim, t, h, u0, u1, course);
    for (uint32_t i = 0; i < circuits(sim); i++) advance_circuit(sim, i, h, u0, u1, course + i);
}

/* ---- outputs --------------------------------------------------------------------------------- */

/* Inertia, dampers and friction on a body of a circuit that is driven, against its motion. */
static double resistance(const linkage_t *c, const double *d, int i, double friction) {
    return c->mass[i] * d[D_ACCELERATION + i] + c->damping[i] * d[D_RATE + i] + friction;
}

/* Bodies of a driven circuit: their friction, and in mode 0 the cockpit end and the rates of the
 * other bodies. */
static void complete(const am_sim *sim, const linkage_t *c, const loads_t *at, double *d) {
    const bool surfaces = sim->controls == SURFACE_DRIVEN;
    for (int i = 0; i < c->bodies; i++) {
        if (surfaces) {
            d[D_RATE + i] = d[D_RATE];
            d[D_ACCELERATION + i] = d[D_ACCELERATION];
        }
        if (surfaces || i == 0) {
            d[D_FRICTION + i] = c->friction[i] * sign(d[D_RATE + i]);
            d[D_STOP + i] = 0.0;
        }
    }
    if (!surfaces || c->bodies == 1) return;
    double stretch = 0.0;
    for (int i = 1; i < c->bodies; i++) {
        stretch += (resistance(c, d, i, d[D_FRICTION + i]) - at->on[i]) / c->cable_stiffness
                   / (c->bodies - 1);
    }
    d[D_TRAVEL] += stretch;
}

static void write_circuit(am_sim *sim, uint32_t item, double *y) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    double d[D_PER_CIRCUIT];
    double *to = output_of(sim, y, G_CIRCUIT, item);
    linkage_t c;
    loads_t at;
    memcpy(d, memory_of(sim, G_CIRCUIT, item), sizeof d);
    circuit_linkage(sim, item, &c);
    if (!moves(sim, item)) set_rigid(d + D_TRAVEL, driven_travel(sim, item, sim->u));
    to[Y_CIRCUIT_DEFLECTION] = control_of_travel(sim, item, d + D_TRAVEL);
    to[Y_CIRCUIT_SYMMETRIC] = symmetric_deflection(sim, item, d + D_TRAVEL);
    circuit_loads(sim, item, sim->x, sim->u, d + D_TRAVEL, offset_of(sim, item), &at);
    double force = pilot_force(sim, item, sim->u);
    double friction = 0.0;
    double stop = 0.0;
    if (sim->controls != FORCE_DRIVEN) {
        complete(sim, &c, &at, d);
        force = p[P_CIRCUIT_PRELOAD] * sign(d[D_TRAVEL] - circuit_neutral(sim, item, sim->u));
        for (int i = 0; i < c.bodies; i++) {
            force += resistance(&c, d, i, d[D_FRICTION + i]) - at.on[i];
        }
        if (sim->controls == SURFACE_DRIVEN) {
            force += p[P_CIRCUIT_STIFFNESS] * (d[D_TRAVEL] - driven_travel(sim, item, sim->u));
        }
    }
    for (int i = 0; i < c.bodies; i++) {
        friction += d[D_FRICTION + i];
        stop += d[D_STOP + i];
    }
    to[Y_CIRCUIT_TRAVEL] = d[D_TRAVEL];
    to[Y_CIRCUIT_RATE] = d[D_RATE];
    to[Y_CIRCUIT_FORCE] = force;
    to[Y_CIRCUIT_HINGE_MOMENT] = at.hinge_moment;
    to[Y_CIRCUIT_F_AER] = at.aero;
    to[Y_CIRCUIT_F_G] = at.mass;
    to[Y_CIRCUIT_F_NOSE] = at.nose;
    to[Y_CIRCUIT_F_COUL] = friction;
    to[Y_CIRCUIT_F_STOP] = stop;
    to[Y_CIRCUIT_TRIM_FORCE] = d[D_TRIM_FORCE];
}

void control_outputs(am_sim *sim, double *y) {
    for (uint32_t i = 0; i < circuits(sim); i++) write_circuit(sim, i, y);
}
