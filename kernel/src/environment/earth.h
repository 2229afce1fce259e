/* Place on the Earth and its gravitation; `earth` is mode.earth. */
#ifndef AEROMATCH_EARTH_H
#define AEROMATCH_EARTH_H

#include "flight.h"

/* Earth-axes position [m] and local axes in now from latitude, longitude [rad] and height [m]. */
void place_at(double lat, double lon, double h, int earth, double position[3], now_t *now);

/* Height and local axes in now from the position. */
void place_of(const real position[3], int earth, now_r *now);

/* Keep the place in now as an anchor for place_near. */
void set_anchor(const real position[3], int earth, const now_r *now, anchor_r *anchor);

/* place_of, faster where the anchor is near. */
void place_near(const real position[3], int earth, const anchor_r *anchor, now_r *now);

/* Latitude and longitude of the place in now. [rad] */
void locate_angles(const flight_t *sim, const real position[3], now_r *now);

/* Mass attraction in Earth axes, without the centrifugal part. [m s-2] */
void gravitation(const real position[3], int earth, real g[3]);

/* Outputs in Earth-fixed and inertial axes, where the model has them. */
void earth_outputs(const flight_t *sim, real *y);

#endif
