/* A simulation: what moves, and the piece of each array that belongs to an item of a group. */
#ifndef AEROMATCH_SIMULATION_H
#define AEROMATCH_SIMULATION_H

#include "model.h"

#define LAST_POWER 3    /* base, exponent, value */
#define MAX_PATCHES 256 /* changed nodes, scales and offsets of tables in one simulation */

/* Layers of the standard atmosphere below 84.852 km (geopotential), moved by env.delta_T and
 * env.qnh. */
#define LAYERS 7
#define ATMOSPHERE(real) \
    struct { \
        real T[LAYERS], p[LAYERS]; \
    }

/* What one evaluation of the derivative found; the outputs read it. */
#define NOW(real) \
    struct { \
        real lat, lon, h;                /* lat and lon only after locate_angles */ \
        real north[3], east[3], down[3]; /* in Earth axes */ \
        real T, p, rho, a; \
        real C[3][3]; /* Earth to body */ \
        real u, v, w, V, Vxz, alpha, beta, mach, qbar; \
        real per_V, per_Vxz; /* their reciprocals, 0 at rest */ \
        real ca, sa, cb, sb; /* cosine and sine of alpha and beta */ \
        real rate[3];        /* body rates relative to Earth and air */ \
        real gust_rate[3];   /* rotation of the air about the body axes */ \
        /* of the moment; cg from the moment reference point */ \
        real mass, cg[3], J[3][3], J_inverse[3][3]; \
        /* non-gravitational force, moment about the c.g., body axes */ \
        real F[3], M[3]; \
        /* d(u, v, w)/dt relative to the air, d(p, q, r)/dt */ \
        real acceleration[3], angular[3]; \
        real alpha_dot, beta_dot; \
        /* CL CD stability axes, CY body axis, Cl Cm Cn body axes at the reference */ \
        real c[COEFFICIENTS]; \
        real thrust[MAX_ENGINES]; \
    }

/* A place, and the radii of curvature there plus its height, north-south and east-west. */
#define ANCHOR(real) \
    struct { \
        real position[3], north[3], east[3], down[3], h, meridian, transverse; \
    }

#define TRIM(real) \
    struct { \
        real alpha, beta, delta[3], thrust, throttle, residual[6]; \
    }

/* Of one simulation; flight.h makes them for several that fly side by side. */
typedef ATMOSPHERE(double) atmosphere_t;
typedef NOW(double) now_t;
typedef ANCHOR(double) anchor_t;
typedef TRIM(double) trim_t;

/* A changed node, or a scale or offset of a whole table (slot). */
enum { PATCH_NODE, PATCH_SCALE, PATCH_OFFSET };
typedef struct {
    uint32_t index, kind, stage, bundle, slot, at[MAX_AXES];
    double value; /* of a node: the change */
} patch_t;

/* The pointers lead into the same piece of memory, after the struct; am_copy copies everything
 * from `now` on. */
struct am_sim {
    const am_model *model;
    double *par, *scale, *exponent, *u, *x, *var, *slot, *term, *sum, *fraction, *below, *above;
    /* discrete part of the submodels, and what it was before the present step */
    double *memory, *memory_before;
    double *work;       /* what the submodels found in the last derivative */
    double *last_power; /* base (positive, zero before the first), exponent and value */
    double *x_work, *k, *u_work, *u_end, *y_work;
    uint32_t *cell;   /* of each axis */
    uint32_t *corner; /* of each bundle: the node that all its lower nodes make */
    now_t now;
    atmosphere_t atmosphere, standard;
    /* x, once the first slope belongs to it; the later slopes of a step find their place from
     * there */
    anchor_t anchor;
    trim_t trim;
    double omega; /* of the Earth */
    double time;  /* reached */
    double clock; /* of the derivative that is being evaluated */
    double part;  /* its place in the internal step, 0 ... 1 */
    int earth, drive, controls;
    bool prepared, ready, anchored;
    /* now, slots and first slope k belong to the present x, u, memory and parameters */
    bool fresh;
    uint32_t patches;
    char text[AM_TEXT];
    patch_t patch[MAX_PATCHES];
};

/* The piece of an array that belongs to an item, of a simulation or of several that fly side by
 * side (flight.h). */
#define par_of(sim, group, item) ((sim)->par + place((sim)->model, AM_PARAMETER, group, item))
#define var_of(sim, group, item) ((sim)->var + place((sim)->model, AM_VARIABLE, group, item))
#define sum_of(sim, group, item) ((sim)->sum + place((sim)->model, AM_TARGET, group, item))
#define input_of(sim, u, group, item) ((u) + place((sim)->model, AM_INPUT, group, item))
#define output_of(sim, y, group, item) ((y) + place((sim)->model, AM_OUTPUT, group, item))
#define state_of(sim, x, group, item) ((x) + place((sim)->model, AM_STATE, group, item))
#define rate_of(sim, dx, group, item) ((dx) + place((sim)->model, AM_STATE, group, item))
#define memory_of(sim, group, item) ((sim)->memory + memory_place((sim)->model, group, item))
#define work_of(sim, group, item) ((sim)->work + work_place((sim)->model, group, item))

static inline uint32_t memory_place(const am_model *m, int group, uint32_t item) {
    return m->first_memory[group] + item * m->per_memory[group];
}

static inline uint32_t work_place(const am_model *m, int group, uint32_t item) {
    return m->first_work[group] + item * m->per_work[group];
}

#endif
