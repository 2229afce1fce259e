/* Place on the Earth and its gravitation; `earth` is mode.earth. */
#ifndef AEROMATCH_EARTH_H
#define AEROMATCH_EARTH_H

#include "simulation.h"

/* Earth-axes position [m] and local axes in now from latitude, longitude [rad] and height [m]. */
void place_at(double lat, double lon, double h, int earth, double position[3], now_t *now);

/* Height and local axes in now from the position. */
void place_of(const double position[3], int earth, now_t *now);

/* Keep the place in now as an anchor for place_near. */
void set_anchor(const double position[3], int earth, const now_t *now, anchor_t *anchor);

/* place_of from a near anchor, faster; false and nothing done when it is too far away. */
bool place_near(const double position[3], const anchor_t *anchor, now_t *now);

/* Latitude and longitude of the place in now. [rad] */
void locate_angles(const am_sim *sim, const double position[3], now_t *now);

/* Mass attraction in Earth axes, without the centrifugal part. [m s-2] */
void gravitation(const double position[3], int earth, double g[3]);

/* Outputs in Earth-fixed and inertial axes, where the model has them. */
void earth_outputs(const am_sim *sim, double *y);

#endif
