/* Forces between a tyre or a skid and the ground, with true rest.
 *
 * The carcass carries the rim on a spring of two directions, z = (x, y), stuck to the ground
 * below.  While nothing slides and nothing rolls, z' is the velocity of the rim: an elastic
 * anchor that does not creep, however long and however it is shaken (the elastic zone of Dupont
 * et al. 2002).  Two things let go:
 *
 *     the ground   |z| <= yield = 3 mu Fz / k   where the brush model reaches mu Fz
 *     the brake    |F_x| <= B                   brake and rolling resistance; the wheel turns as
 *                                               fast as that takes
 *
 * Both are return maps over the time TYRE_LAG, z' = (P(z + TYRE_LAG v) - z) / TYRE_LAG, P the
 * nearest admissible point: z' = v inside, mu Fz against the motion at any speed, no rate above
 * 1 / TYRE_LAG.  Rolling renews the rubber on the ground, y' = v_y - |w R| k / C y, so that y
 * settles at (C / k) tan(slip angle): C / k is the relaxation length.  The force is that of a
 * brush of parabolic pressure (Pacejka 2012, sec. 3.2), F = mu Fz (1 - (1 - |z| / yield)^3)
 * against z: slope C at small slip, friction circle with the brake.  Above |v| = C / (k
 * TYRE_LAG) the stiffness falls with speed at constant C, which holds the relaxation length at
 * |v| TYRE_LAG. */
#include "tyre.h"

#include "algebra.h"

#include <math.h>

#define NEAR 1e-9 /* floor of the elastic zone: below what a tyre can resolve [m] */

/* Grows with the load to its greatest value and falls again: Pacejka (2012) eq. (4.E25), sin(2
 * atan x) = 2 x / (1 + x^2). */
double cornering_stiffness(double greatest, double load_of_greatest, double load) {
    const double x = load / load_of_greatest;
    return greatest * 2.0 * x / (1.0 + x * x);
}

static double length(const double a[2]) { return sqrt(a[0] * a[0] + a[1] * a[1]); }

/* Force over mu Fz and over z / yield: 3 at rest, 1 when all of the patch slides. */
static double chord(double part) { return part < 1.0 ? 3.0 - part * (3.0 - part) : 1.0 / part; }

/* Where the deflection would go in TYRE_LAG, brought back to what the ground holds. */
static void slide(const double w[2], double yield, const double z[2], double rate[2]) {
    const double size = length(w);
    const double back = size > yield ? yield / size : 1.0;
    for (int i = 0; i < 2; i++) rate[i] = (back * w[i] - z[i]) / TYRE_LAG;
}

/* The wheel turns under the longitudinal force at which the deflection x is `most`; returns the
 * rate of renewal. */
static double turn(const tyre_t *tyre, double k, double most, double yield, const double z[2],
                   const double v[2], double rate[2]) {
    const double ahead = z[0] + TYRE_LAG * v[0];
    const double x = clamp(ahead, -fmin(most, yield), fmin(most, yield));
    rate[0] = (x - z[0]) / TYRE_LAG;
    const double renewal = fmin(fabs(v[0] - rate[0]) * k / tyre->cornering, 1.0 / TYRE_LAG);
    const double room = sqrt(fmax(yield * yield - x * x, 0.0));
    const double across = v[1] - renewal * z[1];
    const double y = z[1] + TYRE_LAG * across;
    rate[1] = fabs(y) > room ? (clamp(y, -room, room) - z[1]) / TYRE_LAG : across;
    return renewal;
}

void tyre_forces(const tyre_t *tyre, const double z[2], const double v[2], footprint_t *print) {
    const double most = tyre->mu * tyre->load;
    const double speed = length(v);
    const double C = tyre->cornering;
    /* off the ground: no force, and the deflection decays */
    if (!(tyre->load > 0.0)) {
        for (int i = 0; i < 2; i++) {
            print->F[i] = 0.0;
            print->rate[i] = -z[i] / TYRE_LAG;
        }
        print->renewal = 1.0 / TYRE_LAG;
        return;
    }
    const double k = C > 0.0 && tyre->stiffness * TYRE_LAG * speed > C ? C / (TYRE_LAG * speed)
                                                                       : tyre->stiffness;
    /* deflection at which all of the patch slides: three times friction over stiffness */
    const double yield = 3.0 * most / k + NEAR;
    const double w[2] = {z[0] + TYRE_LAG * v[0], z[1] + TYRE_LAG * v[1]};
    /* the rubber follows the wheel unless the brake lets the wheel turn, or the patch slides */
    for (int i = 0; i < 2; i++) print->rate[i] = v[i];
    print->renewal = 0.0;
    if (C > 0.0 && most * chord(length(w) / yield) * fabs(w[0]) / yield > tyre->brake) {
        print->renewal = turn(tyre, k, tyre->brake * yield / (most * chord(length(z) / yield)),
                              yield, z, v, print->rate);
    } else if (length(w) > yield) {
        slide(w, yield, z, print->rate);
    }
    /* force against the deflection, with the damping of the carcass */
    const double damped[2] = {z[0] + tyre->loss * print->rate[0],
                              z[1] + tyre->loss * print->rate[1]};
    const double scale = -most * chord(length(damped) / yield) / yield;
    for (int i = 0; i < 2; i++) print->F[i] = scale * damped[i];
}
