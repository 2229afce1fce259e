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

/* What one engine consists of, where it stands. */
typedef struct {
    const real *par, *var, *state, *in, *sum;
    uint64_t given;  /* targets that have terms, as bits */
    real root_theta; /* root of the temperature ratio */
    bool n1_driven;
} spool_t;

/* Whether the gas generator turns with a propeller; shaft.c finds its rate then. */
static inline bool on_shaft(const flight_t *sim, uint32_t i) {
    return items(sim->model, G_PROPELLER) && FIRST(par_of(sim, G_PROPELLER, i)[P_COUPLED]) != 0.0;
}

static inline spool_t spool_of(const flight_t *sim, uint32_t i, real root_theta, const real *x,
                               const real *u) {
    const am_model *m = sim->model;
    const uint32_t target = place(m, AM_TARGET, G_SPOOL, i);
    return (spool_t){.par = par_of(sim, G_SPOOL, i),
                     .var = var_of(sim, G_SPOOL, i),
                     .state = state_of(sim, x, G_SPOOL, i),
                     .in = input_of(sim, u, G_SPOOL, i),
                     .sum = sim->sum + target,
                     .given = m->decks[i],
                     .root_theta = root_theta,
                     .n1_driven = sim->drive == N1_DRIVEN || on_shaft(sim, i)};
}

_Static_assert(T_PER_SPOOL <= 64, "a bit for each target");

static inline bool given(const spool_t *e, int target) { return e->given >> target & 1; }

static inline bool governed(const spool_t *e, int s) {
    return given(e, T_N1_COMMAND + s) || given(e, T_CORRECTED_N1_COMMAND + s);
}

/* The spool of the gas generator, which the starter turns: N2, or N1 in an engine with one
 * spool. */
static inline int core_spool(const spool_t *e) { return governed(e, N2) ? N2 : N1; }

static double lever_now(const am_sim *sim, uint32_t i, double clock, double part, double delay,
                        double present) {
    if (!(delay > 0.0)) return present;
    /* a jump belongs to the step that begins with it */
    return delay_read(memory_of(sim, G_SPOOL, i), clock - delay, part < 1.0);
}

#if LANES == 1

double delayed_lever(const am_sim *sim, const double *u, uint32_t i) {
    return lever_now(sim, i, sim->clock, sim->part, par_of(sim, G_SPOOL, i)[P_LEVER_DELAY],
                     input_of(sim, u, G_ENGINE, i)[U_THROTTLE]);
}

#else

real delayed_lever(const flight_t *f, const real *u, uint32_t i) {
    const real delay = par_of(f, G_SPOOL, i)[P_LEVER_DELAY];
    const real present = input_of(f, u, G_ENGINE, i)[U_THROTTLE];
    real lever = present;
    if (!ANY(delay > 0.0)) return lever;
    for (int l = 0; l < LANES; l++) {
        lever[l] = lever_now(f->lane[l], i, f->clock, f->part, delay[l], present[l]);
    }
    return lever;
}

#endif

intake_t spool_intake(const flight_t *sim) {
    const real mach = sim->now.mach;
    const real theta = sim->now.T / T_STANDARD * (1.0 + GAS_HALF * mach * mach);
    return (intake_t){theta, root(theta), sim->now.p / P_STANDARD};
}

void spool_variables(flight_t *sim, uint32_t i, const intake_t *in, const real *x, const real *u) {
    const real *p = par_of(sim, G_SPOOL, i);
    const real *s = state_of(sim, x, G_SPOOL, i);
    real *v = var_of(sim, G_SPOOL, i);
    v[A_TEMPERATURE_RATIO] = in->theta;
    v[A_PRESSURE_RATIO] = in->delta;
    v[A_PLA] = p[P_PLA_IDLE]
               + var_of(sim, G_ENGINE, i)[A_THROTTLE] * (p[P_PLA_FULL] - p[P_PLA_IDLE]);
    v[A_N1] = sim->drive == N1_DRIVEN ? input_of(sim, u, G_SPOOL, i)[U_N1_DRIVE] : s[X_N1];
    v[A_N2] = s[X_N2];
    v[A_CORRECTED_N1] = v[A_N1] / in->root_theta;
    v[A_CORRECTED_N2] = v[A_N2] / in->root_theta;
}

bool spool_driven(flight_t *sim, uint32_t i) {
    if (sim->drive != N1_DRIVEN || !has_terms(sim->model, G_SPOOL, i, T_CORRECTED_N2_DRIVEN)) {
        return false;
    }
    real *v = var_of(sim, G_SPOOL, i);
    v[A_CORRECTED_N2] = sum_of(sim, G_SPOOL, i)[T_CORRECTED_N2_DRIVEN];
    v[A_N2] = v[A_CORRECTED_N2] * root(v[A_TEMPERATURE_RATIO]);
    return true;
}

/* Whether the speed is given and not a matter of the dynamics. */
static inline bool held(const spool_t *e, int s) {
    return e->n1_driven && (s == N1 || given(e, T_CORRECTED_N2_DRIVEN));
}

static inline real command(const spool_t *e, int s) {
    return e->sum[T_N1_COMMAND + s] + e->root_theta * e->sum[T_CORRECTED_N1_COMMAND + s];
}

static inline real within_limit(const spool_t *e, int limit, real rate) {
    if (!given(e, limit)) return rate;
    const real most = larger(e->sum[limit], 0.0);
    return larger(smaller(rate, most), -most);
}

static inline real burning_rate(const spool_t *e, int s, real n) {
    if (!governed(e, s)) return 0.0;
    const real gap = command(e, s) - n;
    const mask_t down = gap < 0.0;
    const real up_time = e->sum[T_N1_UP_TIME + s];
    const real down_time = given(e, T_N1_DOWN_TIME + s) ? e->sum[T_N1_DOWN_TIME + s] : up_time;
    const real rate = gap / larger(PICK(down, down_time, up_time), QUICKEST);
    return PICK(down, within_limit(e, T_N1_DOWN_LIMIT + s, rate),
                within_limit(e, T_N1_UP_LIMIT + s, rate));
}

static mask_t cranked(const spool_t *e, int s) {
    return s == core_spool(e) ? e->in[U_STARTER] > ON : everywhere(false);
}

/* Where a spool settles without a flame: windmilling, or turned by the starter. */
static real idle_run(const spool_t *e, int s) {
    const real windmill = larger(e->root_theta * e->sum[T_CORRECTED_N1_WINDMILL + s], 0.0);
    return PICK(cranked(e, s), larger(windmill, e->par[P_STARTER_SPEED]), windmill);
}

static real idle_rate(const spool_t *e, int s, real n) {
    const real gap = idle_run(e, s) - n;
    const mask_t starting = (gap > 0.0) & cranked(e, s);
    return gap / PICK(starting, e->par[P_STARTER_TIME], e->par[P_N1_RUNDOWN + s]);
}

/* Of a spool that is not held; nothing of the idle run where all of the flame burns. */
static inline real spool_rate(const spool_t *e, int s, real n) {
    const real b = e->state[X_BURNING];
    const real rate = b * burning_rate(e, s, n);
    if (EVERY(b == 1.0)) return rate;
    return PICK(b == 1.0, rate, rate + (1.0 - b) * idle_rate(e, s, n));
}

static inline mask_t inside(const spool_t *e, int margin) {
    return given(e, margin) ? e->sum[margin] >= 0.0 : everywhere(true);
}

/* fuel: whether there is some for the engine. */
static inline mask_t fed(const spool_t *e, mask_t fuel) {
    return NOT(e->in[U_CUTOFF] > ON) & NOT(e->in[U_FLAMEOUT] > ON) & fuel;
}

/* Whether the flame burns on, or lights. */
static inline mask_t burns(const spool_t *e, mask_t fuel) {
    const real *in = e->in;
    const real core = e->var[A_N1 + core_spool(e)];
    const mask_t lit = e->state[X_BURNING] > 0.5;
    const mask_t fuelled = fed(e, fuel);
    const mask_t margin = inside(e, T_BURN_MARGIN);
    const mask_t can = fuelled & margin & NOT(core < e->par[P_SUSTAIN_SPEED]);
    if (EVERY(lit)) return can;
    const mask_t lights = ((in[U_STARTER] > ON) | (in[U_IGNITION] > ON))
                          & (core >= e->par[P_LIGHT_SPEED]) & inside(e, T_LIGHT_MARGIN);
    return can & (lit | lights);
}

static inline real steady_itt(const spool_t *e) {
    const real b = e->state[X_BURNING];
    const real theta = e->var[A_TEMPERATURE_RATIO];
    return b * (e->sum[T_ITT] + theta * e->sum[T_CORRECTED_ITT]) + (1.0 - b) * theta * T_STANDARD;
}

/* plain: values of the tables of thrust that is not corrected. */
static inline real thrust_of(const spool_t *e, real plain) {
    const real b = e->state[X_BURNING];
    const real lit = plain + e->var[A_PRESSURE_RATIO] * e->sum[T_CORRECTED_THRUST];
    return b * lit + (1.0 - b) * e->sum[T_WINDMILL_THRUST];
}

bool spool_breathes(const am_model *m, uint32_t i) {
    return (m->decks[i] & (1ull << T_AIR_FLOW | 1ull << T_CORRECTED_AIR_FLOW)) != 0;
}

void spool_deck(flight_t *sim, uint32_t i, const intake_t *in, const real *x, const real *u,
                deck_t *deck, real *dx) {
    const spool_t e = spool_of(sim, i, in->root_theta, x, u);
    const real *p = e.par;
    const real *s = e.state;
    const real b = s[X_BURNING];
    const real delta = in->delta;
    const real itt = steady_itt(&e);
    real *rate = rate_of(sim, dx, G_SPOOL, i);
    real *work = work_of(sim, G_SPOOL, i);
    for (int k = 0; k < SPOOLS; k++) {
        rate[X_N1 + k] = held(&e, k) ? (real)0.0 : spool_rate(&e, k, s[X_N1 + k]);
    }
    for (int k = 0; k < SPOOLS && sim->rotors >> i & 1; k++) {
        const real full = p[P_N1_INERTIA + k] * p[P_N1_RATED + k];
        deck->momentum += full * e.var[A_N1 + k];
        deck->torque += full * rate[X_N1 + k];
    }
    rate[X_BURNING] = (PICK(burns(&e, deck->fuelled), 1.0, 0.0) - b) / p[P_FLAME_TIME];
    rate[X_ITT] = PICK(p[P_ITT_TIME] > 0.0, (itt - s[X_ITT]) / p[P_ITT_TIME], 0.0);
    deck->thrust = thrust_of(&e, sum_of(sim, G_ENGINE, i)[T_THRUST]);
    if (spool_breathes(sim->model, i)) {
        deck->air_flow = larger(
            e.sum[T_AIR_FLOW] + delta / e.root_theta * e.sum[T_CORRECTED_AIR_FLOW], 0.0);
    }
    deck->fuel_flow =
        b * larger(e.sum[T_FUEL_FLOW] + delta * e.root_theta * e.sum[T_CORRECTED_FUEL_FLOW], 0.0);
    work[W_ITT] = PICK(p[P_ITT_TIME] > 0.0, s[X_ITT], itt);
    work[W_FUEL_FLOW] = deck->fuel_flow;
}

#if ORIGINAL

static spool_t spool_at(const am_sim *sim, uint32_t i, const double *x, const double *u) {
    return spool_of(sim, i, root(var_of(sim, G_SPOOL, i)[A_TEMPERATURE_RATIO]), x, u);
}

double spool_thrust(const am_sim *sim, uint32_t i, const double *x) {
    const spool_t e = spool_at(sim, i, x, sim->u);
    return thrust_of(&e, sum_of(sim, G_ENGINE, i)[T_THRUST]);
}

void spool_start(am_sim *sim, uint32_t i, double t) {
    double *s = rate_of(sim, sim->x, G_SPOOL, i);
    delay_start(memory_of(sim, G_SPOOL, i), t, input_of(sim, sim->u, G_ENGINE, i)[U_THROTTLE]);
    for (int k = 0; k < SPOOLS; k++) s[X_N1 + k] = 0.0;
    const spool_t e = spool_at(sim, i, sim->x, sim->u);
    s[X_BURNING] = fed(&e, fuel_left(sim, i, sim->x, sim->u));
    s[X_ITT] = 0.0;
}

bool spool_steady(am_sim *sim, uint32_t i, double *x, const double *u) {
    const spool_t e = spool_at(sim, i, x, u);
    double *s = rate_of(sim, x, G_SPOOL, i);
    bool moved = false;
    for (int k = 0; k < SPOOLS; k++) {
        const double n = held(&e, k)          ? e.var[A_N1 + k]
                         : s[X_BURNING] > 0.0 ? command(&e, k)
                                              : idle_run(&e, k);
        moved = moved || fabs(n - s[X_N1 + k]) > STILL;
        s[X_N1 + k] = n;
    }
    s[X_ITT] = steady_itt(&e);
    if (moved || !(s[X_BURNING] > 0.0) || burns(&e, fuel_left(sim, i, x, u))) return moved;
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
    if (lever0 == lever1 && delay_still(line, t, lever0)) {
        delay_extend(line, t + h);
        return;
    }
    delay_record(line, t, lever0, delay);
    delay_record(line, t + h, lever1, delay);
    /* the jump arrives now */
    if (delay_read(line, t - delay, true) != delay_read(line, t - delay, false)) sim->fresh = false;
}

bool spool_spins(const am_sim *sim, uint32_t i) {
    const double *p = par_of(sim, G_SPOOL, i);
    return p[P_N1_INERTIA] * p[P_N1_RATED] != 0.0 || p[P_N2_INERTIA] * p[P_N2_RATED] != 0.0;
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

#endif
