/* Wind profile, turbulence and discrete gust: names of the group, calls of the core. */
#ifndef AEROMATCH_WEATHER_NAMES_H
#define AEROMATCH_WEATHER_NAMES_H

#define WIND_ROWS 8

#define AM_WIND_ROW(X, i) \
    X(P_WIND_H##i, "wind.h" #i) \
    X(P_WIND_N##i, "wind.n" #i) \
    X(P_WIND_E##i, "wind.e" #i) \
    X(P_WIND_D##i, "wind.d" #i)

#define AM_WEATHER_INPUTS(X)
#define AM_WEATHER_OUTPUTS(X) \
    X(Y_AIR_WIND_N, "air.wind_n") \
    X(Y_AIR_WIND_E, "air.wind_e") \
    X(Y_AIR_WIND_D, "air.wind_d") \
    X(Y_AIR_GUST_U, "air.gust_u") \
    X(Y_AIR_GUST_V, "air.gust_v") \
    X(Y_AIR_GUST_W, "air.gust_w") \
    X(Y_AIR_GUST_P, "air.gust_p") \
    X(Y_AIR_GUST_Q, "air.gust_q") \
    X(Y_AIR_GUST_R, "air.gust_r")
#define AM_WEATHER_PARAMETERS(X) \
    X(P_SHEAR_N, "wind.shear_n") \
    X(P_SHEAR_E, "wind.shear_e") \
    X(P_SHEAR_D, "wind.shear_d") \
    X(P_SHEAR_H, "wind.shear_h") \
    X(P_WIND_W20, "wind.W20") \
    X(P_WIND_FROM, "wind.from") \
    X(P_WIND_ROUGHNESS, "wind.roughness") \
    X(P_WIND_ROWS, "wind.rows") \
    AM_WIND_ROW(X, 1) \
    AM_WIND_ROW(X, 2) \
    AM_WIND_ROW(X, 3) \
    AM_WIND_ROW(X, 4) \
    AM_WIND_ROW(X, 5) \
    AM_WIND_ROW(X, 6) \
    AM_WIND_ROW(X, 7) \
    AM_WIND_ROW(X, 8) \
    X(P_TURBULENCE, "turbulence.mode") \
    X(P_SEED, "turbulence.seed") \
    X(P_TURBULENCE_STEP, "turbulence.step") \
    X(P_TURBULENCE_W20, "turbulence.W20") \
    X(P_SEVERITY, "turbulence.severity") \
    X(P_TURBULENCE_V, "turbulence.V") \
    X(P_SIGMA_U, "turbulence.sigma_u") \
    X(P_SIGMA_V, "turbulence.sigma_v") \
    X(P_SIGMA_W, "turbulence.sigma_w") \
    X(P_L_U, "turbulence.L_u") \
    X(P_L_V, "turbulence.L_v") \
    X(P_L_W, "turbulence.L_w") \
    X(P_GUST_U, "gust.peak_u") \
    X(P_GUST_V, "gust.peak_v") \
    X(P_GUST_W, "gust.peak_w") \
    X(P_GUST_START, "gust.start") \
    X(P_GUST_RISE, "gust.rise") \
    X(P_GUST_HOLD, "gust.hold")
#define AM_WEATHER_STATES(X)
#define AM_WEATHER_VARIABLES(X)
#define AM_WEATHER_TARGETS(X)

/* Discrete memory.  A gust is u, v, w [m s-1] and p, q, r [rad s-1]. */
enum {
    D_GRID_START,             /* time of grid point 0: the start of the simulation */
    D_GRID_INDEX,             /* grid point at the left of the present interval */
    D_LIVE,                   /* 1 when there is turbulence or a discrete gust */
    D_FILTER,                 /* states of unit variance: u, v (2), w (2), p */
    D_LAG = D_FILTER + 6,     /* v and w less their low-passed values, for r and q */
    D_LEFT = D_LAG + 2,       /* turbulence at both ends of the interval */
    D_RIGHT = D_LEFT + 6,
    D_AT = D_RIGHT + 6,       /* turbulence at start, middle and end of the internal step */
    D_SHAPE = D_AT + 18,      /* discrete gust over its peak, at the same three times */
    D_PER_WEATHER = D_SHAPE + 3
};
/* What the last derivative found: wind at the aircraft and its part from gusts, n e d. [m s-1] */
enum { W_WIND, W_GUST = 3, W_PER_WEATHER = 6 };

#endif
