/* Feeds: from which tanks each engine draws.  Transfers: pumps from tank to tank.
 *
 * A feed leads from a tank to an engine: never (0), always (1) or with the cross-feed open (2).  It
 * delivers while the tank is not cut off and holds fuel.  An engine draws from the tanks of the
 * lowest order among those that deliver, in proportion to their capacity:
 *
 *     m_i' = - sum over engines of Wf capacity_i / (sum of the capacities that it draws from)
 *
 * A pump moves, while its switch is on,
 *
 *     rate max(0, min(1, (m_from - leave)/band, (fill - m_to)/band))
 *
 * out of one tank into the other: over the band the float valve of the full tank shuts, and the
 * inlet in the empty one takes air.  The flow is continuous in both contents.
 */
#include "feed.h"

#include "error.h"
#include "shaft_limits.h"

#define SHORTEST 0.1 /* s in which a pump may move the fuel of its band */

enum { SHUT, ALWAYS, CROSSED };

static inline mask_t delivers(const flight_t *sim, uint32_t feed, const real *x, const real *u) {
    const uint32_t tank = sim->model->feed_tank[feed];
    const real way = par_of(sim, G_FEED, feed)[P_FEED];
    const mask_t open = input_of(sim, u, G_TANKS, 0)[U_CROSSFEED] > SWITCHED;
    const mask_t crossed = (way == CROSSED) & open;
    const mask_t cut = input_of(sim, u, G_TANK, tank)[U_TANK_CUTOFF] > SWITCHED;
    const mask_t filled = state_of(sim, x, G_TANK, tank)[X_TANK] > 0.0;
    return ((way == ALWAYS) | crossed) & NOT(cut) & filled;
}

/* Of a model with tanks alone: what it needs is not in the way of the others. */
__attribute__((noinline)) mask_t fuel_fed(const flight_t *sim, uint32_t engine, const real *x,
                                          const real *u) {
    const am_model *m = sim->model;
    mask_t fed = everywhere(false);
    for (uint32_t i = 0; i < items(m, G_FEED); i++) {
        if (m->feed_engine[i] == engine) fed = fed | delivers(sim, i, x, u);
    }
    return fed;
}

/* Adds the flow to one engine to the rates of the tanks that it comes from. */
static void draw_for(const flight_t *sim, uint32_t engine, const real *x, const real *u, real flow,
                     real *dx) {
    const am_model *m = sim->model;
    const uint32_t n = items(m, G_FEED);
    real part[MAX_ITEMS]; /* capacity of the tank behind each feed that is drawn from, else zero */
    real lowest = INFINITY;
    real sum = 0.0;
    for (uint32_t i = 0; i < n; i++) {
        const real *tank = par_of(sim, G_TANK, m->feed_tank[i]);
        part[i] = 0.0;
        if (m->feed_engine[i] != engine) continue;
        part[i] = PICK(delivers(sim, i, x, u), tank[P_TANK_CAPACITY], 0.0);
        lowest = PICK(part[i] > 0.0, smaller(tank[P_TANK_ORDER], lowest), lowest);
    }
    for (uint32_t i = 0; i < n; i++) {
        const real order = par_of(sim, G_TANK, m->feed_tank[i])[P_TANK_ORDER];
        part[i] = PICK(order == lowest, part[i], 0.0);
        sum += part[i];
    }
    for (uint32_t i = 0; i < n; i++) {
        const real drawn = PICK(part[i] > 0.0, flow * (part[i] / sum), 0.0);
        rate_of(sim, dx, G_TANK, m->feed_tank[i])[X_TANK] -= drawn;
    }
}

/* Moves fuel from tank to tank: what one loses the other has. */
static void run_pumps(const flight_t *sim, const real *x, const real *u, real *dx) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < items(m, G_TRANSFER); i++) {
        const real *p = par_of(sim, G_TRANSFER, i);
        const uint32_t from = m->from_tank[i];
        const uint32_t to = m->to_tank[i];
        const real over = state_of(sim, x, G_TANK, from)[X_TANK] - p[P_TRANSFER_LEAVE];
        const real room = p[P_TRANSFER_FILL] - state_of(sim, x, G_TANK, to)[X_TANK];
        const real limit = smaller(over, room) / p[P_TRANSFER_BAND];
        const real share = larger(smaller(limit, 1.0), 0.0);
        const mask_t on = input_of(sim, u, G_TRANSFER, i)[U_TRANSFER] > SWITCHED;
        const real flow = PICK(on, p[P_TRANSFER_RATE] * share, 0.0);
        work_of(sim, G_TRANSFER, i)[W_TRANSFER] = flow;
        rate_of(sim, dx, G_TANK, from)[X_TANK] -= flow;
        rate_of(sim, dx, G_TANK, to)[X_TANK] += flow;
    }
}

__attribute__((noinline)) void draw_fuel(const flight_t *sim, const real *x, const real *u,
                                         const real flow[MAX_ENGINES], real *dx) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < items(m, G_TANK); i++) rate_of(sim, dx, G_TANK, i)[X_TANK] = 0.0;
    for (uint32_t i = 0; i < items(m, G_ENGINE); i++) draw_for(sim, i, x, u, flow[i], dx);
    run_pumps(sim, x, u, dx);
}

#if ORIGINAL

int feeds_check(am_sim *sim) {
    for (uint32_t i = 0; i < items(sim->model, G_FEED); i++) {
        const double way = *par_of(sim, G_FEED, i);
        if (way == SHUT || way == ALWAYS || way == CROSSED) continue;
        return bad_parameter(sim, place(sim->model, AM_PARAMETER, G_FEED, i) + P_FEED,
                             "0 (never), 1 (always) or 2 (with the cross-feed open)");
    }
    return AM_OK;
}

int transfers_check(am_sim *sim) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < items(m, G_TRANSFER); i++) {
        const uint32_t first = place(m, AM_PARAMETER, G_TRANSFER, i);
        const double *p = par_of(sim, G_TRANSFER, i);
        const double room = par_of(sim, G_TANK, m->to_tank[i])[P_TANK_CAPACITY];
        if (!(p[P_TRANSFER_RATE] >= 0.0)) {
            return bad_parameter(sim, first + P_TRANSFER_RATE, "zero or positive");
        }
        if (!(p[P_TRANSFER_LEAVE] >= 0.0)) {
            return bad_parameter(sim, first + P_TRANSFER_LEAVE, "zero or positive");
        }
        if (!(p[P_TRANSFER_FILL] >= 0.0 && p[P_TRANSFER_FILL] <= room)) {
            return bad_parameter(sim, first + P_TRANSFER_FILL,
                                 "between zero and the capacity of the tank that it fills");
        }
        /* a shorter band is less than what a step moves, and the valve would flutter */
        if (!(p[P_TRANSFER_BAND] > 0.0 && p[P_TRANSFER_BAND] >= SHORTEST * p[P_TRANSFER_RATE])) {
            return bad_parameter(sim, first + P_TRANSFER_BAND,
                                 "positive, and at least what the pump moves in 0.1 s");
        }
    }
    return AM_OK;
}

#endif
