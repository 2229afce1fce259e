/* Piston engine with four strokes: manifold, air, fuel, power and flame.
 *
 *     p_i = p + ram_recovery (p_total - p)                          at the intake
 *     c   = map_ratio, or 1 / (1 + w (z_i + z_t (1 - throttle)^2))  w: speed of the crankshaft
 *     m'  = (c p_i - m) / map_time                                  in front of the compressor
 *     MAP = min(m (1 + (boost_ratio - 1) r), boost_limit)           r: w / boost_rpm, or 1
 *     air = D w / (4 pi) MAP / (R T) eta ((g - 1) / g + (e - p / MAP) / (g (e - 1)))
 *     F   = full_rich mixture delta^-enrichment                     fuel over air
 *     Wf  = F air + b (fuel_flow + bsfc P_t)
 *     P_t = power + corrected_power sqrt(T_ISA / T)
 *     P   = b (P_t + fuel_work F air - D w / (4 pi) friction_pressure) - friction_power
 *           - (1 - b) motoring_power + pumping D w / (4 pi) (m - p)
 *
 * A recorded MAP (mode.engine 5) replaces the manifold: m = MAP / (1 + (boost_ratio - 1) r).
 *
 * D is the displacement, e the compression ratio, g = 1.3.  The air: Taylor, The Internal
 * Combustion Engine in Theory and Practice, vol. 1, eq. (6-10), with the exhaust at ambient
 * pressure.  A chart of power over manifold pressure and speed is P_t; its correction for
 * temperature is the rule of Lycoming's operator's manuals.  The flame b is a state as in
 * spool.c. */
#include "piston.h"

#include "algebra.h"
#include "elementary_real.h"
#include "error.h"
#include "fuel.h"
#include "shaft_limits.h"

#define QUICKEST_FLAME 0.02       /* least time constant, for RK4 with 10 ms [s] */
#define GAS_CONSTANT 287.05287    /* of air [J kg-1 K-1] */
#define HEAT_RATIO 1.3            /* of the burnt gas */
#define PRESSURE_SEA_LEVEL 101325.0
#define DENSITY_SEA_LEVEL 1.225
#define TEMPERATURE_SEA_LEVEL 288.15
#define TEMPERATURE_TROPOPAUSE 216.65
#define LAPSE_EXPONENT 0.190263   /* R L / g of the troposphere */
#define FOUR_PI 12.566370614359172
#define EMPTY_MANIFOLD 1.0        /* least pressure that is divided by [Pa] */

static inline real boosted(const real *p, real pressure, real speed) {
    const real turns = PICK(p[P_BOOST_RPM] > 0.0, speed / p[P_BOOST_RPM], 1.0);
    const real ratio = 1.0 + (p[P_BOOST_RATIO] - 1.0) * turns;
    return smaller(pressure * ratio, larger(p[P_BOOST_LIMIT], pressure));
}

/* Pressure in front of the compressor: the state, or what the recorded manifold pressure needs. */
static inline real before_compressor(const flight_t *sim, uint32_t i, const real *x,
                                     const real *u) {
    if (sim->drive != MAP_DRIVEN) return state_of(sim, x, G_PISTON, i)[X_MANIFOLD_PRESSURE];
    const real *p = par_of(sim, G_PISTON, i);
    const real speed = var_of(sim, G_PROPELLER, i)[A_ENGINE_RPM];
    const real turns = PICK(p[P_BOOST_RPM] > 0.0, speed / p[P_BOOST_RPM], 1.0);
    const real ratio = 1.0 + (p[P_BOOST_RATIO] - 1.0) * turns;
    return input_of(sim, u, G_PISTON, i)[U_MAP_DRIVE] / ratio;
}

void piston_variables(flight_t *sim, uint32_t i, const real *x, const real *u) {
    const now_r *now = &sim->now;
    const real *p = par_of(sim, G_PISTON, i);
    const real delta = now->p / PRESSURE_SEA_LEVEL;
    const real speed = var_of(sim, G_PROPELLER, i)[A_ENGINE_RPM];
    real *v = var_of(sim, G_PISTON, i);
    real rich = p[P_FULL_RICH];
    if (ANY(p[P_ENRICHMENT] == 1.0)) rich = PICK(p[P_ENRICHMENT] == 1.0, rich / delta, rich);
    const mask_t powered = (p[P_ENRICHMENT] != 1.0) & (p[P_ENRICHMENT] != 0.0);
    if (ANY(powered)) rich = PICK(powered, rich * POW(delta, -p[P_ENRICHMENT]), rich);
    v[A_MANIFOLD_PRESSURE] = sim->drive == MAP_DRIVEN
                                 ? input_of(sim, u, G_PISTON, i)[U_MAP_DRIVE]
                                 : boosted(p, before_compressor(sim, i, x, u), speed);
    v[A_MIXTURE] = input_of(sim, u, G_PISTON, i)[U_MIXTURE];
    v[A_FUEL_AIR_RATIO] = rich * larger(v[A_MIXTURE], 0.0);
    v[A_PISTON_PRESSURE_RATIO] = delta;
    v[A_DENSITY_RATIO] = now->rho / DENSITY_SEA_LEVEL;
}

/* Pressure in the manifold that the state follows. */
static real steady_manifold(const flight_t *sim, uint32_t i) {
    const now_r *now = &sim->now;
    const real *p = par_of(sim, G_PISTON, i);
    const real shut = 1.0 - clamp(var_of(sim, G_ENGINE, i)[A_THROTTLE], 0.0, 1.0);
    const real speed = var_of(sim, G_PROPELLER, i)[A_ENGINE_RPM];
    /* (1 + 0.2 M^2)^3.5 - 1 to 1e-7 of itself below Mach 0.6 */
    const real s = 0.2 * now->mach * now->mach;
    const real impact = s * (3.5 + s * (4.375 + s * (2.1875 + s * 0.2734375)));
    const real intake = now->p * (1.0 + p[P_RAM_RECOVERY] * impact);
    const real impedance = p[P_INTAKE_IMPEDANCE] + p[P_THROTTLE_IMPEDANCE] * shut * shut;
    const real ratio = has_terms(sim->model, G_PISTON, i, T_MAP_RATIO)
                           ? sum_of(sim, G_PISTON, i)[T_MAP_RATIO]
                           : 1.0 / (1.0 + speed * impedance);
    return ratio * intake;
}

/* Air of the engine; swept: displacement times turns over two [m3 s-1]. */
static real breathed(const flight_t *sim, uint32_t i, real swept) {
    const now_r *now = &sim->now;
    const real *p = par_of(sim, G_PISTON, i);
    const real manifold = var_of(sim, G_PISTON, i)[A_MANIFOLD_PRESSURE];
    const real most = p[P_COMPRESSION_RATIO];
    const real ratio = smaller(now->p / larger(manifold, EMPTY_MANIFOLD), most);
    const real filled = (HEAT_RATIO - 1.0) / HEAT_RATIO
                        + (most - ratio) / (HEAT_RATIO * (most - 1.0));
    return swept * p[P_VOLUMETRIC_EFFICIENCY] * filled * manifold / (GAS_CONSTANT * now->T);
}

/* Brake power of the tables at full flame. */
static real charted(const flight_t *sim, uint32_t i) {
    const real *sum = sum_of(sim, G_PISTON, i);
    if (!has_terms(sim->model, G_PISTON, i, T_CORRECTED_POWER)) return sum[T_POWER];
    const real delta = var_of(sim, G_PISTON, i)[A_PISTON_PRESSURE_RATIO];
    const real exponent = LAPSE_EXPONENT;
    const real standard = larger(TEMPERATURE_SEA_LEVEL * POW(delta, exponent),
                                 TEMPERATURE_TROPOPAUSE);
    return sum[T_POWER] + sum[T_CORRECTED_POWER] * root(standard / sim->now.T);
}

static inline mask_t supplied(const flight_t *sim, uint32_t i, const real *x, const real *u) {
    const mask_t open = NOT(input_of(sim, u, G_PISTON, i)[U_PISTON_CUTOFF] > SWITCHED);
    const mask_t left = fuel_left(sim, i, x, u);
    return open & left;
}

/* Whether the flame burns on, or lights. */
static inline mask_t fires(const flight_t *sim, uint32_t i, const real *x, const real *u) {
    const real *in = input_of(sim, u, G_PISTON, i);
    const real turns = var_of(sim, G_PROPELLER, i)[A_ENGINE_RPM];
    const mask_t fuelled = supplied(sim, i, x, u);
    const mask_t sparks = NOT(in[U_PISTON_FLAMEOUT] > SWITCHED);
    const mask_t turning = turns >= par_of(sim, G_PISTON, i)[P_FIRE_RPM];
    return fuelled & sparks & turning;
}

real piston_torque(flight_t *sim, uint32_t i, const real *x, const real *u, real *fuel_flow,
                   real *dx) {
    const real *p = par_of(sim, G_PISTON, i);
    const real *s = state_of(sim, x, G_PISTON, i);
    const real *sum = sum_of(sim, G_PISTON, i);
    const real speed = var_of(sim, G_PROPELLER, i)[A_ENGINE_RPM];
    const real b = s[X_PISTON_BURNING];
    const real swept = p[P_DISPLACEMENT] * speed / FOUR_PI;
    const real air = breathed(sim, i, swept);
    const real ratio = var_of(sim, G_PISTON, i)[A_FUEL_AIR_RATIO];
    const real mixed = PICK(supplied(sim, i, x, u), air * ratio, 0.0);
    const real chart = charted(sim, i);
    const real fired = chart + sum[T_FUEL_WORK] * mixed - swept * sum[T_FRICTION_PRESSURE];
    const real pumped = p[P_PUMPING] * swept * (before_compressor(sim, i, x, u) - sim->now.p);
    const real power = b * fired - sum[T_FRICTION_POWER] - (1.0 - b) * sum[T_MOTORING_POWER]
                       + pumped;
    const mask_t cranked = input_of(sim, u, G_PISTON, i)[U_PISTON_STARTER] > SWITCHED;
    const real crank = p[P_CRANK_TORQUE] * larger(1.0 - speed / p[P_CRANK_RPM], 0.0);
    real *rate = rate_of(sim, dx, G_PISTON, i);
    real *work = work_of(sim, G_PISTON, i);
    const real tabled = sum[T_PISTON_FUEL_FLOW] + sum[T_BSFC] * larger(chart, 0.0);
    *fuel_flow = mixed + b * larger(tabled, 0.0);
    rate[X_MANIFOLD_PRESSURE] = (steady_manifold(sim, i) - s[X_MANIFOLD_PRESSURE]) / p[P_MAP_TIME];
    rate[X_PISTON_BURNING] = (PICK(fires(sim, i, x, u), 1.0, 0.0) - b) / p[P_PISTON_FLAME_TIME];
    work[W_PISTON_FUEL_FLOW] = *fuel_flow;
    work[W_PISTON_AIR_FLOW] = air;
    return power / larger(speed, SLOW_SHAFT) + PICK(cranked, crank * (1.0 - b), 0.0);
}

void piston_outputs(const flight_t *sim, uint32_t i, real *y) {
    const real *v = var_of(sim, G_PISTON, i);
    const real *work = work_of(sim, G_PISTON, i);
    real *to = output_of(sim, y, G_PISTON, i);
    to[Y_MANIFOLD_PRESSURE] = v[A_MANIFOLD_PRESSURE];
    to[Y_FUEL_AIR_RATIO] = v[A_FUEL_AIR_RATIO];
    to[Y_PISTON_FUEL_FLOW] = work[W_PISTON_FUEL_FLOW];
    to[Y_PISTON_AIR_FLOW] = work[W_PISTON_AIR_FLOW];
    to[Y_PISTON_BURNING] = state_of(sim, sim->x, G_PISTON, i)[X_PISTON_BURNING];
}

#if ORIGINAL

void piston_start(am_sim *sim, uint32_t i) {
    double *s = rate_of(sim, sim->x, G_PISTON, i);
    const double *in = input_of(sim, sim->u, G_PISTON, i);
    s[X_MANIFOLD_PRESSURE] = sim->now.p;
    s[X_PISTON_BURNING] = supplied(sim, i, sim->x, sim->u) && !(in[U_PISTON_FLAMEOUT] > SWITCHED);
}

void piston_settle(am_sim *sim, uint32_t i) {
    rate_of(sim, sim->x, G_PISTON, i)[X_MANIFOLD_PRESSURE] = steady_manifold(sim, i);
}

bool piston_stalls(am_sim *sim, uint32_t i) {
    double *burning = rate_of(sim, sim->x, G_PISTON, i) + X_PISTON_BURNING;
    if (*burning == 0.0 || fires(sim, i, sim->x, sim->u)) return false;
    *burning = 0.0;
    return true;
}

int piston_check(am_sim *sim, uint32_t i) {
    static const uint32_t NOT_NEGATIVE[] = {
        P_DISPLACEMENT,       P_VOLUMETRIC_EFFICIENCY, P_RAM_RECOVERY, P_INTAKE_IMPEDANCE,
        P_THROTTLE_IMPEDANCE, P_BOOST_RPM,             P_FULL_RICH,    P_CRANK_TORQUE,
        P_FIRE_RPM,           P_ENRICHMENT,            P_PUMPING,      P_BOOST_LIMIT};
    static const uint32_t TIMES[] = {P_MAP_TIME, P_PISTON_FLAME_TIME};
    const uint32_t first = place(sim->model, AM_PARAMETER, G_PISTON, i);
    const double *p = par_of(sim, G_PISTON, i);
    for (size_t k = 0; k < sizeof NOT_NEGATIVE / sizeof NOT_NEGATIVE[0]; k++) {
        if (!(p[NOT_NEGATIVE[k]] >= 0.0)) {
            return bad_parameter(sim, first + NOT_NEGATIVE[k], "zero or positive");
        }
    }
    for (size_t k = 0; k < sizeof TIMES / sizeof TIMES[0]; k++) {
        if (!(p[TIMES[k]] >= QUICKEST_FLAME)) {
            return bad_parameter(sim, first + TIMES[k], "0.02 s or more");
        }
    }
    if (!(p[P_BOOST_RATIO] >= 1.0)) return bad_parameter(sim, first + P_BOOST_RATIO, "1 or more");
    if (!(p[P_COMPRESSION_RATIO] > 1.0)) {
        return bad_parameter(sim, first + P_COMPRESSION_RATIO, "more than 1");
    }
    if (!(p[P_CRANK_RPM] > 0.0)) return bad_parameter(sim, first + P_CRANK_RPM, "positive");
    return AM_OK;
}

#endif
