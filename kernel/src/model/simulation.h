/* A simulation: what moves, and the part of each array that belongs to an item of a group. */
#ifndef AEROMATCH_SIMULATION_H
#define AEROMATCH_SIMULATION_H

#include "model.h"

#define A_POWER 3                /* base, exponent, value */
#define LAST_POWER (2 * A_POWER) /* the last one, and that of the anchor */
#define MAX_PATCHES 256          /* changed nodes, scales and offsets of tables in one simulation */

/* Layers of the standard atmosphere below 84.852 km (geopotential), moved by env.delta_T and
 * env.qnh. */
#define LAYERS 7
#define ATMOSPHERE(real)           \
    struct {                       \
        real T[LAYERS], p[LAYERS]; \
    }

/* What one evaluation of the derivative found; the outputs read it. */
#define NOW(real)                                                                     \
    struct {                                                                          \
        real lat, lon, h;                /* lat and lon only after locate_angles */   \
        real north[3], east[3], down[3]; /* in Earth axes */                          \
        real T, p, rho, a;                                                            \
        real C[3][3]; /* Earth to body */                                             \
        real u, v, w, V, Vxz, alpha, beta, mach, qbar;                                \
        real per_V, per_Vxz; /* their reciprocals, 0 at rest */                       \
        real ca, sa, cb, sb; /* cosine and sine of alpha and beta */                  \
        real rate[3];        /* body rates relative to Earth and air */               \
        real gust_rate[3];   /* rotation of the air about the body axes */            \
        /* of the moment; cg from the moment reference point */                       \
        real mass, cg[3], J[3][3], J_inverse[3][3];                                   \
        /* non-gravitational force, moment about the c.g., body axes */               \
        real F[3], M[3];                                                              \
        /* d(u, v, w)/dt relative to the air, d(p, q, r)/dt */                        \
        real acceleration[3], angular[3];                                             \
        real alpha_dot, beta_dot;                                                     \
        /* CL CD stability axes, CY body axis, Cl Cm Cn body axes at the reference */ \
        real c[COEFFICIENTS];                                                         \
        real thrust[MAX_ENGINES];                                                     \
    }

/* A place, and the radii of curvature there plus its height, north-south and east-west; the air
 * there, at geopotential height H, and the flow. */
#define ANCHOR(real)                                                           \
    struct {                                                                   \
        real position[3], north[3], east[3], down[3], h, meridian, transverse; \
        real H, T, per_T, p, u, v, w, Vxz, alpha, beta;                        \
    }

#define TRIM(real)                                                 \
    struct {                                                       \
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

/* The frequent forms of a term: T v, T v1 v2 K, and T v1 v2 K1 K2 with a power factor. */
typedef struct {
    uint32_t term, T, v;
} plain_t;

typedef struct {
    uint32_t term, T, v1, v2, K;
} factored_t;

typedef struct {
    uint32_t term, T, v1, v2, K1, K2, power;
} powered_t;

/* A term of a sum: a table that is one as it stands, or a product; products stand behind the
 * tables, and behind them a zero. */
typedef struct {
    uint32_t value, target;
} addend_t;

/* A term of a coefficient: a table times a variable, or a product and the constant 1. */
typedef struct {
    uint32_t value, v;
} plain_addend_t;

/* Terms of each stage that may be other than zero, by form, and what makes the sums: rows of one
 * term of each coefficient; of other targets the first terms, then the further ones.  Each list has
 * a place for every term; those of a stage begin at its first. */
typedef struct {
    plain_t *plain;
    factored_t *factored;
    powered_t *powered;
    uint32_t *mixed;
    addend_t *first, *further;
    plain_addend_t (*row)[COEFFICIENTS];
} lists_t;

#define LIST_WORDS(m) (20 * (size_t)(m)->terms + 2 * COEFFICIENTS * (size_t)(m)->rows)

/* Where the lists of each stage end, the switches that were zero when they were made, and for how
 * many evaluations more of them have been. */
typedef struct {
    uint32_t plain[STAGES], factored[STAGES], powered[STAGES], mixed[STAGES], first[STAGES],
        further[STAGES], rows, off, waited;
} list_ends_t;

/* at: memory of LIST_WORDS. */
static inline lists_t lay_lists(const am_model *m, uint32_t *at) {
    const size_t n = m->terms;
    return (lists_t){.plain = (plain_t *)at,
                     .factored = (factored_t *)(at + 3 * n),
                     .mixed = at + 8 * n,
                     .first = (addend_t *)(at + 9 * n),
                     .further = (addend_t *)(at + 11 * n),
                     .powered = (powered_t *)(at + 13 * n),
                     .row = (plain_addend_t(*)[COEFFICIENTS])(at + 20 * n)};
}

static inline size_t values_of(const am_model *m) { return (size_t)m->slots + m->terms + 1; }

/* The cells that the axes of a bench stand in. */
typedef struct {
    double from[4], to[4], point[4], per_step[4], start[4];
} stand_t;

#define RECOUNT UINT32_MAX

/* The pointers lead into the same block of memory, after the struct; am_copy copies everything
 * from `now` on. */
struct am_sim {
    const am_model *model;
    /* slot: values of the tables, of the products that are terms, and a zero */
    double *par, *scale, *exponent, *u, *x, *var, *slot, *sum, *fraction, *below, *above;
    /* discrete part of the submodels, and what it was before the present step */
    double *memory, *memory_before;
    double *work;       /* what the submodels found in the last derivative */
    double *last_power; /* base (positive, zero before the first), exponent and value */
    double *x_work, *k, *u_work, *u_end, *y_work;
    stand_t *stand;     /* of each bench */
    uint32_t *cell;     /* of each axis */
    uint32_t *end_cell; /* axes that stand beyond their ends: 2 i below, 2 i + 1 above */
    uint32_t *corner;   /* of each bundle: the node that all its lower nodes make */
    double *packed;     /* nodes at the corners of the cells that the packets stand in */
    uint64_t *wake;     /* of each packet: marks of the axes that change it */
    lists_t lists;
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
    list_ends_t ends;
    bool windy;         /* the wind is more than its inputs and a shear */
    bool off_ground;    /* gear out of reach in the last derivative: it has no loads */
    double reach;       /* of all wheels and skids from the reference point [m] */
    uint32_t rotors;    /* engines with rotors that have an angular momentum, as bits */
    uint32_t end_cells; /* how many; RECOUNT: a cell has changed since they were counted */
    uint32_t unknown;   /* stages whose slots do not belong to their cells and fractions, as bits */
    uint32_t patches;
    char text[AM_TEXT];
    patch_t patch[MAX_PATCHES];
};

/* The part of an array that belongs to an item, of a simulation or of several that fly side by
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
