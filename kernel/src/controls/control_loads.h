/* Geometry of a control circuit and what loads it: used by control.c. */
#ifndef AEROMATCH_CONTROL_LOADS_H
#define AEROMATCH_CONTROL_LOADS_H

#include "linkage.h"
#include "flight.h"

enum { MAX_CIRCUITS = 3 };

/* of the gearing at s = 0: beyond, a quadratic gearing would turn back */
#define LEAST_SLOPE 0.1

/* Loads at a moment, from springs, air, masses and nose wheel; the pilot and friction are not in
 * it. */
typedef struct {
    real on[LINKAGE_BODIES]; /* force on each body towards positive travel [N or N m] */
    /* parts of it, of all bodies, as the pilot feels them: positive is what he has to push */
    real aero, mass, nose;
    real hinge_moment; /* on all surfaces, positive as the deflection [N m] */
} loads_t;

/* A deflection with the bias of the control and what the trim added. [rad] */
static inline real biased_deflection(const flight_t *sim, real deflection, int control) {
    const real bias = control <= U_DELTA_D ? sim->par[P_BIAS_DELTA_E + control] : (real)0.0;
    const real trim = control <= U_DELTA_R ? sim->trim.delta[control] : (real)0.0;
    return deflection + bias + trim;
}

/* The control that an item moves: U_DELTA_E, U_DELTA_A or U_DELTA_R; -1 for an unknown name. */
static inline int circuit_control(const am_model *m, uint32_t item) { return m->control[item]; }
int circuit_bodies(const real *p);

/* Deflection of the surface over the travel of its end of the linkage, its slope, and back: p are
 * the parameters of the circuit. */
real surface_deflection(const real *p, real s);
real surface_slope(const real *p, real s);

static inline real surface_travel(const real *p, real delta) {
    const real G = p[P_CIRCUIT_GEARING];
    const real least = LEAST_SLOPE * G;
    const real off = delta - p[P_CIRCUIT_RIGGING];
    const real slope = root(larger(G * G + 2.0 * p[P_CIRCUIT_GEARING_SLOPE] * off, least * least));
    return 2.0 * off / (G + PICK(G > 0.0, slope, -slope));
}

/* Deflection of the control, and what both ailerons have in common; q of the bodies. */
real control_of_travel(const flight_t *sim, uint32_t item, const real *q);
real symmetric_deflection(const flight_t *sim, uint32_t item, const real *q);

real circuit_neutral(const flight_t *sim, uint32_t item, const real *u);
/* Masses, dampers, friction and cables, and all that with the stops; loads are left zero. */
void circuit_masses(const flight_t *sim, uint32_t item, linkage_t *linkage);
void circuit_linkage(const flight_t *sim, uint32_t item, linkage_t *linkage);
/* At q, for the air and accelerations that the last derivative found; `offset` is added to the
 * deflection in the air. */
void circuit_loads(flight_t *sim, uint32_t item, const real *x, const real *u, const real *q,
                   real offset, loads_t *loads);

#endif
