/* One engine with a full deck: spools, flame, fuel flow; engine.c calls it. */
#ifndef AEROMATCH_SPOOL_H
#define AEROMATCH_SPOOL_H

#include "flight.h"

typedef struct {
    /* along the thrust line: gross where the deck gives an air flow, else net [N] */
    real thrust;
    real air_flow;  /* what makes ram drag [kg s-1] */
    real fuel_flow; /* [kg s-1] */
    /* of the rotors, along the thrust line, and its rate [kg m2 s-1, N m] */
    real momentum, torque;
    mask_t fuelled; /* given: whether there is fuel for the engine */
} deck_t;

/* The intake of all engines: ratios of total temperature and pressure to standard, and the root of
 * the former. */
typedef struct {
    real theta, root_theta, delta;
} intake_t;

int spool_check(am_sim *sim, uint32_t engine);
/* lever history; spools still, flame on where there is fuel */
void spool_start(am_sim *sim, uint32_t engine, double t);
void spool_advance(am_sim *sim, uint32_t engine, double t, double h, double lever0, double lever1);
/* one move to the steady state; false when it is there */
bool spool_steady(am_sim *sim, uint32_t engine, double *x, const double *u);
intake_t spool_intake(const flight_t *sim);
void spool_variables(flight_t *sim, uint32_t engine, const intake_t *in, const real *x,
                     const real *u);
/* N2 of the present N1 in N1 drive; true when that changed it */
bool spool_driven(flight_t *sim, uint32_t engine);
void spool_deck(flight_t *sim, uint32_t engine, const intake_t *in, const real *x, const real *u,
                deck_t *deck, real *dx);
/* whether its deck has an air flow, which makes ram drag */
bool spool_breathes(const am_model *m, uint32_t engine);
/* whether its rotors have an inertia */
bool spool_spins(const am_sim *sim, uint32_t engine);
real delayed_lever(const flight_t *sim, const real *u, uint32_t engine);
/* along the thrust line */
double spool_thrust(const am_sim *sim, uint32_t engine, const double *x);

#endif
