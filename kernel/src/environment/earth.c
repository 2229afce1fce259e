/* The Earth: WGS-84 ellipsoid with J2 gravitation, a sphere with inverse-square gravitation, or
 * a flat plane with constant gravity in north-east-down axes. */
#include "earth.h"

#include "algebra.h"
#include "elementary_real.h"

#include <math.h>

static const double A = 6378137.0; /* equatorial radius [m] */
static const double F = 1.0 / 298.257223563;
static const double MU = 3.986004418e14; /* [m3 s-2] */
static const double J2 = 0.00108262982;
/* radius of the sphere: NASA/TM-2015-218675, table 73 [m] */
static const double SPHERE = 6371007.1809;

static const double NEAR = 30.0; /* of an anchor [m] */

static bool spherical(int earth) { return earth == SPHERE_FIXED || earth == SPHERE_ROTATING; }

static inline void set3(real to[3], real x, real y, real z) {
    to[0] = x;
    to[1] = y;
    to[2] = z;
}

static inline void local_axes(real sin_lat, real cos_lat, real sin_lon, real cos_lon, now_r *now) {
    set3(now->north, -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
    set3(now->east, -sin_lon, cos_lon, (real)0.0);
    set3(now->down, -cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat);
}

static void flat_axes(now_r *now) {
    for (int i = 0; i < 3; i++) {
        now->north[i] = i == 0 ? 1.0 : 0.0;
        now->east[i] = i == 1 ? 1.0 : 0.0;
        now->down[i] = i == 2 ? 1.0 : 0.0;
    }
}

#if ORIGINAL

void place_at(double lat, double lon, double h, int earth, double position[3], now_t *now) {
    if (earth == FLAT_EARTH) {
        set3(position, 0.0, 0.0, -h);
        flat_axes(now);
        return;
    }
    double s, c, sin_lon, cos_lon;
    am_sincos(lat, &s, &c);
    am_sincos(lon, &sin_lon, &cos_lon);
    const double e2 = spherical(earth) ? 0.0 : F * (2.0 - F);
    const double N = spherical(earth) ? SPHERE : A / sqrt(1.0 - e2 * s * s);
    set3(position, (N + h) * c * cos_lon, (N + h) * c * sin_lon, (N * (1.0 - e2) + h) * s);
    local_axes(s, c, sin_lon, cos_lon, now);
}

#endif

/* Sine and cosine of the geodetic latitude, P from the axis.  Bowring (1976), one iteration:
 * 3e-9 m in height up to 20 km. */
static real ellipsoid_height(real P, real z, real *s, real *c) {
    const double e2 = F * (2.0 - F);
    const double B = A * (1.0 - F);
    /* parametric latitude: tan = z / (P (1 - f)) */
    const real tc = P * (1.0 - F);
    const real tn = 1.0 / root(z * z + tc * tc);
    const real sb = z * tn;
    const real cb = tc * tn;
    const real ls = z + e2 * A * A / B * sb * sb * sb;
    const real lc = P - e2 * A * cb * cb * cb;
    const real ln = 1.0 / root(ls * ls + lc * lc);
    *s = ls * ln;
    *c = lc * ln;
    return P * *c + z * *s - A * root(1.0 - e2 * *s * *s);
}

static real sphere_height(real P, real z, real *s, real *c) {
    const real r = root(P * P + z * z);
    *s = z / r;
    *c = P / r;
    return r - SPHERE;
}

/* Height and local axes. */
void place_of(const real position[3], int earth, now_r *now) {
    if (earth == FLAT_EARTH) {
        flat_axes(now);
        now->h = -position[2];
        return;
    }
    const real x = position[0];
    const real y = position[1];
    const real z = position[2];
    const real P = root(x * x + y * y);
    const real from_axis = PICK(P > 0.0, 1.0 / P, 0.0);
    real s, c;
    now->h = spherical(earth) ? sphere_height(P, z, &s, &c) : ellipsoid_height(P, z, &s, &c);
    local_axes(s, c, y * from_axis, PICK(P > 0.0, x * from_axis, 1.0), now);
}

/* now holds the place of the position. */
void set_anchor(const real position[3], int earth, const now_r *now, anchor_r *anchor) {
    const double e2 = spherical(earth) ? 0.0 : F * (2.0 - F);
    const real s = now->down[2];
    const real w = 1.0 - e2 * s * s;
    const real N = spherical(earth) ? (real)SPHERE : A / root(w);
    for (int i = 0; i < 3; i++) {
        anchor->position[i] = position[i];
        anchor->north[i] = now->north[i];
        anchor->east[i] = now->east[i];
        anchor->down[i] = now->down[i];
    }
    anchor->h = now->h;
    anchor->meridian = N * (1.0 - e2) / w + now->h;
    anchor->transverse = N + now->h;
}

/* place_of by the second order of the displacement d, for the later slopes of a step: a third of
 * the time.  What is neglected is d^3 / R^2 of the height, 7e-10 m at NEAR, and 0.01 (d / R)^2 of
 * the directions, 2e-13. */
static void place_by(const real position[3], const real d[3], const anchor_r *anchor,
                     now_r *now) {
    const real n = dot(d, anchor->north);
    const real e = dot(d, anchor->east);
    const real down = dot(d, anchor->down);
    const real a = n / (anchor->meridian - down);
    const real b = e / (anchor->transverse - down);
    const real c = 1.0 - 0.5 * (a * a + b * b);
    const real x = position[0];
    const real y = position[1];
    const real P = root(x * x + y * y);
    const real from_axis = PICK(P > 0.0, 1.0 / P, 0.0);
    now->h = anchor->h - down + 0.5 * (n * a + e * b);
    for (int i = 0; i < 3; i++) {
        now->down[i] = c * anchor->down[i] - a * anchor->north[i] - b * anchor->east[i];
    }
    set3(now->east, -y * from_axis, PICK(P > 0.0, x * from_axis, 1.0), (real)0.0);
    cross(now->east, now->down, now->north);
}

void place_near(const real position[3], int earth, const anchor_r *anchor, now_r *now) {
    const real d[3] = {position[0] - anchor->position[0], position[1] - anchor->position[1],
                       position[2] - anchor->position[2]};
    const mask_t near = dot(d, d) < NEAR * NEAR;
    if (EVERY(near)) {
        place_by(position, d, anchor, now);
        return;
    }
    place_of(position, earth, now);
    if (!ANY(near)) return;
    const now_r far = *now;
    place_by(position, d, anchor, now);
    now->h = PICK(near, now->h, far.h);
    for (int i = 0; i < 3; i++) {
        now->north[i] = PICK(near, now->north[i], far.north[i]);
        now->east[i] = PICK(near, now->east[i], far.east[i]);
        now->down[i] = PICK(near, now->down[i], far.down[i]);
    }
}

/* Latitude and longitude; on the flat Earth by the radii of curvature at the start. */
void locate_angles(const flight_t *sim, const real position[3], now_r *now) {
    if (sim->earth != FLAT_EARTH) {
        now->lat = ATAN2(-now->down[2], now->north[2]);
        now->lon = ATAN2(-now->east[0], now->east[1]);
        return;
    }
    real s, c;
    SINCOS(sim->par[P_LAT], &s, &c);
    const real h = sim->par[P_H];
    const double e2 = F * (2.0 - F);
    const real n = 1.0 - e2 * s * s;
    now->lat = sim->par[P_LAT] + position[0] / (A * (1.0 - e2) / (n * root(n)) + h);
    now->lon = sim->par[P_LON] + position[1] / ((A / root(n) + h) * c);
}

/* Mass attraction without the centrifugal part. */
void gravitation(const real position[3], int earth, real g[3]) {
    if (earth == FLAT_EARTH) {
        set3(g, (real)0.0, (real)0.0, (real)G0);
        return;
    }
    const real r2 = dot(position, position);
    const real r = root(r2);
    const real z2 = position[2] * position[2] / r2;
    const real k = -MU / (r2 * r);
    const real j = spherical(earth) ? (real)0.0 : 1.5 * J2 * A * A / r2;
    g[0] = k * position[0] * (1.0 - j * (5.0 * z2 - 1.0));
    g[1] = k * position[1] * (1.0 - j * (5.0 * z2 - 1.0));
    g[2] = k * position[2] * (1.0 - j * (5.0 * z2 - 3.0));
}

void earth_outputs(const flight_t *sim, real *y) {
    if (!items(sim->model, G_EARTH)) return;
    real *to = y + place(sim->model, AM_OUTPUT, G_EARTH, 0);
    const real *r = sim->x + X_X;
    const real *v = sim->x + X_VX;
    /* turn of the Earth since the time zero; velocity with it, in Earth-fixed axes */
    real g[3];
    double s, c;
    am_sincos(sim->omega * sim->time, &s, &c);
    const real vx = v[0] - sim->omega * r[1];
    const real vy = v[1] + sim->omega * r[0];
    for (int i = 0; i < 3; i++) {
        to[Y_EARTH_X + i] = r[i];
        to[Y_EARTH_VX + i] = v[i];
    }
    set3(to + Y_INERTIAL_X, c * r[0] - s * r[1], s * r[0] + c * r[1], r[2]);
    set3(to + Y_INERTIAL_VX, c * vx - s * vy, s * vx + c * vy, v[2]);
    gravitation(r, sim->earth, g);
    to[Y_GRAVITATION] = root(dot(g, g));
}
