/* The simulations that a unit advances: one, or LANES of one model side by side, each with its own
 * parameters, inputs and state.
 *
 * flight_t has the members of am_sim that the equations use, under the same names. */
#ifndef AEROMATCH_FLIGHT_H
#define AEROMATCH_FLIGHT_H

#include "real.h"
#include "simulation.h"

#if !ORIGINAL

/* The functions over flight_t, which exist once for each number of lanes, and once more. */
#define aero_forces LANED(aero_forces)
#define air_data LANED(air_data)
#define anchor_air LANED(anchor_air)
#define atmosphere_at LANED(atmosphere_at)
#define burn_fuel LANED(burn_fuel)
#define calibrated_airspeed LANED(calibrated_airspeed)
#define circuit_bodies LANED(circuit_bodies)
#define circuit_linkage LANED(circuit_linkage)
#define circuit_loads LANED(circuit_loads)
#define circuit_masses LANED(circuit_masses)
#define circuit_moves LANED(circuit_moves)
#define circuit_neutral LANED(circuit_neutral)
#define circuit_offset LANED(circuit_offset)
#define cockpit_travel LANED(cockpit_travel)
#define contributions LANED(contributions)
#define control_advance LANED(control_advance)
#define control_bias LANED(control_bias)
#define control_deflection LANED(control_deflection)
#define control_of_travel LANED(control_of_travel)
#define control_outputs LANED(control_outputs)
#define cornering_stiffness LANED(cornering_stiffness)
#define delayed_lever LANED(delayed_lever)
#define derivative LANED(derivative)
#define draw_fuel LANED(draw_fuel)
#define driven_travel LANED(driven_travel)
#define earth_outputs LANED(earth_outputs)
#define engine_forces LANED(engine_forces)
#define engine_outputs LANED(engine_outputs)
#define envelope_outputs LANED(envelope_outputs)
#define evaluate_coefficients LANED(evaluate_coefficients)
#define evaluate_terms LANED(evaluate_terms)
#define fuel_fed LANED(fuel_fed)
#define fuel_left LANED(fuel_left)
#define fuel_outputs LANED(fuel_outputs)
#define keep_anchor LANED(keep_anchor)
#define gear_off_ground LANED(gear_off_ground)
#define gear_clear LANED(gear_clear)
#define gear_forces LANED(gear_forces)
#define gear_outputs LANED(gear_outputs)
#define gravitation LANED(gravitation)
#define list_terms LANED(list_terms)
#define locate_angles LANED(locate_angles)
#define mass_now LANED(mass_now)
#define one_step LANED(one_step)
#define pilot_force LANED(pilot_force)
#define place_near LANED(place_near)
#define place_of LANED(place_of)
#define pressure_altitude LANED(pressure_altitude)
#define motor_outputs LANED(motor_outputs)
#define motor_torque LANED(motor_torque)
#define motor_variables LANED(motor_variables)
#define piston_outputs LANED(piston_outputs)
#define piston_torque LANED(piston_torque)
#define piston_variables LANED(piston_variables)
#define propeller_loads LANED(propeller_loads)
#define propeller_outputs LANED(propeller_outputs)
#define propeller_power LANED(propeller_power)
#define propeller_variables LANED(propeller_variables)
#define rigid_drive LANED(rigid_drive)
#define separation_outputs LANED(separation_outputs)
#define separation_rates LANED(separation_rates)
#define separation_variables LANED(separation_variables)
#define set_anchor LANED(set_anchor)
#define set_flight_condition LANED(set_flight_condition)
#define set_rigid LANED(set_rigid)
#define shaft_loads LANED(shaft_loads)
#define shaft_outputs LANED(shaft_outputs)
#define shaft_variables LANED(shaft_variables)
#define spool_deck LANED(spool_deck)
#define spool_breathes LANED(spool_breathes)
#define spool_driven LANED(spool_driven)
#define spool_intake LANED(spool_intake)
#define spool_variables LANED(spool_variables)
#define steering_angle LANED(steering_angle)
#define steering_derivative LANED(steering_derivative)
#define steady_separation LANED(steady_separation)
#define surface_deflection LANED(surface_deflection)
#define surface_slope LANED(surface_slope)
#define symmetric_deflection LANED(symmetric_deflection)
#define tyre_forces LANED(tyre_forces)
#define write_outputs LANED(write_outputs)

#endif

/* A function over flight_t that a unit here calls and that is written twice: one_name for one
 * simulation, laned_name (folder lanes) for several. */
#if LANES == 1
#define HOOK(name) one_##name
#else
#define HOOK(name) laned_##name
#endif

#if LANES == 1

typedef am_sim flight_t;
typedef atmosphere_t layers_r;
typedef now_t now_r;
typedef anchor_t anchor_r;

#else

#define look_up LANED(look_up)

typedef ATMOSPHERE(real) layers_r;
typedef NOW(real) now_r;
typedef ANCHOR(real) anchor_r;
typedef TRIM(real) trim_r;

/* Where the axes of the tables stand: the cell of each lane. */
typedef struct {
    real from, to, point, per_step, start;
} cells_r;

/* The arrays lie behind the struct, as those of am_sim.  Parts that are rare or full of branches
 * run in the simulation of each lane, which also holds its cells, corners, delays and gusts. */
typedef struct {
    const am_model *model;
    real *par, *scale, *exponent, *u, *x, *var, *slot, *sum, *fraction, *last_power;
    real *memory; /* of fuel and circuits; the rest stands in each simulation */
    real *work;
    real *x_work, *k, *u_work, *u_end, *y_work, *u0, *u1;
    real *before;   /* room for the numbers of laned_find_start (laned_flight.h) */
    cells_r *cells; /* of each axis */
    bool *shared;   /* of each bundle: all lanes look at one cell of one model */
    lists_t lists;
    list_ends_t ends;
    now_r now;
    layers_r atmosphere, standard;
    anchor_r anchor;
    trim_r trim;
    real wind[3], gust[3]; /* north, east, down */
    real reach;
    real change[MAX_PATCHES]; /* values of the patches */
    mask_t fresh;
    double omega, time, clock, part;
    int earth, drive, controls;
    bool anchored, off_ground;
    uint32_t rotors; /* of any lane */
    bool windy;      /* the wind of a lane is more than its inputs and a shear */
    am_sim *lane[LANES];
} flight_t;

#endif

#endif
