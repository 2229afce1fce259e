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

#define NEAR 1e-9 /* floor of the elastic zone: below what a tyre can resolve [m] */

/* Grows with the load to its greatest value and falls again: Pacejka (2012) eq. (4.E25), sin(2
 * atan x) = 2 x / (1 + x^2). */
real cornering_stiffness(real greatest, real load_of_greatest, real load) {
    const real x = load / load_of_greatest;
    return greatest * 2.0 * x / (1.0 + x * x);
}

static real length(const real a[2]) { return root(a[0] * a[0] + a[1] * a[1]); }

/* Force over mu Fz and over z / yield: 3 at rest, 1 when all of the patch slides. */
static real chord(real part) { return PICK(part < 1.0, 3.0 - part * (3.0 - part), 1.0 / part); }

/* Where the deflection would go in TYRE_LAG, brought back to what the ground holds. */
static void slide(const real w[2], real yield, const real z[2], mask_t slides, real rate[2]) {
    const real size = length(w);
    const real back = PICK(size > yield, yield / size, 1.0);
    for (int i = 0; i < 2; i++) rate[i] = PICK(slides, (back * w[i] - z[i]) / TYRE_LAG, rate[i]);
}

/* The wheel turns under the longitudinal force at which the deflection x is `most`; changes the
 * rates and the renewal of wheels that do. */
static void roll_on(const tyre_t *tyre, real k, real most, real yield, const real z[2],
                    const real v[2], mask_t rolls, footprint_t *print) {
    const real end = smaller(most, yield);
    const real x = clamp(z[0] + TYRE_LAG * v[0], -end, end);
    const real ahead = (x - z[0]) / TYRE_LAG;
    const real renewal = smaller(size_of(v[0] - ahead) * k / tyre->cornering, (real)1.0 / TYRE_LAG);
    const real room = root(larger(yield * yield - x * x, (real)0.0));
    const real across = v[1] - renewal * z[1];
    const real y = z[1] + TYRE_LAG * across;
    const real aside = PICK(size_of(y) > room, (clamp(y, -room, room) - z[1]) / TYRE_LAG, across);
    print->rate[0] = PICK(rolls, ahead, print->rate[0]);
    print->rate[1] = PICK(rolls, aside, print->rate[1]);
    print->renewal = PICK(rolls, renewal, print->renewal);
}

/* Off the ground: no force, and the deflection decays. */
static void let_go(const real z[2], mask_t off, footprint_t *print) {
    for (int i = 0; i < 2; i++) {
        print->F[i] = PICK(off, 0.0, print->F[i]);
        print->rate[i] = PICK(off, -z[i] / TYRE_LAG, print->rate[i]);
    }
    print->renewal = PICK(off, 1.0 / TYRE_LAG, print->renewal);
}

void tyre_forces(const tyre_t *tyre, const real z[2], const real v[2], footprint_t *print) {
    const real most = tyre->mu * tyre->load;
    const real speed = length(v);
    const real C = tyre->cornering;
    const mask_t off = NOT(tyre->load > 0.0);
    /* the rubber follows the wheel unless the brake lets the wheel turn, or the patch slides */
    for (int i = 0; i < 2; i++) {
        print->F[i] = 0.0;
        print->rate[i] = v[i];
    }
    print->renewal = 0.0;
    if (EVERY(off)) {
        let_go(z, off, print);
        return;
    }
    const mask_t fast = (C > 0.0) & (tyre->stiffness * TYRE_LAG * speed > C);
    const real k = PICK(fast, C / (TYRE_LAG * speed), tyre->stiffness);
    /* deflection at which all of the patch slides: three times friction over stiffness */
    const real yield = 3.0 * most / k + NEAR;
    const real w[2] = {z[0] + TYRE_LAG * v[0], z[1] + TYRE_LAG * v[1]};
    const real part = length(w) / yield;
    const mask_t rolls = (C > 0.0) & (most * chord(part) * size_of(w[0]) / yield > tyre->brake);
    const mask_t slides = NOT(rolls) & (length(w) > yield);
    if (ANY(rolls)) {
        const real end = tyre->brake * yield / (most * chord(length(z) / yield));
        roll_on(tyre, k, end, yield, z, v, rolls, print);
    }
    if (ANY(slides)) slide(w, yield, z, slides, print->rate);
    /* force against the deflection, with the damping of the carcass */
    const real damped[2] = {z[0] + tyre->loss * print->rate[0],
                            z[1] + tyre->loss * print->rate[1]};
    const real scale = -most * chord(length(damped) / yield) / yield;
    for (int i = 0; i < 2; i++) print->F[i] = scale * damped[i];
    if (ANY(off)) let_go(z, off, print);
}
