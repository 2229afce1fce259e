/* Thrust and its lever arms: a static table with a first-order lag, a full deck (spool.c), or
 * the recorded thrust.
 *
 * The thrust acts at the engine's position along its thrust line.  Where a deck gives gross
 * thrust and the air flow, the momentum of the air taken in is a force of its own: - air flow x
 * velocity of the aircraft, at the inlet. */
#include "engine.h"

#include "error.h"
#include "feed.h"
#include "fuel.h"
#include "shaft.h"
#include "spool.h"
#include "terms.h"
#include "thrust.h"

#define SETTLED 30 /* most passes to the steady state; a cascade of two spools needs three */

static bool decked(const flight_t *sim) { return items(sim->model, G_SPOOL) > 0; }

/* Variables and tables of all engines. */
static void look_at_engines(flight_t *sim, const intake_t *in, const real *x, const real *u) {
    const uint32_t n = items(sim->model, G_ENGINE);
    bool again = false;
    for (uint32_t i = 0; i < n; i++) {
        const real lever = decked(sim) ? delayed_lever(sim, u, i)
                                       : input_of(sim, u, G_ENGINE, i)[U_THROTTLE];
        var_of(sim, G_ENGINE, i)[A_THROTTLE] = lever + sim->par[P_BIAS_THROTTLE]
                                               + sim->trim.throttle;
        if (decked(sim)) spool_variables(sim, i, in, x, u);
        if (propelled(sim->model)) shaft_variables(sim, i, x, u);
    }
    evaluate_stage(sim, STAGE_ENGINE);
    for (uint32_t i = 0; decked(sim) && i < n; i++) again = spool_driven(sim, i) || again;
    if (again) evaluate_stage(sim, STAGE_ENGINE);
}

#if ORIGINAL

double applied_throttle(const am_sim *sim, const double *u, uint32_t i) {
    return input_of(sim, u, G_ENGINE, i)[U_THROTTLE] + sim->par[P_BIAS_THROTTLE]
           + sim->trim.throttle;
}

static bool has_thrust(const am_sim *sim, uint32_t i) {
    return propelled(sim->model) || has_terms(sim->model, G_ENGINE, i, T_THRUST)
           || (decked(sim) && has_terms(sim->model, G_SPOOL, i, T_CORRECTED_THRUST));
}

/* Whether the engines have the part that the drive moves. */
static int drive_check(am_sim *sim) {
    const am_model *m = sim->model;
    const bool shaft = sim->drive == TORQUE_DRIVEN || sim->drive == RPM_DRIVEN;
    if (shaft && !propelled(m)) {
        return fail(sim, AM_BAD_VALUE,
                    "mode.engine = %d drives the %s of a propeller, but the engines have none; use "
                    "mode.engine = 0, 1 or 2",
                    sim->drive, sim->drive == RPM_DRIVEN ? "speed" : "torque");
    }
    if (sim->drive == MAP_DRIVEN && !items(m, G_PISTON)) {
        return fail(sim, AM_BAD_VALUE,
                    "mode.engine = 5 drives the manifold pressure, but the engines are no piston "
                    "engines; use mode.engine = 0%s",
                    propelled(m) ? ", 2, 3 or 4" : ", 1 or 2");
    }
    for (uint32_t i = 0; sim->drive == N1_DRIVEN && i < items(m, G_PROPELLER); i++) {
        if (par_of(sim, G_PROPELLER, i)[P_COUPLED] != 0.0) {
            return fail(sim, AM_BAD_VALUE,
                        "mode.engine = 1 drives N1, but the gas generator of engine%u turns with "
                        "the propeller; use mode.engine = 0, 3 or 4",
                        (unsigned)(i + 1));
        }
    }
    return AM_OK;
}

int engine_check(am_sim *sim) {
    const am_model *m = sim->model;
    if (sim->drive == N1_DRIVEN && items(m, G_ENGINE) && !decked(sim)) {
        return fail(sim, AM_BAD_VALUE,
                    "mode.engine = 1 drives N1, but the engines have no deck of spool speeds; use "
                    "mode.engine = 0 or 2");
    }
    const int driven = drive_check(sim);
    if (driven != AM_OK) return driven;
    for (uint32_t i = 0; i < items(m, G_ENGINE); i++) {
        const uint32_t tau = place(m, AM_PARAMETER, G_ENGINE, i) + P_TIME_CONSTANT;
        const bool spins = par_of(sim, G_ENGINE, i)[P_ANGULAR_MOMENTUM] != 0.0
                           || (decked(sim) && spool_spins(sim, i));
        sim->rotors = i ? sim->rotors | (uint32_t)spins << i : spins;
        if (!(sim->par[tau] >= 0.0)) return bad_parameter(sim, tau, "zero or positive");
        if (sim->drive != THRUST_DRIVEN && !has_thrust(sim, i)) {
            return fail(
                sim, AM_BAD_VALUE,
                "mode.engine = %d needs a thrust table, engine%u has none; use mode.engine = 2",
                sim->drive, (unsigned)(i + 1));
        }
        int status = decked(sim) ? spool_check(sim, i) : AM_OK;
        if (status == AM_OK && propelled(m)) status = shaft_check(sim, i);
        if (status != AM_OK) return status;
    }
    return AM_OK;
}

static void look_at_start(am_sim *sim) {
    const intake_t in = decked(sim) ? spool_intake(sim) : (intake_t){.theta = 0.0};
    look_at_engines(sim, &in, sim->x, sim->u);
}

static void start_shafts(am_sim *sim) {
    if (!propelled(sim->model)) return;
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) shaft_start(sim, i, look_at_start);
}

void engine_start(am_sim *sim, double t) {
    const uint32_t n = items(sim->model, G_ENGINE);
    const intake_t in = spool_intake(sim);
    bool moved = decked(sim);
    for (uint32_t i = 0; propelled(sim->model) && i < n; i++) shaft_guess(sim, i);
    for (uint32_t i = 0; decked(sim) && i < n; i++) spool_start(sim, i, t);
    for (int pass = 0; pass < SETTLED && moved; pass++) {
        look_at_engines(sim, &in, sim->x, sim->u);
        moved = false;
        for (uint32_t i = 0; i < n; i++) moved = spool_steady(sim, i, sim->x, sim->u) || moved;
        start_shafts(sim);
    }
    if (!decked(sim)) start_shafts(sim);
    look_at_engines(sim, &in, sim->x, sim->u);
    for (uint32_t i = 0; i < n; i++) {
        rate_of(sim, sim->x, G_ENGINE, i)[X_LAGGED] = decked(sim)
                                                          ? spool_thrust(sim, i, sim->x)
                                                          : sum_of(sim, G_ENGINE, i)[T_THRUST];
    }
}

bool engine_memory_valid(const am_sim *sim) {
    for (uint32_t i = 0; i < items(sim->model, G_SPOOL); i++) {
        if (!delay_valid(memory_of(sim, G_SPOOL, i), sim->ready)) return false;
    }
    return true;
}

void engine_advance(am_sim *sim, double t, double h, const double *u0, const double *u1) {
    for (uint32_t i = 0; i < items(sim->model, G_SPOOL); i++) {
        spool_advance(sim, i, t, h, input_of(sim, u0, G_ENGINE, i)[U_THROTTLE],
                      input_of(sim, u1, G_ENGINE, i)[U_THROTTLE]);
    }
}

#endif

static void ram_force(flight_t *sim, uint32_t i, real air_flow, real F[3], real M[3]) {
    const now_r *now = &sim->now;
    const real force[3] = {-air_flow * now->u, -air_flow * now->v, -air_flow * now->w};
    push(force, par_of(sim, G_SPOOL, i) + P_INLET_X, now->cg, F, M);
}

/* Force and moment of one engine; returns the fuel flow. */
static real run_engine(flight_t *sim, uint32_t i, const intake_t *in, const real *x, const real *u,
                       real F[restrict 3], real M[restrict 3], real H[restrict 3], real *dx) {
    now_r *now = &sim->now;
    const real *p = par_of(sim, G_ENGINE, i);
    deck_t deck = {.thrust = 0.0};
    if (decked(sim)) deck.fuelled = fuel_left(sim, i, x, u);
    if (decked(sim)) spool_deck(sim, i, in, x, u, &deck, dx);
    else deck.thrust = sum_of(sim, G_ENGINE, i)[T_THRUST];
    const bool recorded = sim->drive == THRUST_DRIVEN;
    const mask_t lags = p[P_TIME_CONSTANT] > 0.0;
    const real state = state_of(sim, x, G_ENGINE, i)[X_LAGGED];
    /* lag of first order: T' = (T_steady - T) / tau; a recorded thrust has none */
    real *rate = rate_of(sim, dx, G_ENGINE, i);
    rate[X_LAGGED] = recorded ? (real)0.0
                              : PICK(lags, (deck.thrust - state) / p[P_TIME_CONSTANT], 0.0);
    const real given = recorded ? input_of(sim, u, G_ENGINE, i)[U_THRUST_DRIVE]
                              : PICK(lags, state, deck.thrust);
    const real blades = propelled(sim->model)
                            ? shaft_loads(sim, i, x, u, &deck.fuel_flow, F, M, H, dx)
                            : (real)0.0;
    const real own = propelled(sim->model) && !recorded ? given + blades : given;
    const real thrust = own + sim->par[P_BIAS_THRUST] + sim->trim.thrust;
    const real air_flow = recorded ? (real)0.0 : deck.air_flow;
    add_thrust(p, thrust, now->cg, F, M);
    if (sim->rotors >> i & 1) add_rotors(p, deck.momentum, deck.torque, M, H);
    /* net thrust: gross thrust less the momentum of the air taken in */
    now->thrust[i] = var_of(sim, G_ENGINE, i)[A_THRUST] = thrust - air_flow * now->V;
    if (!decked(sim)) return deck.fuel_flow;
    if (spool_breathes(sim->model, i)) ram_force(sim, i, air_flow, F, M);
    real *work = work_of(sim, G_SPOOL, i);
    work[W_GROSS_THRUST] = thrust;
    work[W_RAM_DRAG] = air_flow * now->V;
    work[W_AIR_FLOW] = deck.air_flow;
    work[W_FUEL_FLOW] = deck.fuel_flow;
    return deck.fuel_flow;
}

void engine_forces(flight_t *sim, const real *x, const real *u, real F[3], real M[3], real H[3],
                   real *dx) {
    real flow[MAX_ENGINES];
    real all = 0.0;
    for (int k = 0; k < 3; k++) F[k] = M[k] = H[k] = 0.0;
    const intake_t in = decked(sim) ? spool_intake(sim) : (intake_t){.theta = 0.0};
    look_at_engines(sim, &in, x, u);
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) {
        flow[i] = run_engine(sim, i, &in, x, u, F, M, H, dx);
        all += flow[i];
    }
    burn_fuel(sim, x, all, dx);
    if (items(sim->model, G_TANK)) draw_fuel(sim, x, u, flow, dx);
}

void engine_outputs(const flight_t *sim, real *y) {
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) {
        output_of(sim, y, G_ENGINE, i)[Y_THRUST] = sim->now.thrust[i];
        if (propelled(sim->model)) shaft_outputs(sim, i, y);
    }
    for (uint32_t i = 0; i < items(sim->model, G_SPOOL); i++) {
        const real *v = var_of(sim, G_SPOOL, i);
        const real *work = work_of(sim, G_SPOOL, i);
        real *to = output_of(sim, y, G_SPOOL, i);
        to[Y_N1] = v[A_N1];
        to[Y_N2] = v[A_N2];
        to[Y_PLA] = v[A_PLA];
        to[Y_BURNING] = state_of(sim, sim->x, G_SPOOL, i)[X_BURNING];
        to[Y_ITT] = work[W_ITT];
        to[Y_FUEL_FLOW] = work[W_FUEL_FLOW];
        to[Y_GROSS_THRUST] = work[W_GROSS_THRUST];
        to[Y_RAM_DRAG] = work[W_RAM_DRAG];
        to[Y_AIR_FLOW] = work[W_AIR_FLOW];
    }
}
