/* A full deck: governor schedule, two spools, flame, and tables of thrust, fuel flow, air flow
 * and temperature.
 *
 * Speeds are fractions of the rated ones.  Each spool s follows its command c_s, a table over
 * lever, flight condition or the other spool, within its limits, while the engine burns, and
 * runs down to its windmilling speed w_s when it does not:
 *
 *     n_s' = b min(max((c_s - n_s) / tau, -down), up) + (1 - b) (w_s - n_s) / rundown
 *     b'   = (1 or 0 - b) / flame_time         1: fuel, and b > 1/2 or ignition at lighting speed
 *
 * tau, up and down are tables, tau of its own for either direction.  The flame b is a state so
 * that lighting and going out need no event: results do not depend on where the steps lie.
 * Corrected quantities are [LR743] Fig. 6: thrust by the ambient pressure ratio delta, speed by
 * the root of the total temperature ratio theta. */
#include "spool.h"

#include "delay.h"
#include "error.h"
#include "fuel.h"

#include <math.h>

#define LENGTH(a) (sizeof(a) / sizeof(a)[0])
#define ON 0.5              /* switches among the inputs */
#define QUICKEST 0.02       /* least time constant, for RK4 with 10 ms [s] */
#define T_STANDARD 288.15   /* [K] */
#define P_STANDARD 101325.0 /* [Pa] */
#define GAS_HALF 0.2        /* (gamma - 1) / 2 of air */
#define STILL 1e-15         /* of a speed that no longer moves */

enum { N1, N2, SPOOLS };

static double summed(const am_sim *sim, uint32_t i, int target) {
    return sum_of(sim, G_SPOOL, i)[target];
}

static bool given(const am_sim *sim, uint32_t i, int target) {
    return has_terms(sim->model, G_SPOOL, i, target);
}

static bool governed(const am_sim *sim, uint32_t i, int s) {
    return given(sim, i, T_N1_COMMAND + s) || given(sim, i, T_CORRECTED_N1_COMMAND + s);
}

/* The spool of the gas generator, which the starter turns: N2, or N1 in an engine with one
 * spool. */
static int core_spool(const am_sim *sim, uint32_t i) { return governed(sim, i, N2) ? N2 : N1; }

static double root_theta(const am_sim *sim, uint32_t i) {
    return sqrt(var_of(sim, G_SPOOL, i)[A_TEMPERATURE_RATIO]);
}

double delayed_lever(const am_sim *sim, const double *u, uint32_t i) {
    const double delay = par_of(sim, G_SPOOL, i)[P_LEVER_DELAY];
    if (!(delay > 0.0)) return input_of(sim, u, G_ENGINE, i)[U_THROTTLE];
    /* a jump belongs to the step that begins with it */
    return delay_read(memory_of(sim, G_SPOOL, i), sim->clock - delay, sim->part < 1.0);
}

void spool_variables(am_sim *sim, uint32_t i, const double *x, const double *u) {
    const double *p = par_of(sim, G_SPOOL, i);
    const double *s = state_of(sim, x, G_SPOOL, i);
    const double mach = sim->now.mach;
    double *v = var_of(sim, G_SPOOL, i);
    v[A_TEMPERATURE_RATIO] = sim->now.T / T_STANDARD * (1.0 + GAS_HALF * mach * mach);
    v[A_PRESSURE_RATIO] = sim->now.p / P_STANDARD;
    v[A_PLA] = p[P_PLA_IDLE]
               + var_of(sim, G_ENGINE, i)[A_THROTTLE] * (p[P_PLA_FULL] - p[P_PLA_IDLE]);
    v[A_N1] = sim->drive == N1_DRIVEN ? input_of(sim, u, G_SPOOL, i)[U_N1_DRIVE] : s[X_N1];
    v[A_N2] = s[X_N2];
    const double root = root_theta(sim, i);
    v[A_CORRECTED_N1] = v[A_N1] / root;
    v[A_CORRECTED_N2] = v[A_N2] / root;
}

bool spool_driven(am_sim *sim, uint32_t i) {
    if (sim->drive != N1_DRIVEN || !given(sim, i, T_CORRECTED_N2_DRIVEN)) return false;
    double *v = var_of(sim, G_SPOOL, i);
    v[A_CORRECTED_N2] = summed(sim, i, T_CORRECTED_N2_DRIVEN);
    v[A_N2] = v[A_CORRECTED_N2] * root_theta(sim, i);
    return true;
}

/* Whether the speed is given and not a matter of the dynamics. */
static bool held(const am_sim *sim, uint32_t i, int s) {
    return sim->drive == N1_DRIVEN && (s == N1 || given(sim, i, T_CORRECTED_N2_DRIVEN));
}

static double command(const am_sim *sim, uint32_t i, int s) {
    return summed(sim, i, T_N1_COMMAND + s)
           + root_theta(sim, i) * summed(sim, i, T_CORRECTED_N1_COMMAND + s);
}

static double burning_rate(const am_sim *sim, uint32_t i, int s, double n) {
    if (!governed(sim, i, s)) return 0.0;
    const double gap = command(sim, i, s) - n;
    const bool down = gap < 0.0;
    const int time = (down && given(sim, i, T_N1_DOWN_TIME + s) ? T_N1_DOWN_TIME : T_N1_UP_TIME)
                     + s;
    const int limit = (down ? T_N1_DOWN_LIMIT : T_N1_UP_LIMIT) + s;
    const double rate = gap / fmax(summed(sim, i, time), QUICKEST);
    if (!given(sim, i, limit)) return rate;
    const double most = fmax(summed(sim, i, limit), 0.0);
    return fmax(fmin(rate, most), -most);
}

static bool cranked(const am_sim *sim, const double *u, uint32_t i, int s) {
    return s == core_spool(sim, i) && input_of(sim, u, G_SPOOL, i)[U_STARTER] > ON;
}

/* Where a spool settles without a flame: windmilling, or turned by the starter. */
static double idle_run(const am_sim *sim, const double *u, uint32_t i, int s) {
    const double windmill = fmax(root_theta(sim, i) * summed(sim, i, T_CORRECTED_N1_WINDMILL + s),
                                 0.0);
    return cranked(sim, u, i, s) ? fmax(windmill, par_of(sim, G_SPOOL, i)[P_STARTER_SPEED])
                                 : windmill;
}

static double idle_rate(const am_sim *sim, const double *u, uint32_t i, int s, double n) {
    const double *p = par_of(sim, G_SPOOL, i);
    const double gap = idle_run(sim, u, i, s) - n;
    return gap / (gap > 0.0 && cranked(sim, u, i, s) ? p[P_STARTER_TIME] : p[P_N1_RUNDOWN + s]);
}

static bool inside(const am_sim *sim, uint32_t i, int margin) {
    return !given(sim, i, margin) || summed(sim, i, margin) >= 0.0;
}

static bool fed(const am_sim *sim, const double *x, const double *u, uint32_t i) {
    const double *in = input_of(sim, u, G_SPOOL, i);
    return !(in[U_CUTOFF] > ON) && !(in[U_FLAMEOUT] > ON) && fuel_left(sim, x);
}

/* Whether the flame burns on, or lights. */
static bool burns(const am_sim *sim, uint32_t i, const double *x, const double *u) {
    const double *in = input_of(sim, u, G_SPOOL, i);
    const double *p = par_of(sim, G_SPOOL, i);
    const double core = var_of(sim, G_SPOOL, i)[A_N1 + core_spool(sim, i)];
    if (!fed(sim, x, u, i) || core < p[P_SUSTAIN_SPEED] || !inside(sim, i, T_BURN_MARGIN)) {
        return false;
    }
    if (state_of(sim, x, G_SPOOL, i)[X_BURNING] > 0.5) return true;
    return (in[U_STARTER] > ON || in[U_IGNITION] > ON) && core >= p[P_LIGHT_SPEED]
           && inside(sim, i, T_LIGHT_MARGIN);
}

static double steady_itt(const am_sim *sim, uint32_t i, double b) {
    const double theta = var_of(sim, G_SPOOL, i)[A_TEMPERATURE_RATIO];
    return b * (summed(sim, i, T_ITT) + theta * summed(sim, i, T_CORRECTED_ITT))
           + (1.0 - b) * theta * T_STANDARD;
}

double spool_thrust(const am_sim *sim, uint32_t i, const double *x) {
    const double b = state_of(sim, x, G_SPOOL, i)[X_BURNING];
    const double delta = var_of(sim, G_SPOOL, i)[A_PRESSURE_RATIO];
    const double lit = sum_of(sim, G_ENGINE, i)[T_THRUST]
                       + delta * summed(sim, i, T_CORRECTED_THRUST);
    return b * lit + (1.0 - b) * summed(sim, i, T_WINDMILL_THRUST);
}

deck_t spool_deck(am_sim *sim, uint32_t i, const double *x, const double *u, double *dx) {
    const double *p = par_of(sim, G_SPOOL, i);
    const double *s = state_of(sim, x, G_SPOOL, i);
    const double *v = var_of(sim, G_SPOOL, i);
    const double b = s[X_BURNING];
    const double delta = v[A_PRESSURE_RATIO];
    const double root = root_theta(sim, i);
    const double itt = steady_itt(sim, i, b);
    double *rate = rate_of(sim, dx, G_SPOOL, i);
    double *work = work_of(sim, G_SPOOL, i);
    deck_t deck = {0};
    for (int k = 0; k < SPOOLS; k++) {
        const double n = s[X_N1 + k];
        const double full = p[P_N1_INERTIA + k] * p[P_N1_RATED + k];
        rate[X_N1 + k] = held(sim, i, k) ? 0.0
                                         : b * burning_rate(sim, i, k, n)
                                               + (1.0 - b) * idle_rate(sim, u, i, k, n);
        deck.momentum += full * v[A_N1 + k];
        deck.torque += full * rate[X_N1 + k];
    }
    rate[X_BURNING] = ((burns(sim, i, x, u) ? 1.0 : 0.0) - b) / p[P_FLAME_TIME];
    rate[X_ITT] = p[P_ITT_TIME] > 0.0 ? (itt - s[X_ITT]) / p[P_ITT_TIME] : 0.0;
    deck.thrust = spool_thrust(sim, i, x);
    deck.air_flow = fmax(
        summed(sim, i, T_AIR_FLOW) + delta / root * summed(sim, i, T_CORRECTED_AIR_FLOW), 0.0);
    deck.fuel_flow =
        b
        * fmax(summed(sim, i, T_FUEL_FLOW) + delta * root * summed(sim, i, T_CORRECTED_FUEL_FLOW),
               0.0);
    work[W_ITT] = p[P_ITT_TIME] > 0.0 ? s[X_ITT] : itt;
    work[W_FUEL_FLOW] = deck.fuel_flow;
    return deck;
}

void spool_start(am_sim *sim, uint32_t i, double t) {
    double *s = rate_of(sim, sim->x, G_SPOOL, i);
    delay_start(memory_of(sim, G_SPOOL, i), t, input_of(sim, sim->u, G_ENGINE, i)[U_THROTTLE]);
    for (int k = 0; k < SPOOLS; k++) s[X_N1 + k] = 0.0;
    s[X_BURNING] = fed(sim, sim->x, sim->u, i);
    s[X_ITT] = 0.0;
}

bool spool_settle(am_sim *sim, uint32_t i, double *x, const double *u) {
    double *s = rate_of(sim, x, G_SPOOL, i);
    const double b = s[X_BURNING];
    bool moved = false;
    for (int k = 0; k < SPOOLS; k++) {
        const double n = held(sim, i, k) ? var_of(sim, G_SPOOL, i)[A_N1 + k]
                         : b > 0.0       ? command(sim, i, k)
                                         : idle_run(sim, u, i, k);
        moved = moved || fabs(n - s[X_N1 + k]) > STILL;
        s[X_N1 + k] = n;
    }
    s[X_ITT] = steady_itt(sim, i, b);
    if (moved || !(b > 0.0) || burns(sim, i, x, u)) return moved;
    s[X_BURNING] = 0.0;
    return true;
}

void spool_advance(am_sim *sim, uint32_t i, double t, double h, double lever0, double lever1) {
    double *line = memory_of(sim, G_SPOOL, i);
    const double delay = par_of(sim, G_SPOOL, i)[P_LEVER_DELAY];
    if (!(delay > 0.0)) {
        delay_start(line, t + h, lever1);
        return;
    }
    delay_record(line, t, lever0, delay);
    delay_record(line, t + h, lever1, delay);
    /* the jump arrives now */
    if (delay_read(line, t - delay, true) != delay_read(line, t - delay, false)) sim->fresh = false;
}

int spool_check(am_sim *sim, uint32_t i) {
    static const uint32_t POSITIVE[] = {P_LEVER_DELAY, P_N1_INERTIA, P_N2_INERTIA};
    static const uint32_t TIMES[] = {P_N1_RUNDOWN, P_N2_RUNDOWN, P_STARTER_TIME, P_FLAME_TIME};
    const uint32_t first = place(sim->model, AM_PARAMETER, G_SPOOL, i);
    const double *p = par_of(sim, G_SPOOL, i);
    for (size_t k = 0; k < LENGTH(POSITIVE); k++) {
        if (!(p[POSITIVE[k]] >= 0.0)) {
            return bad_parameter(sim, first + POSITIVE[k], "zero or positive");
        }
    }
    for (size_t k = 0; k < LENGTH(TIMES); k++) {
        if (!(p[TIMES[k]] >= QUICKEST)) {
            return bad_parameter(sim, first + TIMES[k], "0.02 s or more");
        }
    }
    if (p[P_ITT_TIME] != 0.0 && !(p[P_ITT_TIME] >= QUICKEST)) {
        return bad_parameter(sim, first + P_ITT_TIME, "0, or 0.02 s or more");
    }
    if (!(p[P_LIGHT_SPEED] >= p[P_SUSTAIN_SPEED])) {
        return bad_parameter(sim, first + P_LIGHT_SPEED,
                             "at least sustain_speed, below which the flame goes out");
    }
    return AM_OK;
}
