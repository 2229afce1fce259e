/* The Earth: WGS-84 ellipsoid with J2 gravitation, a sphere with inverse-square gravitation, or
 * a flat plane with constant gravity in north-east-down axes. */
#include "earth.h"

#include "algebra.h"
#include "elementary.h"

#include <math.h>

static const double A = 6378137.0; /* equatorial radius [m] */
static const double F = 1.0 / 298.257223563;
static const double MU = 3.986004418e14; /* [m3 s-2] */
static const double J2 = 0.00108262982;
/* radius of the sphere: NASA/TM-2015-218675, table 73 [m] */
static const double SPHERE = 6371007.1809;

static const double NEAR = 30.0; /* of an anchor [m] */

static bool spherical(int earth) { return earth == SPHERE_FIXED || earth == SPHERE_ROTATING; }

static void set3(double to[3], double x, double y, double z) {
    to[0] = x;
    to[1] = y;
    to[2] = z;
}

static void local_axes(double sin_lat, double cos_lat, double sin_lon, double cos_lon, now_t *now) {
    set3(now->north, -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
    set3(now->east, -sin_lon, cos_lon, 0.0);
    set3(now->down, -cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat);
}

static void flat_axes(now_t *now) {
    set3(now->north, 1.0, 0.0, 0.0);
    set3(now->east, 0.0, 1.0, 0.0);
    set3(now->down, 0.0, 0.0, 1.0);
}

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

/* Sine and cosine of the geodetic latitude, P from the axis.  Bowring (1976), one iteration:
 * 3e-9 m in height up to 20 km. */
static double ellipsoid_height(double P, double z, double *s, double *c) {
    const double e2 = F * (2.0 - F);
    const double B = A * (1.0 - F);
    /* parametric latitude: tan = z / (P (1 - f)) */
    const double tc = P * (1.0 - F);
    const double tn = 1.0 / sqrt(z * z + tc * tc);
    const double sb = z * tn;
    const double cb = tc * tn;
    const double ls = z + e2 * A * A / B * sb * sb * sb;
    const double lc = P - e2 * A * cb * cb * cb;
    const double ln = 1.0 / sqrt(ls * ls + lc * lc);
    *s = ls * ln;
    *c = lc * ln;
    return P * *c + z * *s - A * sqrt(1.0 - e2 * *s * *s);
}

static double sphere_height(double P, double z, double *s, double *c) {
    const double r = sqrt(P * P + z * z);
    *s = z / r;
    *c = P / r;
    return r - SPHERE;
}

/* Height and local axes. */
void place_of(const double position[3], int earth, now_t *now) {
    if (earth == FLAT_EARTH) {
        flat_axes(now);
        now->h = -position[2];
        return;
    }
    const double x = position[0];
    const double y = position[1];
    const double z = position[2];
    const double P = sqrt(x * x + y * y);
    const double from_axis = P > 0.0 ? 1.0 / P : 0.0;
    double s, c;
    now->h = spherical(earth) ? sphere_height(P, z, &s, &c) : ellipsoid_height(P, z, &s, &c);
    local_axes(s, c, y * from_axis, P > 0.0 ? x * from_axis : 1.0, now);
}

/* now holds the place of the position. */
void set_anchor(const double position[3], int earth, const now_t *now, anchor_t *anchor) {
    const double e2 = spherical(earth) ? 0.0 : F * (2.0 - F);
    const double s = now->down[2];
    const double w = 1.0 - e2 * s * s;
    const double N = spherical(earth) ? SPHERE : A / sqrt(w);
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
bool place_near(const double position[3], const anchor_t *anchor, now_t *now) {
    const double d[3] = {position[0] - anchor->position[0], position[1] - anchor->position[1],
                         position[2] - anchor->position[2]};
    const double n = dot(d, anchor->north);
    const double e = dot(d, anchor->east);
    const double down = dot(d, anchor->down);
    if (!(dot(d, d) < NEAR * NEAR)) return false;
    const double a = n / (anchor->meridian - down);
    const double b = e / (anchor->transverse - down);
    const double c = 1.0 - 0.5 * (a * a + b * b);
    const double x = position[0];
    const double y = position[1];
    const double P = sqrt(x * x + y * y);
    const double from_axis = P > 0.0 ? 1.0 / P : 0.0;
    now->h = anchor->h - down + 0.5 * (n * a + e * b);
    for (int i = 0; i < 3; i++) {
        now->down[i] = c * anchor->down[i] - a * anchor->north[i] - b * anchor->east[i];
    }
    set3(now->east, -y * from_axis, P > 0.0 ? x * from_axis : 1.0, 0.0);
    cross(now->east, now->down, now->north);
    return true;
}

/* Latitude and longitude; on the flat Earth by the radii of curvature at the start. */
void locate_angles(const am_sim *sim, const double position[3], now_t *now) {
    if (sim->earth != FLAT_EARTH) {
        now->lat = am_atan2(-now->down[2], now->north[2]);
        now->lon = am_atan2(-now->east[0], now->east[1]);
        return;
    }
    double s, c;
    am_sincos(sim->par[P_LAT], &s, &c);
    const double h = sim->par[P_H];
    const double e2 = F * (2.0 - F);
    const double n = 1.0 - e2 * s * s;
    now->lat = sim->par[P_LAT] + position[0] / (A * (1.0 - e2) / (n * sqrt(n)) + h);
    now->lon = sim->par[P_LON] + position[1] / ((A / sqrt(n) + h) * c);
}

/* Mass attraction without the centrifugal part. */
void gravitation(const double position[3], int earth, double g[3]) {
    if (earth == FLAT_EARTH) {
        set3(g, 0.0, 0.0, G0);
        return;
    }
    const double r2 = dot(position, position);
    const double r = sqrt(r2);
    const double z2 = position[2] * position[2] / r2;
    const double k = -MU / (r2 * r);
    const double j = spherical(earth) ? 0.0 : 1.5 * J2 * A * A / r2;
    g[0] = k * position[0] * (1.0 - j * (5.0 * z2 - 1.0));
    g[1] = k * position[1] * (1.0 - j * (5.0 * z2 - 1.0));
    g[2] = k * position[2] * (1.0 - j * (5.0 * z2 - 3.0));
}

void earth_outputs(const am_sim *sim, double *y) {
    if (!items(sim->model, G_EARTH)) return;
    double *to = output_of(sim, y, G_EARTH, 0);
    const double *r = sim->x + X_X;
    const double *v = sim->x + X_VX;
    /* turn of the Earth since the time zero; velocity with it, in Earth-fixed axes */
    double s, c, g[3];
    am_sincos(sim->omega * sim->time, &s, &c);
    const double vx = v[0] - sim->omega * r[1];
    const double vy = v[1] + sim->omega * r[0];
    for (int i = 0; i < 3; i++) {
        to[Y_EARTH_X + i] = r[i];
        to[Y_EARTH_VX + i] = v[i];
    }
    set3(to + Y_INERTIAL_X, c * r[0] - s * r[1], s * r[0] + c * r[1], r[2]);
    set3(to + Y_INERTIAL_VX, c * vx - s * vy, s * vx + c * vy, v[2]);
    gravitation(r, sim->earth, g);
    to[Y_GRAVITATION] = sqrt(dot(g, g));
}
