/* Geometry of a control circuit and what loads it: used by control.c. */
#ifndef AEROMATCH_CONTROL_LOADS_H
#define AEROMATCH_CONTROL_LOADS_H

#include "linkage.h"
#include "simulation.h"

enum { MAX_CIRCUITS = 3 };

/* Loads at a moment, from springs, air, masses and nose wheel; the pilot and friction are not in
 * it. */
typedef struct {
    double on[LINKAGE_BODIES]; /* force on each body towards positive travel [N or N m] */
    /* parts of it, of all bodies, as the pilot feels them: positive is what he has to push */
    double aero, mass, nose;
    double hinge_moment; /* on all surfaces, positive as the deflection [N m] */
} loads_t;

/* A deflection with the bias of the control and what the trim added. [rad] */
static inline double biased_deflection(const am_sim *sim, double deflection, int control) {
    const double bias = control <= U_DELTA_D ? sim->par[P_BIAS_DELTA_E + control] : 0.0;
    const double trim = control <= U_DELTA_R ? sim->trim.delta[control] : 0.0;
    return deflection + bias + trim;
}

/* The control that an item moves: U_DELTA_E, U_DELTA_A or U_DELTA_R; -1 for an unknown name. */
static inline int circuit_control(const am_model *m, uint32_t item) { return m->control[item]; }
int circuit_bodies(const double *p);

/* Deflection of the surface over the travel of its end of the linkage, its slope, and back. */
double surface_deflection(const double *p, double s);
double surface_slope(const double *p, double s);
double surface_travel(const double *p, double delta);
/* Deflection of the control, and what both ailerons have in common; q of the bodies. */
double control_of_travel(const am_sim *sim, uint32_t item, const double *q);
double symmetric_deflection(const am_sim *sim, uint32_t item, const double *q);

double circuit_neutral(const am_sim *sim, uint32_t item, const double *u);
/* Masses, dampers, friction, stops and cables; loads are left zero. */
void circuit_linkage(const am_sim *sim, uint32_t item, linkage_t *linkage);
/* At q, for the air and accelerations that the last derivative found; `offset` is added to the
 * deflection in the air. */
void circuit_loads(am_sim *sim, uint32_t item, const double *x, const double *u, const double *q,
                   double offset, loads_t *loads);

#endif
