/* Velocity of the air at the aircraft: inputs wind_*, a profile over height, Dryden turbulence
 * and a 1 - cos gust.
 *
 * Spectra, scale lengths and intensities of MIL-F-8785C (1980), sec. 3.7; those of MIL-STD-1797A
 * are the same in other words: its 2 L_v and 2 L_w are the L_v and L_w here.  One-sided spectra
 * of the angular frequency w, T = L/V:
 *
 *     u  s^2 (2 T/pi) / (1 + (T w)^2)
 *     v  s^2 (T/pi) (1 + 3 (T w)^2) / (1 + (T w)^2)^2
 *     w  as v
 *     p  s_w^2/(V L_w) 0.8 (pi L_w/4b)^(1/3) / (1 + (4b w/pi V)^2)
 *     q  (w/V)^2 / (1 + (4b w/pi V)^2) times that of w
 *     r  (w/V)^2 / (1 + (3b w/pi V)^2) times that of v
 *
 * Turbulence is made on a grid of equal time steps from the start of the simulation: from point
 * to point by the exact transition of the linear filters, between points linear.  The deviates
 * are a function of seed and number of the point alone.  So steps of the integration and of the
 * communication do not change it; airspeed and height do, as they stand at the internal step in
 * which a point is made, unless turbulence.V, sigma and L are given.  It rises from calm at the
 * start.
 *
 * p, q, r of a gust are the rates at which the air turns about the body axes: p = dw/dy, q =
 * -dw/dx, r = dv/dx. */
#include "weather.h"

#include "algebra.h"
#include "earth.h"
#include "elementary.h"
#include "error.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846
#define FT 0.3048

static const double H20 = 20.0 * FT; /* height of the wind W20 */
/* range of the logarithmic profile */
static const double LOG_LOW = 3.0 * FT;
static const double LOG_TOP = 1000.0 * FT;
static const double L_HIGH = 1750.0 * FT;
static const double MAX_SEED = 9007199254740992.0; /* 2^53 */

/* MIL-F-8785C figure 7 (intensity of one probability of exceedance over altitude) as read by
 * JSBSim's FGWinds. [ft, ft/s] */
#define ALTITUDES 12
static const double ALTITUDE[ALTITUDES] = {500,   1750,  3750,  7500,  15000, 25000,
                                           35000, 45000, 55000, 65000, 75000, 80000};
static const double EXCEEDED[8][ALTITUDES] = {
    {0},                                          /* 0: none */
    {3.2, 2.2, 1.5, 0, 0, 0, 0, 0, 0, 0, 0, 0},   /* 1: 2e-1 */
    {4.2, 3.6, 3.3, 1.6, 0, 0, 0, 0, 0, 0, 0, 0}, /* 2: 1e-1 */
    /* 3: 1e-2, light */
    {6.6, 6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0, 0, 0, 0, 0},
    /* 4: 1e-3, moderate */
    {8.6, 9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0, 0, 0},
    {11.8, 13.0, 16.0, 15.1, 11.6, 9.7, 8.1, 8.2, 7.9, 4.9, 3.2, 2.1}, /* 5: 1e-4 */
    /* 6: 1e-5, severe */
    {15.6, 17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1},
    {18.7, 21.5, 28.4, 30.2, 30.7, 31.0, 25.2, 23.1, 17.5, 10.7, 8.4, 7.2}, /* 7: 1e-6 */
};

typedef struct {
    double V, sigma[3], L[3];
} field_t;

/* ---- parameters ------------------------------------------------------------------------------ */

static int refuse(am_sim *sim, int code, const char *rule) {
    return bad_parameter(sim, place(sim->model, AM_PARAMETER, G_WEATHER, 0) + (uint32_t)code, rule);
}

static bool is_whole_between(double x, double low, double high) {
    return x >= low && x <= high && x == floor(x);
}

static int check_profile(am_sim *sim, const double *par) {
    if (!(par[P_WIND_W20] >= 0.0)) return refuse(sim, P_WIND_W20, "zero or positive");
    if (!(par[P_WIND_ROUGHNESS] > 0.0 && par[P_WIND_ROUGHNESS] < LOG_LOW)) {
        return refuse(sim, P_WIND_ROUGHNESS, "between 0 and 0.9144 m");
    }
    if (!is_whole_between(par[P_WIND_ROWS], 0.0, WIND_ROWS)) {
        return refuse(sim, P_WIND_ROWS, "a whole number from 0 to 8");
    }
    for (int i = 1; i < (int)par[P_WIND_ROWS]; i++) {
        if (!(par[P_WIND_H1 + 4 * i] > par[P_WIND_H1 + 4 * (i - 1)])) {
            return refuse(sim, P_WIND_H1 + 4 * i, "more than the height before it");
        }
    }
    return AM_OK;
}

static bool gusty(const double *par) {
    return par[P_GUST_U] != 0.0 || par[P_GUST_V] != 0.0 || par[P_GUST_W] != 0.0;
}

int weather_check(am_sim *sim) {
    const double *par = par_of(sim, G_WEATHER, 0);
    const int status = check_profile(sim, par);
    if (status != AM_OK) return status;
    sim->windy = par[P_WIND_W20] > 0.0 || par[P_WIND_ROWS] > 0.0 || par[P_TURBULENCE] != 0.0
                 || gusty(par);
    if (!is_whole_between(par[P_TURBULENCE], 0.0, 1.0)) {
        return refuse(sim, P_TURBULENCE, "0 (none) or 1 (Dryden)");
    }
    if (!is_whole_between(par[P_SEED], 0.0, MAX_SEED)) {
        return refuse(sim, P_SEED, "a whole number from 0 to 2^53");
    }
    if (!is_whole_between(par[P_SEVERITY], 0.0, 7.0)) {
        return refuse(sim, P_SEVERITY, "a whole number from 0 (none aloft) to 7");
    }
    if (!(par[P_TURBULENCE_STEP] >= 1e-3 && par[P_TURBULENCE_STEP] <= 1.0)) {
        return refuse(sim, P_TURBULENCE_STEP, "between 0.001 and 1 s");
    }
    if (!(par[P_TURBULENCE_W20] >= 0.0)) return refuse(sim, P_TURBULENCE_W20, "zero or positive");
    for (int i = 0; i < 3; i++) {
        if (par[P_L_U + i] == 0.0) {
            return refuse(sim, P_L_U + i, "positive, or negative for that of the model");
        }
    }
    if (!is_whole_between(par[P_GUST_HOLD], 0.0, 1.0)) {
        return refuse(sim, P_GUST_HOLD, "0 (falls again) or 1 (stays)");
    }
    if (!(par[P_GUST_RISE] > 0.0)) return refuse(sim, P_GUST_RISE, "positive");
    return AM_OK;
}

/* ---- steady wind over height ----------------------------------------------------------------- */

/* Logarithmic boundary layer, MIL-F-8785C sec. 3.7.3.3: W20 ln(h/z0) / ln(20 ft/z0) from 3 to
 * 1000 ft, held outside. */
static void add_boundary_layer(const double *par, double agl, double wind[3]) {
    const double h = clamp(agl, LOG_LOW, LOG_TOP);
    const double z0 = par[P_WIND_ROUGHNESS];
    const double speed = par[P_WIND_W20] * am_log(h / z0) / am_log(H20 / z0);
    double s, c;
    am_sincos(par[P_WIND_FROM], &s, &c);
    wind[0] -= speed * c;
    wind[1] -= speed * s;
}

/* Rows of height and wind, linear between, held beyond the ends. */
static void add_rows(const double *row, int rows, double h, double wind[3]) {
    int i = 0;
    while (i + 2 < rows && h > row[4 * (i + 1)]) i++;
    const double *low = row + 4 * i;
    const double *high = i + 1 < rows ? low + 4 : low;
    const double part = high > low ? clamp((h - low[0]) / (high[0] - low[0]), 0.0, 1.0) : 0.0;
    for (int k = 1; k < 4; k++) wind[k - 1] += low[k] + (high[k] - low[k]) * part;
}

void steady_wind(const am_sim *sim, const double *u, double h, double wind[3]) {
    const double *par = par_of(sim, G_WEATHER, 0);
    sheared_wind(par, u, h, wind);
    if (par[P_WIND_W20] > 0.0) add_boundary_layer(par, h - sim->par[P_RUNWAY], wind);
    if (par[P_WIND_ROWS] > 0.0) add_rows(par + P_WIND_H1, (int)par[P_WIND_ROWS], h, wind);
}

/* ---- normal deviates ------------------------------------------------------------------------- */

#define GOLDEN UINT64_C(0x9E3779B97F4A7C15)

/* The finaliser of splitmix64: Steele, Lea and Flood, OOPSLA 2014. */
static uint64_t mix(uint64_t z) {
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

/* Number n of the sequence that belongs to a seed, in (0, 1]. */
static double uniform(uint64_t seed, uint64_t n) {
    return (double)((mix(mix(seed + GOLDEN) + (n + 1) * GOLDEN) >> 11) + 1) * 0x1p-53;
}

/* Six normal deviates of a grid point: Box and Muller (1958). */
static void deviates(double seed, double point, double z[6]) {
    const uint64_t key = (uint64_t)seed;
    const uint64_t first = 6 * (uint64_t)point;
    for (unsigned i = 0; i < 6; i += 2) {
        const double r = sqrt(-2.0 * am_log(uniform(key, first + i)));
        double s, c;
        am_sincos(2.0 * PI * uniform(key, first + i + 1), &s, &c);
        z[i] = r * c;
        z[i + 1] = r * s;
    }
}

/* ---- turbulence ------------------------------------------------------------------------------ */

static double intensity_aloft(int severity, double h) {
    const double *curve = EXCEEDED[severity];
    const double at = clamp(h / FT, ALTITUDE[0], ALTITUDE[ALTITUDES - 1]);
    int i = 0;
    while (i + 2 < ALTITUDES && at > ALTITUDE[i + 1]) i++;
    return FT
           * (curve[i]
              + (curve[i + 1] - curve[i]) * ((at - ALTITUDE[i]) / (ALTITUDE[i + 1] - ALTITUDE[i])));
}

/* 0 up to 1000 ft over the runway, 1 from 2000 ft: MIL-F-8785C sec. 3.7.2 and 3.7.3, linear
 * between. */
static double aloft(double agl) { return clamp(agl / FT / 1000.0 - 1.0, 0.0, 1.0); }

static void set_field(const am_sim *sim, const double *par, double h, field_t *f) {
    const double agl = h - sim->par[P_RUNWAY];
    const double high = aloft(agl);
    const double low_h = clamp(agl / FT, 10.0, 1000.0);
    const double base = 0.177 + 0.000823 * low_h;
    const double sigma_w = 0.1 * par[P_TURBULENCE_W20];
    const double low_sigma[3] = {sigma_w / am_pow(base, 0.4), sigma_w / am_pow(base, 0.4), sigma_w};
    const double along = FT * low_h / am_pow(base, 1.2);
    const double low_L[3] = {along, along, FT * low_h};
    const double high_sigma = intensity_aloft((int)par[P_SEVERITY], h);
    for (int i = 0; i < 3; i++) {
        const double sigma = par[P_SIGMA_U + i];
        const double L = par[P_L_U + i];
        f->sigma[i] = sigma >= 0.0 ? sigma : low_sigma[i] + (high_sigma - low_sigma[i]) * high;
        f->L[i] = L > 0.0 ? L : low_L[i] + (L_HIGH - low_L[i]) * high;
    }
}

/* From the state at the start of the internal step, not from the last derivative: outputs in
 * between change nothing. */
static void conditions(const am_sim *sim, const double *par, const double *u, field_t *f) {
    const double *x = sim->x;
    double wind[3];
    double square = 0.0;
    now_t there;
    place_of(x, sim->earth, &there);
    set_field(sim, par, there.h, f);
    f->V = par[P_TURBULENCE_V];
    if (f->V >= 0.0) return;
    steady_wind(sim, u, there.h, wind);
    for (int i = 0; i < 3; i++) {
        const double v =
            x[3 + i]
            - (wind[0] * there.north[i] + wind[1] * there.east[i] + wind[2] * there.down[i]);
        square += v * v;
    }
    f->V = sqrt(square);
}

/* a' = (noise - a)/T, unit variance, over a step x = dt/T. */
static void first_order(double x, double z, double *a) {
    const double decay = am_exp(-x);
    *a = decay * *a + sqrt(1.0 - decay * decay) * z;
}

/* a as above and c' = (a - c)/T, covariance [1, 1/2; 1/2, 1/2]; (sqrt3 a + (1 - sqrt3) c)/sqrt2
 * has the spectrum of v and w. The covariance of the step is that of the process less what the
 * decay leaves of it. */
static double second_order(double x, double z1, double z2, double s[2]) {
    x = fmin(x, 100.0); /* nothing is left by then, and the square stays finite */
    const double decay = am_exp(-x);
    const double left = decay * decay;
    const double root3 = 1.7320508075688772;
    const double root2 = 1.4142135623730951;
    const double aa = 1.0 - left;
    const double ac = 0.5 - left * (0.5 + x);
    const double cc = 0.5 - left * (0.5 + x + x * x);
    const double la = sqrt(aa);
    const double l1 = la > 0.0 ? ac / la : 0.0;
    const double rest = cc - l1 * l1;
    const double l2 = rest > 0.0 ? sqrt(rest) : 0.0;
    s[1] = decay * (s[1] + x * s[0]) + l1 * z1 + l2 * z2;
    s[0] = decay * s[0] + la * z1;
    return (root3 * s[0] + (1.0 - root3) * s[1]) / root2;
}

/* y less its low-passed value over a step x = dt/T in which y rises by `rise`, exact for linear
 * y; over T it is the rate of the low-passed value. */
static void follow_lag(double x, double rise, double *lag) {
    const double decay = am_exp(-x);
    *lag = decay * *lag + rise * (x > 1e-8 ? (1.0 - decay) / x : 1.0);
}

/* Makes the turbulence at the next grid point and takes the interval up to it. */
static void next_point(am_sim *sim, const double *par, const double *u, double *d) {
    field_t f;
    double z[6];
    double *s = d + D_FILTER;
    double *right = d + D_RIGHT;
    conditions(sim, par, u, &f);
    memcpy(d + D_LEFT, right, 6 * sizeof *d);
    d[D_GRID_INDEX] += 1.0;
    deviates(par[P_SEED], d[D_GRID_INDEX] + 1.0, z);
    const double way = f.V * par[P_TURBULENCE_STEP];
    const double b = sim->model->b;
    const double turn = PI * way / b;
    first_order(way / f.L[0], z[0], s);
    right[0] = f.sigma[0] * s[0];
    right[1] = f.sigma[1] * second_order(way / f.L[1], z[1], z[2], s + 1);
    right[2] = f.sigma[2] * second_order(way / f.L[2], z[3], z[4], s + 3);
    first_order(turn / 4.0, z[5], s + 5);
    right[3] = f.sigma[2] * sqrt(0.1 * PI * PI / (b * f.L[2]))
               * am_pow(PI * f.L[2] / (4.0 * b), 1.0 / 6.0) * s[5];
    follow_lag(turn / 3.0, right[1] - d[D_LEFT + 1], d + D_LAG);
    follow_lag(turn / 4.0, right[2] - d[D_LEFT + 2], d + D_LAG + 1);
    right[4] = -PI / (4.0 * b) * d[D_LAG + 1];
    right[5] = PI / (3.0 * b) * d[D_LAG];
}

#define MOST_POINTS 100000.0 /* in one step: what lies farther back the filters have forgotten */

static double grid_time(const double *par, const double *d, double point) {
    return d[D_GRID_START] + point * par[P_TURBULENCE_STEP];
}

static void turbulence_at(am_sim *sim, const double *par, const double *u, double t, double *d,
                          double gust[6]) {
    const double behind = floor((t - d[D_GRID_START]) / par[P_TURBULENCE_STEP]) - d[D_GRID_INDEX];
    if (behind > MOST_POINTS) d[D_GRID_INDEX] += behind - MOST_POINTS;
    while (grid_time(par, d, d[D_GRID_INDEX] + 1.0) < t) next_point(sim, par, u, d);
    const double part = clamp((t - grid_time(par, d, d[D_GRID_INDEX])) / par[P_TURBULENCE_STEP],
                              0.0, 1.0);
    for (int i = 0; i < 6; i++) gust[i] = d[D_LEFT + i] + (d[D_RIGHT + i] - d[D_LEFT + i]) * part;
}

/* ---- discrete gust --------------------------------------------------------------------------- */

/* (1 - cos)/2 up to the peak, then back (14 CFR 25.341) or held (MIL-F-8785C sec. 3.7.1.3). */
static double gust_shape(const double *par, double t) {
    const double part = (t - par[P_GUST_START]) / par[P_GUST_RISE];
    const double end = par[P_GUST_HOLD] != 0.0 ? 1.0 : 2.0;
    return 0.5 * (1.0 - am_cos(PI * clamp(part, 0.0, end)));
}

/* ---- calls of the core ----------------------------------------------------------------------- */

void weather_start(am_sim *sim, double t) {
    double *d = memory_of(sim, G_WEATHER, 0);
    memset(d, 0, D_PER_WEATHER * sizeof *d);
    d[D_GRID_START] = t;
    d[D_GRID_INDEX] = -1.0; /* grid point 0 is calm */
}

bool weather_memory_valid(const am_sim *sim) {
    const double *d = memory_of(sim, G_WEATHER, 0);
    return fabs(d[D_GRID_START]) <= LATEST && is_whole_between(d[D_GRID_INDEX], -1.0, 1e15);
}

void weather_advance(am_sim *sim, double t, double h, const double *u0, const double *u1) {
    const double *par = par_of(sim, G_WEATHER, 0);
    double *d = memory_of(sim, G_WEATHER, 0);
    const bool rough = par[P_TURBULENCE] != 0.0;
    const bool discrete = gusty(par);
    (void)u1;
    if (!rough && d[D_LIVE] != 0.0) memset(d + D_AT, 0, 21 * sizeof *d);
    d[D_LIVE] = rough || discrete;
    if (!rough && !discrete) return;
    /* switched on under way */
    if (rough && t > grid_time(par, d, d[D_GRID_INDEX] + 2.0)) {
        d[D_GRID_INDEX] = floor((t - d[D_GRID_START]) / par[P_TURBULENCE_STEP]);
    }
    for (int i = 0; i < 3; i++) {
        const double at = t + 0.5 * (double)i * h;
        if (rough) turbulence_at(sim, par, u0, at, d, d + D_AT + 6 * i);
        if (discrete) d[D_SHAPE + i] = gust_shape(par, at);
    }
}

/* Turbulence in its own axes at a part of the internal step; returns the discrete gust over its
 * peak. */
static double moment(const double *d, double part, double gust[6]) {
    const int i = part > 0.5;
    const double s = 2.0 * part - (double)i;
    const double *from = d + D_AT + 6 * i;
    const double *shape = d + D_SHAPE + i;
    for (int k = 0; k < 6; k++) gust[k] = from[k] + (from[6 + k] - from[k]) * s;
    return shape[0] + (shape[1] - shape[0]) * s;
}

static void body_to_local(const now_t *now, const double body[3], double ned[3]) {
    double earth[3];
    from_body(now->C, body, earth);
    ned[0] = dot(earth, now->north);
    ned[1] = dot(earth, now->east);
    ned[2] = dot(earth, now->down);
}

/* u, v, w of the low model are horizontal along the body x axis, horizontal to the right, and
 * down. */
static void level_to_local(const now_t *now, const double gust[3], double ned[3]) {
    const double n = dot(now->C[0], now->north);
    const double e = dot(now->C[0], now->east);
    const double size = sqrt(n * n + e * e);
    const double c = size > 1e-9 ? n / size : 1.0;
    const double s = size > 1e-9 ? e / size : 0.0;
    ned[0] = gust[0] * c - gust[1] * s;
    ned[1] = gust[0] * s + gust[1] * c;
    ned[2] = gust[2];
}

/* Gust velocity n, e, d and rates at the moment of the derivative. */
static void gust_here(am_sim *sim, const double *par, const double *d, double ned[3]) {
    now_t *now = &sim->now;
    double gust[6], level[3], body[3], peak[3];
    const double shape = moment(d, sim->part, gust);
    const double high = aloft(now->h - sim->par[P_RUNWAY]);
    level_to_local(now, gust, level);
    for (int i = 0; i < 3; i++) peak[i] = high * gust[i] + shape * par[P_GUST_U + i];
    body_to_local(now, peak, body);
    for (int i = 0; i < 3; i++) ned[i] = body[i] + (1.0 - high) * level[i];
    memcpy(now->gust_rate, gust + 3, sizeof now->gust_rate);
}

void weather_wind(am_sim *sim, const double *u, double wind[3]) {
    const double *par = par_of(sim, G_WEATHER, 0);
    const double *d = memory_of(sim, G_WEATHER, 0);
    double *work = work_of(sim, G_WEATHER, 0);
    steady_wind(sim, u, sim->now.h, wind);
    memset(work + W_GUST, 0, 3 * sizeof *work);
    memset(sim->now.gust_rate, 0, sizeof sim->now.gust_rate);
    if (d[D_LIVE] != 0.0) gust_here(sim, par, d, work + W_GUST);
    for (int i = 0; i < 3; i++) work[W_WIND + i] = wind[i] += work[W_GUST + i];
}

void weather_outputs(am_sim *sim, double *y) {
    const double *work = work_of(sim, G_WEATHER, 0);
    air_outputs(&sim->now, work + W_WIND, work + W_GUST, output_of(sim, y, G_WEATHER, 0));
}
