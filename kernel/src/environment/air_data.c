/* US Standard Atmosphere 1976 below 84.852 km, moved by a temperature offset and the pressure at
 * sea level, and air data.
 *
 * The offset is added to the temperature of every layer and the pressure follows
 * hydrostatically; with an offset of zero and 101325 Pa this is the standard itself.  Constants
 * are those of ISO 2533 and ICAO Doc 7488, which is the same atmosphere: R with M0 = 28.96442
 * kg/kmol gives the 1.225 kg m-3 at sea level that the US document prints. */
#include "air_data.h"

#include "elementary_real.h"

#include <math.h>

#define R_AIR 287.05287                       /* [J kg-1 K-1] */
static const double EARTH_RADIUS = 6356766.0; /* of the geopotential height [m] */
static const double RATIO = 1.4;              /* specific heats */
static const double P_SEA = 101325.0;
static const double A_SEA = 340.29398802608895;
static const double T_SEA = 288.15;
/* geopotential height of the base [m], gradient [K m-1]: U.S. Standard Atmosphere 1976, table 4 */
static const double BASE[LAYERS] = {0.0, 11000.0, 20000.0, 32000.0, 47000.0, 51000.0, 71000.0};
static const double GRADIENT[LAYERS] = {-0.0065, 0.0, 0.001, 0.0028, 0.0, -0.0028, -0.002};
static const double TOP = 84852.0;
static const double LOWEST = -5000.0;
#define NEAR_H 40.0       /* of an anchor [m] */
#define NEAR_TANGENT 4e-3 /* of an angle from that of the anchor */

/* Binomial coefficients of the exponent of the troposphere, each from the one before. */
#define K (G0 / (R_AIR * 0.0065))
#define B2 (K * (K - 1) / 2)
#define B3 (B2 * (K - 2) / 3)
#define B4 (B3 * (K - 3) / 4)
#define B5 (B4 * (K - 4) / 5)
#define B6 (B5 * (K - 5) / 6)
#define B7 (B6 * (K - 6) / 7)
#define B8 (B7 * (K - 7) / 8)
#define B9 (B8 * (K - 8) / 9)
#define B10 (B9 * (K - 9) / 10)
#define B11 (B10 * (K - 10) / 11)
#define B12 (B11 * (K - 11) / 12)
#define B13 (B12 * (K - 12) / 13)
#define B14 (B13 * (K - 13) / 14)
#define B15 (B14 * (K - 14) / 15)
#define B16 (B15 * (K - 15) / 16)
#define B17 (B16 * (K - 16) / 17)
#define B18 (B17 * (K - 17) / 18)

/* (1 + u)^K for |u| <= 1/4, where the terms left out are below 2e-17: twice as fast as a power,
 * as flight below 11 km needs it. */
static real troposphere(real u) {
    const real u2 = u * u;
    const real u4 = u2 * u2;
    const real u8 = u4 * u4;
    const real q0 = (1.0 + K * u) + u2 * (B2 + B3 * u);
    const real q4 = (B4 + B5 * u) + u2 * (B6 + B7 * u);
    const real q8 = (B8 + B9 * u) + u2 * (B10 + B11 * u);
    const real q12 = (B12 + B13 * u) + u2 * (B14 + B15 * u);
    return (q0 + u4 * q4) + u8 * ((q8 + u4 * q12) + u8 * (B16 + u * (B17 + u * B18)));
}

/* Pressure at H in layer i. */
static real layer_pressure(const layers_r *atm, int i, real H) {
    const real dH = H - BASE[i];
    if (GRADIENT[i] == 0.0) return atm->p[i] * EXP(-G0 * dH / (R_AIR * atm->T[i]));
    const real u = GRADIENT[i] * dH / atm->T[i];
    const mask_t near = size_of(u) <= (i == 0 ? 0.25 : -1.0);
    if (EVERY(near)) return atm->p[i] * troposphere(u);
    const real power = POW(1.0 + u, (real)(-G0 / (R_AIR * GRADIENT[i])));
    return atm->p[i] * (ANY(near) ? PICK(near, troposphere(u), power) : power);
}

#if ORIGINAL

void set_atmosphere(atmosphere_t *atm, double delta_T, double qnh) {
    atm->T[0] = T_SEA + delta_T;
    atm->p[0] = qnh;
    for (int i = 1; i < LAYERS; i++) {
        atm->T[i] = atm->T[i - 1] + GRADIENT[i - 1] * (BASE[i] - BASE[i - 1]);
        atm->p[i] = layer_pressure(atm, i - 1, BASE[i]);
    }
}

void set_standard(atmosphere_t *atm) { set_atmosphere(atm, 0.0, P_SEA); }

#endif

/* Above the top layer the values of its upper end hold; below sea level the first layer goes on
 * to -5 km. */
static real geopotential(real h) {
    const real H = EARTH_RADIUS * h / (EARTH_RADIUS + h);
    return PICK(H > TOP, TOP, PICK(H < LOWEST, LOWEST, H));
}

static void layer_state(const layers_r *atm, real H, real *T, real *p) {
    *T = *p = 0.0;
    for (int i = 0; i < LAYERS; i++) {
        const mask_t above = H > BASE[i];
        if (i > 0 && !ANY(above)) break;
        if (i + 1 < LAYERS && EVERY(H > BASE[i + 1])) continue;
        const real T_here = atm->T[i] + GRADIENT[i] * (H - BASE[i]);
        const real p_here = layer_pressure(atm, i, H);
        *T = i == 0 ? T_here : PICK(above, T_here, *T);
        *p = i == 0 ? p_here : PICK(above, p_here, *p);
    }
}

static mask_t in_troposphere(real H) {
    mask_t inside = H > LOWEST;
    inside &= H <= BASE[1];
    return inside;
}

/* p (T / T_anchor)^K by the binomial series; within NEAR_H its next term is below 2e-19. */
static real pressure_near(const anchor_r *anchor, real T) {
    const real u = (T - anchor->T) * anchor->per_T;
    const real q = (K + B2 * u) + u * u * ((B3 + B4 * u) + u * u * B5);
    return anchor->p + anchor->p * (u * q);
}

/* Sets *near where the anchor is. */
static void state_near(const layers_r *atm, const anchor_r *anchor, real H, real *T, real *p) {
    mask_t near = in_troposphere(H);
    near &= in_troposphere(anchor->H);
    near &= size_of(H - anchor->H) < NEAR_H;
    if (!ANY(near)) {
        layer_state(atm, H, T, p);
        return;
    }
    const real T_near = atm->T[0] + GRADIENT[0] * (H - BASE[0]);
    const real p_near = pressure_near(anchor, T_near);
    *T = T_near;
    *p = p_near;
    if (EVERY(near)) return;
    layer_state(atm, H, T, p);
    *T = PICK(near, T_near, *T);
    *p = PICK(near, p_near, *p);
}

void atmosphere_at(const layers_r *atm, const anchor_r *anchor, real h, real *T, real *p, real *rho,
                   real *a) {
    const real H = geopotential(h);
    if (anchor) state_near(atm, anchor, H, T, p);
    else layer_state(atm, H, T, p);
    *rho = *p / (R_AIR * *T);
    *a = root(RATIO * R_AIR * *T);
}

void anchor_air(const now_r *now, anchor_r *anchor) {
    anchor->H = geopotential(now->h);
    anchor->T = now->T;
    anchor->per_T = 1.0 / now->T;
    anchor->p = now->p;
    anchor->u = now->u;
    anchor->v = now->v;
    anchor->w = now->w;
    anchor->Vxz = now->Vxz;
    anchor->alpha = now->alpha;
    anchor->beta = now->beta;
}

/* Height of the standard atmosphere with this pressure: what an altimeter set to 1013.25 hPa
 * shows. */
real pressure_altitude(const layers_r *standard, real p) {
    real h = 0.0;
    for (int i = 0; i < LAYERS; i++) {
        const mask_t above = p < standard->p[i];
        if (i > 0 && !ANY(above)) break;
        if (i + 1 < LAYERS && EVERY(p < standard->p[i + 1])) continue;
        const real ratio = p / standard->p[i];
        const real here = GRADIENT[i] == 0.0
                              ? BASE[i] - R_AIR * standard->T[i] / G0 * LOG(ratio)
                              : BASE[i]
                                    + standard->T[i] / GRADIENT[i]
                                          * (POW(ratio, (real)(-R_AIR * GRADIENT[i] / G0)) - 1.0);
        h = i == 0 ? here : PICK(above, here, h);
    }
    return h;
}

/* The angle of (x, y) from that of (x0, y0) by the tangent of the difference; the first term that
 * the series leaves out is a seventh of its seventh power, below 3e-18. */
static real angle_near(real y, real x, real y0, real x0, real angle0) {
    const real along = x * x0 + y * y0;
    const real t = (y * x0 - x * y0) / along;
    const real t2 = t * t;
    mask_t near = size_of(t) < NEAR_TANGENT;
    near &= along > 0.0;
    near &= size_of(angle0) < 3.0; /* far from where it jumps */
    if (!ANY(near)) return ATAN2(y, x);
    const real angle = angle0 + t * (1.0 - t2 * (1.0 / 3.0 - t2 * (1.0 / 5.0)));
    return EVERY(near) ? angle : PICK(near, angle, ATAN2(y, x));
}

/* From the velocity relative to the air in body axes.  Nothing is divided by V, so that rest and
 * 90 degrees are safe. */
void air_data(now_r *now, const anchor_r *anchor, const real velocity[3]) {
    const real u = velocity[0];
    const real v = velocity[1];
    const real w = velocity[2];
    now->u = u;
    now->v = v;
    now->w = w;
    now->Vxz = root(u * u + w * w);
    now->V = root(u * u + v * v + w * w);
    now->per_Vxz = PICK(now->Vxz > 0.0, 1.0 / now->Vxz, 0.0);
    now->per_V = PICK(now->V > 0.0, 1.0 / now->V, 0.0);
    now->ca = PICK(now->Vxz > 0.0, u * now->per_Vxz, 1.0);
    now->sa = w * now->per_Vxz;
    now->cb = PICK(now->V > 0.0, now->Vxz * now->per_V, 1.0);
    now->sb = v * now->per_V;
    if (anchor) {
        now->alpha = angle_near(w, u, anchor->w, anchor->u, anchor->alpha);
        now->beta = angle_near(v, now->Vxz, anchor->v, anchor->Vxz, anchor->beta);
    } else {
        now->alpha = ATAN2(w, u);
        now->beta = ATAN2(v, now->Vxz);
    }
    now->mach = now->V / now->a;
    now->qbar = 0.5 * now->rho * now->V * now->V;
}

static real power_2_5(real x) { return x * x * root(x); }
static real power_3_5(real x) { return x * x * x * root(x); }

/* Impact pressure over static pressure: isentropic below Mach 1, Rayleigh's pitot formula above. */
static real impact_ratio(real mach) {
    const real M2 = mach * mach;
    const mask_t slow = mach <= 1.0;
    const real below = power_3_5(1.0 + 0.2 * M2) - 1.0;
    if (EVERY(slow)) return below;
    return PICK(slow, below, power_3_5(1.2 * M2) * power_2_5(6.0 / (7.0 * M2 - 1.0)) - 1.0);
}

real calibrated_airspeed(real mach, real p) {
    const real ratio = p * impact_ratio(mach) / P_SEA;
    const real low = root(5.0 * (POW(1.0 + ratio, (real)(1.0 / 3.5)) - 1.0));
    const mask_t fast = low > 1.0;
    if (!ANY(fast)) return low * A_SEA;
    /* Rayleigh's formula solved for the leading Mach number; a contraction, 1e-15 after 40
     * rounds at M = 1 */
    real M = low;
    for (int i = 0; i < 40; i++) {
        M = root((1.0 + ratio) * power_2_5(7.0 - 1.0 / (M * M))
                 / (power_2_5((real)6.0) * power_3_5((real)1.2)));
    }
    return PICK(fast, M, low) * A_SEA;
}

#undef K
