/* Landing gear: legs, wheels and skids on a level runway at env.runway_elevation.
 *
 * In the order of LR-743 4.5.4: deflections and their rates, vertical forces, then side and
 * longitudinal forces (tyre.c), steering (steering.c).  A leg with tyre_stiffness is a strut in
 * series with a tyre, without unsprung mass:
 *
 *     F = tyre_stiffness (deflection - s)        zero when negative: the ground never pulls
 *     F = preload + stiffness s + table + damping s' + orifice s' |s'|
 *                                                solved for s', between the stops 0 and stroke
 *
 * with own damping constants in extension; without tyre_stiffness (a rigid wheel, a skid) s is
 * the deflection itself. Legs stand along body z: rake and friction of the strut and the inertia
 * of the wheel are not there. */
#include "gear.h"

#include "algebra.h"
#include "elementary_real.h"
#include "four.h"
#include "steering.h"
#include "terms.h"
#include "tyre.h"

#include <math.h>
#include <string.h>

/* shortest time constant of strut and tyre: holds the rate of s below 1 / STRUT_LAG [s] */
#define STRUT_LAG 0.01
#define STOP_LAG 0.02     /* in which a strut reaches its stop [s] */
#define FASTEST_WET 103.0 /* the wet polynomial ends here: 200 kt [m s-1] */
/* part above the greatest friction over which an excess of brake locks the wheel */
#define LOCKING 0.1
#define UPRIGHT 1e-3 /* floor of the length of the heading in the ground plane */
/* floor of the cosine between leg and vertical: beyond 78 deg the leg is as stiff as there */
#define LEANING 0.2
/* for the load and the forces in the plane that depend on each other through the lean of the leg */
#define PASSES 3
#define NOTHING 1e-9    /* a deflection that is none [m] */
#define SLIP_FLOOR 1e-3 /* below it the slip angle is zero [m s-1] */
#define BISECTIONS 52   /* halvings of a stroke: to rounding */

/* Those of `clear` whose n deflections are none. */
static inline mask_t all_nothing(const real *own, uint32_t n, mask_t clear) {
    uint32_t k = 0;
#if LANES == 1
    four_counts some = {0};
    for (; k + 4 <= n; k += 4) some |= (AT(own + k) > NOTHING) | (AT(own + k) < -NOTHING);
    clear &= !((some[0] | some[1]) | (some[2] | some[3]));
#endif
    for (; k < n && ANY(clear); k++) clear &= NOT(size_of(own[k]) > NOTHING);
    return clear;
}

/* True when nothing can touch the ground at any attitude and every strut and tyre is back at its
 * free length. */
mask_t gear_clear(const flight_t *sim, const real *x) {
    const uint32_t n = items(sim->model, G_CONTACT);
    const real *cg = sim->now.cg;
    const real height = sim->now.h - sim->par[P_RUNWAY] - size_of(cg[0]) - size_of(cg[1])
                        - size_of(cg[2]);
    return all_nothing(state_of(sim, x, G_CONTACT, 0), n * X_PER_CONTACT, NOT(height < sim->reach));
}

static inline void stand_still(real *rate, uint32_t n) {
    uint32_t i = 0;
#if LANES == 1
    for (; i + 4 <= n; i += 4) PUT(rate + i) = (four){0.0};
#endif
    for (; i < n; i++) rate[i] = 0.0;
}

/* Away from the ground only the steering moves. */
void gear_off_ground(flight_t *sim, const real *x, const real *u, real *dx) {
    const steered_t airborne = {.side = 0.0};
    const uint32_t n = items(sim->model, G_CONTACT);
    real *found = work_of(sim, G_GEAR, 0);
    stand_still(rate_of(sim, dx, G_CONTACT, 0), X_PER_CONTACT * n);
    if (!sim->off_ground) {
        memset(work_of(sim, G_CONTACT, 0), 0, sizeof(real) * W_PER_CONTACT * n);
        memset(found, 0, sizeof *found * W_PER_GEAR);
        for (uint32_t i = 0; i < n; i++) var_of(sim, G_CONTACT, i)[A_CONTACT_COMPRESSION] = 0.0;
        sim->off_ground = true;
    }
    evaluate_stage(sim, STAGE_GEAR);
    found[Y_GEAR_STEERING] = steering_angle(sim, x);
    found[Y_GEAR_STEERING_MOMENT] = steering_derivative(sim, x, u, &airborne, dx);
}

void gear_outputs(const flight_t *sim, real *y) {
    if (!items(sim->model, G_GEAR)) return;
    memcpy(output_of(sim, y, G_GEAR, 0), work_of(sim, G_GEAR, 0), sizeof(real) * Y_PER_GEAR);
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
        memcpy(output_of(sim, y, G_CONTACT, i), work_of(sim, G_CONTACT, i),
               sizeof(real) * Y_PER_CONTACT);
    }
}

typedef struct {
    real arm[3];               /* from the c.g. to the point on the ground */
    real deflection, sink;     /* of leg and tyre together along the leg, and its rate */
    real forward[3], right[3]; /* wheel axes in the ground plane */
    /* velocity of the point over ground in wheel axes, and their rate of turn */
    real v[2], turn;
    real upright; /* cosine between leg and vertical */
} place_t;

typedef struct {
    footprint_t print;
    real brake; /* that the anti-skid system lets through */
} contact_t;

/* Where the leg, along body z, meets the runway.  The tyre is round in the plane of symmetry:
 * pitch moves its lowest point along the rim.  Velocity is that of the point where the leg
 * stands, a function of the attitude and height alone: so a wheel held by friction comes back to
 * its place whatever the aircraft on it does. */
static void place_contact(const flight_t *sim, const real *p, const real down[3],
                          const real ground[3], real angle, place_t *at) {
    const now_r *now = &sim->now;
    const real R = p[P_CONTACT_RADIUS];
    const real in_plane = larger(root(down[0] * down[0] + down[2] * down[2]), (real)UPRIGHT);
    const real rim[3] = {R * down[0] / in_plane, (real)0.0, R * (down[2] / in_plane - 1.0)};
    real heading[3] = {(real)1.0, angle, (real)0.0}; /* straight ahead */
    if (ANY(angle != 0.0)) SINCOS(angle, &heading[1], &heading[0]);
    const real across = dot(heading, down);
    real velocity[3], spin[3];
    real level = 0.0;
    /* from the lowest point of the rim along the leg to the runway */
    at->upright = larger(down[2], (real)LEANING);
    for (int i = 0; i < 3; i++) at->arm[i] = p[P_CONTACT_X + i] + rim[i] - now->cg[i];
    at->deflection = (dot(at->arm, down) - (now->h - sim->par[P_RUNWAY])) / at->upright;
    at->arm[2] -= at->deflection;
    /* wheel axes: heading without its part along down, and down x forward */
    for (int i = 0; i < 3; i++) {
        at->forward[i] = heading[i] - across * down[i];
        level += at->forward[i] * at->forward[i];
    }
    level = larger(root(level), (real)UPRIGHT);
    for (int i = 0; i < 3; i++) at->forward[i] /= level;
    cross(down, at->forward, at->right);
    /* velocity of the point over ground: v + w x arm, less what moves along the leg */
    cross(now->rate, heading, spin);
    cross(now->rate, at->arm, velocity);
    for (int i = 0; i < 3; i++) velocity[i] += ground[i];
    at->sink = dot(velocity, down) / at->upright;
    velocity[2] -= at->sink;
    at->v[0] = dot(velocity, at->forward);
    at->v[1] = dot(velocity, at->right);
    at->turn = dot(spin, at->right) / level;
}

static real strut_spring(const flight_t *sim, uint32_t i, real s) {
    const real *p = par_of(sim, G_CONTACT, i);
    return p[P_CONTACT_PRELOAD] + p[P_CONTACT_STIFFNESS] * s
           + sum_of(sim, G_CONTACT, i)[T_CONTACT_STRUT];
}

/* s' from damping s' + orifice s' |s'| = force, then inside the stops. */
static real strut_rate(const real *p, real s, real force) {
    const mask_t in = force >= 0.0;
    const real orifice = PICK(in, p[P_CONTACT_ORIFICE], p[P_CONTACT_ORIFICE_EXT]);
    const real c = larger(PICK(in, p[P_CONTACT_DAMPING], p[P_CONTACT_DAMPING_EXT]),
                          (p[P_CONTACT_TYRE] + p[P_CONTACT_STIFFNESS]) * STRUT_LAG);
    const real rate = 2.0 * force / (c + root(c * c + 4.0 * orifice * size_of(force)));
    return clamp(rate, -s / STOP_LAG, larger(p[P_CONTACT_STROKE] - s, (real)0.0) / STOP_LAG);
}

/* Force of a rigid wheel or a skid. */
static real rigid_force(const flight_t *sim, uint32_t i, const place_t *at) {
    const real *p = par_of(sim, G_CONTACT, i);
    const mask_t in = at->sink >= 0.0;
    const real c = PICK(in, p[P_CONTACT_DAMPING], p[P_CONTACT_DAMPING_EXT]);
    const real orifice = PICK(in, p[P_CONTACT_ORIFICE], p[P_CONTACT_ORIFICE_EXT]);
    const real force = strut_spring(sim, i, at->deflection)
                       + (c + orifice * size_of(at->sink)) * at->sink;
    return PICK(at->deflection > 0.0, larger(force, (real)0.0), 0.0);
}

/* Force along a leg that is out; sets the rate of s. */
static real leg_force(const flight_t *sim, uint32_t i, const place_t *at, real s, real *rate) {
    const real *p = par_of(sim, G_CONTACT, i);
    const mask_t rigid = NOT(p[P_CONTACT_TYRE] > 0.0);
    real force = 0.0;
    *rate = -s / STOP_LAG;
    if (!EVERY(rigid)) {
        force = p[P_CONTACT_TYRE] * larger(at->deflection - s, (real)0.0);
        *rate = PICK(rigid, *rate, strut_rate(p, s, force - strut_spring(sim, i, s)));
    }
    return ANY(rigid) ? PICK(rigid, rigid_force(sim, i, at), force) : force;
}

/* Compression of the strut, as its transducer shows it. */
static real compression(const real *p, real s, real deflection) {
    return PICK(p[P_CONTACT_TYRE] > 0.0, s, larger(deflection, (real)0.0));
}

static real runway_friction(const real *p, real speed) {
    const mask_t dry = p[P_RUNWAY_CONDITION] == (double)DRY;
    if (EVERY(dry)) return p[P_MU_DRY];
    const real V = smaller(speed, (real)FASTEST_WET);
    const real wet = larger(
        p[P_MU_WET_0] + V * (p[P_MU_WET_1] + V * (p[P_MU_WET_2] + V * p[P_MU_WET_3])), (real)0.0);
    const mask_t icy = p[P_RUNWAY_CONDITION] == (double)ICY;
    return PICK(dry, p[P_MU_DRY], PICK(icy, p[P_MU_ICY], wet));
}

static real brake_pedal(const real *u, real y) {
    const real left = clamp(u[U_BRAKE_LEFT], (real)0.0, (real)1.0);
    const real right = clamp(u[U_BRAKE_RIGHT], (real)0.0, (real)1.0);
    return PICK(y < 0.0, left, PICK(y > 0.0, right, 0.5 * (left + right)));
}

/* Brake force that the anti-skid system lets through, and what it does to the friction when the
 * wheel locks. */
static real set_friction(const real *gear, const real *p, real pedal, real speed, tyre_t *tyre) {
    tyre->mu = runway_friction(gear, speed);
    const real grip = tyre->mu * tyre->load;
    real brake = pedal * (p[P_CONTACT_BRAKE] + p[P_CONTACT_BRAKE_FRICTION] * tyre->load);
    brake = PICK(gear[P_ANTISKID] > 0.0, smaller(brake, gear[P_ANTISKID] * tyre->mu * tyre->load),
                 brake);
    tyre->brake = brake + p[P_CONTACT_ROLLING] * tyre->load;
    const real excess = tyre->brake - grip;
    const mask_t skids = excess > 0.0;
    if (!ANY(skids)) return brake;
    const real locked = PICK(excess > LOCKING * grip, 1.0, excess / (LOCKING * grip));
    tyre->mu *= 1.0 - (1.0 - gear[P_SKID_RATIO]) * PICK(skids, locked, 0.0);
    return brake;
}

static void contact_outputs(const real *p, real s, const place_t *at, const tyre_t *tyre,
                            const contact_t *contact, real *found) {
    const real speed = root(at->v[0] * at->v[0] + at->v[1] * at->v[1]);
    const mask_t slips = (tyre->load > 0.0) & (speed > SLIP_FLOOR);
    found[Y_CONTACT_WOW] = PICK(tyre->load > 0.0, 1.0, 0.0);
    found[Y_CONTACT_COMPRESSION] = compression(p, s, at->deflection);
    found[Y_CONTACT_TYRE] = PICK(p[P_CONTACT_TYRE] > 0.0, larger(at->deflection - s, (real)0.0),
                                 0.0);
    found[Y_CONTACT_FX] = contact->print.F[0];
    found[Y_CONTACT_FY] = contact->print.F[1];
    found[Y_CONTACT_FZ] = tyre->load;
    found[Y_CONTACT_SLIP] = 0.0;
    if (ANY(slips)) {
        found[Y_CONTACT_SLIP] = PICK(slips, ATAN2(at->v[1], size_of(at->v[0])), 0.0);
    }
    found[Y_CONTACT_BRAKE] = contact->brake;
}

/* Friction, brake and cornering stiffness of a wheel or a skid under its load. */
static void set_tyre(const flight_t *sim, const real *p, real pedal, real speed, tyre_t *tyre,
                     contact_t *found) {
    const mask_t skid = NOT(p[P_CONTACT_FRICTION] == 0.0);
    tyre->mu = p[P_CONTACT_FRICTION];
    tyre->brake = INFINITY;
    tyre->cornering = found->brake = 0.0;
    if (EVERY(skid)) return;
    tyre_t wheel = *tyre;
    const real brake = set_friction(par_of(sim, G_GEAR, 0), p, pedal, speed, &wheel);
    const real cornering = cornering_stiffness(p[P_CONTACT_CORNERING], p[P_CONTACT_CORNERING_LOAD],
                                               tyre->load);
    tyre->mu = PICK(skid, tyre->mu, wheel.mu);
    tyre->brake = PICK(skid, tyre->brake, wheel.brake);
    tyre->cornering = PICK(skid, tyre->cornering, cornering);
    found->brake = PICK(skid, found->brake, brake);
}

/* The leg carries what its spring and damper push and what the ground pushes along it: Fz from
 * the balance of the wheel along the leg, with the forces in the ground plane that depend on it
 * in turn. */
static void ground_forces(const flight_t *sim, uint32_t i, const place_t *at, const real *u,
                          const real *z, real leg, tyre_t *tyre, contact_t *found) {
    const real *p = par_of(sim, G_CONTACT, i);
    const real speed = root(at->v[0] * at->v[0] + at->v[1] * at->v[1]);
    const mask_t carries = leg > 0.0;
    /* the rubber on the ground does not turn with the wheel */
    const real v[2] = {at->v[0] + at->turn * z[1], at->v[1] - at->turn * z[0]};
    const real pedal = brake_pedal(input_of(sim, u, G_GEAR, 0), p[P_CONTACT_Y]);
    *tyre = (tyre_t){
        .stiffness = p[P_CONTACT_SIDE], .loss = p[P_CONTACT_LOSS], .load = leg / at->upright};
    for (int pass = 0; pass < PASSES; pass++) {
        set_tyre(sim, p, pedal, speed, tyre, found);
        tyre_forces(tyre, z, v, &found->print);
        if (!ANY(carries)) break;
        const real along = found->print.F[0] * at->forward[2] + found->print.F[1] * at->right[2];
        tyre->load = PICK(carries, larger((leg + along) / at->upright, (real)0.0), tyre->load);
    }
}

/* Forces of one contact and the rates of its states; none where all is clear of the ground. */
static void contact_forces(flight_t *sim, uint32_t i, mask_t clear, const place_t *at,
                           const real *x, const real *u, real *dx, tyre_t *tyre, contact_t *found) {
    const real *p = par_of(sim, G_CONTACT, i);
    const real *own = state_of(sim, x, G_CONTACT, i);
    const real out = clamp(u[U_GEAR], (real)0.0, (real)1.0);
    real *rate = rate_of(sim, dx, G_CONTACT, i);
    real *output = work_of(sim, G_CONTACT, i);
    const real leg = leg_force(sim, i, at, own[X_CONTACT_STROKE], rate + X_CONTACT_STROKE)
                     * PICK(p[P_CONTACT_RETRACTS] != 0.0, out, 1.0);
    ground_forces(sim, i, at, u, own + X_CONTACT_LONG, leg, tyre, found);
    rate[X_CONTACT_LONG] = found->print.rate[0];
    rate[X_CONTACT_SIDE] = found->print.rate[1];
    contact_outputs(p, own[X_CONTACT_STROKE], at, tyre, found, output);
    if (!ANY(clear)) return;
    for (int k = 0; k < X_PER_CONTACT; k++) rate[k] = PICK(clear, 0.0, rate[k]);
    for (int k = 0; k < W_PER_CONTACT; k++) output[k] = PICK(clear, 0.0, output[k]);
    for (int k = 0; k < 2; k++) found->print.F[k] = PICK(clear, 0.0, found->print.F[k]);
    tyre->load = PICK(clear, 0.0, tyre->load);
}

static void add_force(const place_t *at, const real down[3], real load, const real plane[2],
                      real F[3], real M[3]) {
    real force[3], moment[3];
    for (int k = 0; k < 3; k++) {
        force[k] = plane[0] * at->forward[k] + plane[1] * at->right[k] - load * down[k];
    }
    cross(at->arm, force, moment);
    for (int k = 0; k < 3; k++) {
        F[k] += force[k];
        M[k] += moment[k];
    }
}

static void add_steered(real share, const place_t *at, const tyre_t *tyre, const footprint_t *patch,
                        steered_t *wheel) {
    const mask_t steered = share != 0.0;
    if (!ANY(steered)) return;
    const real speed = root(at->v[0] * at->v[0] + at->v[1] * at->v[1]);
    wheel->side += share * patch->F[1];
    wheel->grip += size_of(share) * tyre->mu * tyre->load;
    wheel->renewal = PICK(steered, patch->renewal, wheel->renewal);
    wheel->speed = PICK(steered, speed, wheel->speed);
    wheel->across = PICK(steered, PICK(share > 0.0, at->v[1], -at->v[1]), wheel->across);
}

/* A wheel clear of the ground. */
static void lift(mask_t clear, steered_t *wheel) {
    wheel->side = PICK(clear, 0.0, wheel->side);
    wheel->grip = PICK(clear, 0.0, wheel->grip);
    wheel->renewal = PICK(clear, 0.0, wheel->renewal);
    wheel->speed = PICK(clear, 0.0, wheel->speed);
    wheel->across = PICK(clear, 0.0, wheel->across);
    wheel->yaw = PICK(clear, 0.0, wheel->yaw);
}

/* Places of all contacts under the state in now; compressions into the variables, and the tables
 * over them. */
static void place_contacts(flight_t *sim, const real *x, mask_t clear, const real down[3],
                           place_t at[MAX_ITEMS]) {
    const real angle = steering_angle(sim, x);
    real ground[3];
    to_body(sim->now.C, x + X_VX, ground);
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
        const real *p = par_of(sim, G_CONTACT, i);
        const real s = state_of(sim, x, G_CONTACT, i)[X_CONTACT_STROKE];
        place_contact(sim, p, down, ground, angle * p[P_CONTACT_STEERING], at + i);
        var_of(sim, G_CONTACT, i)[A_CONTACT_COMPRESSION] = PICK(
            clear, 0.0, compression(p, s, at[i].deflection));
    }
    evaluate_stage(sim, STAGE_GEAR);
}

/* Of all contacts, where not every one is clear of the ground. */
static void ground_contact(flight_t *sim, mask_t clear, const real *x, const real *u, real F[3],
                           real M[3], real *dx) {
    place_t at[MAX_ITEMS];
    steered_t wheel = {.side = 0.0};
    real down[3];
    sim->off_ground = false;
    to_body(sim->now.C, sim->now.down, down);
    place_contacts(sim, x, clear, down, at);
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
        contact_t contact;
        tyre_t tyre;
        contact_forces(sim, i, clear, at + i, x, u, dx, &tyre, &contact);
        add_force(at + i, down, tyre.load, contact.print.F, F, M);
        add_steered(par_of(sim, G_CONTACT, i)[P_CONTACT_STEERING], at + i, &tyre, &contact.print,
                    &wheel);
    }
    wheel.yaw = dot(sim->now.rate, down);
    if (ANY(clear)) lift(clear, &wheel);
    real *found = work_of(sim, G_GEAR, 0);
    found[Y_GEAR_STEERING] = steering_angle(sim, x);
    found[Y_GEAR_STEERING_MOMENT] = steering_derivative(sim, x, u, &wheel, dx);
    for (int k = 0; k < 3; k++) {
        found[Y_GEAR_FX + k] = F[k];
        found[Y_GEAR_MX + k] = M[k];
    }
}

/* Force and moment about the c.g., body axes; rates of the states of gear and contacts. */
void gear_forces(flight_t *sim, const real *x, const real *u, real F[3], real M[3], real *dx) {
    for (int k = 0; k < 3; k++) F[k] = M[k] = 0.0;
    if (!items(sim->model, G_GEAR)) return;
    const mask_t clear = gear_clear(sim, x);
    if (EVERY(clear)) gear_off_ground(sim, x, u, dx);
    else ground_contact(sim, clear, x, u, F, M, dx);
}

#if ORIGINAL

/* Struts where spring and tyre balance at the height and attitude of the start, by bisection for
 * all legs at once, since their tables are looked up together; tyres without deflection along
 * the ground. */
void gear_start(am_sim *sim) {
    if (!items(sim->model, G_GEAR)) return;
    const uint32_t n = items(sim->model, G_CONTACT);
    place_t at[MAX_ITEMS];
    double down[3], low[MAX_ITEMS], high[MAX_ITEMS];
    sim->off_ground = false;
    steering_start(sim, sim->x);
    for (uint32_t i = 0; i < n; i++) {
        for (int k = 0; k < X_PER_CONTACT; k++) rate_of(sim, sim->x, G_CONTACT, i)[k] = 0.0;
    }
    to_body(sim->now.C, sim->now.down, down);
    place_contacts(sim, sim->x, false, down, at);
    bool touches = false;
    for (uint32_t i = 0; i < n; i++) {
        low[i] = 0.0;
        high[i] = fmin(fmax(at[i].deflection, 0.0), par_of(sim, G_CONTACT, i)[P_CONTACT_STROKE]);
        touches |= high[i] > 0.0;
    }
    for (int round = 0; touches && round < BISECTIONS; round++) {
        for (uint32_t i = 0; i < n; i++) {
            var_of(sim, G_CONTACT, i)[A_CONTACT_COMPRESSION] = 0.5 * (low[i] + high[i]);
        }
        evaluate_stage(sim, STAGE_GEAR);
        for (uint32_t i = 0; i < n; i++) {
            const double s = 0.5 * (low[i] + high[i]);
            const double tyre = par_of(sim, G_CONTACT, i)[P_CONTACT_TYRE] * (at[i].deflection - s);
            *(tyre > strut_spring(sim, i, s) ? low + i : high + i) = s;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        if (par_of(sim, G_CONTACT, i)[P_CONTACT_TYRE] > 0.0) {
            rate_of(sim, sim->x, G_CONTACT, i)[X_CONTACT_STROKE] = 0.5 * (low[i] + high[i]);
        }
    }
}

#endif
