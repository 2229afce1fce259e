/* A loaded model: tables, terms, names and sizes.  Immutable, shared by simulations and threads. */
#ifndef AEROMATCH_MODEL_H
#define AEROMATCH_MODEL_H

#include "catalogue.h"
#include "kernel.h"

#include <stdbool.h>
#include <stdint.h>

#define AM_FORMAT 2
#define MAX_AXES 4
#define MAX_ENGINES 16
#define MAX_ITEMS 16 /* of one group */
#define MAX_SWITCHES 32
#define G0 9.80665      /* standard gravity [m s-2] */
#define V_FLOOR 1e-3    /* lower bound of V in reduced rates [m s-1] */
#define QBAR_FLOOR 1.0  /* lower bound of the dynamic pressure in the thrust coefficient [Pa] */
#define FLOW_FLOOR 0.15 /* below it alpha-dot and beta-dot are zero [m s-1] */
#define COEFFICIENTS 6  /* CL CD CY Cl Cm Cn; with body force axes CX CZ CY Cl Cm Cn */
/* alphadothat, betadothat, dnz: consecutive variables from A_ALPHADOTHAT */
#define IMPLICIT 3
/* most of a time: beyond it the points of the turbulence could no longer be counted [s] */
#define LATEST 1e10
/* doubles and slots that a look-up touches beyond the last table of a bundle */
#define SPILL 3
#define FARTHEST 1e150 /* most of a breakpoint; beyond it a variable counts as this */
#define NAME_SIZE 80   /* of a name with the item in place of the star */

enum { STABILITY_AXES, WIND_AXES, BODY_AXES };
enum { FLAT_EARTH, WGS84_EARTH, SPHERE_FIXED, SPHERE_ROTATING };
enum { LEVER_DRIVEN, N1_DRIVEN, THRUST_DRIVEN, TORQUE_DRIVEN, RPM_DRIVEN, MAP_DRIVEN };
enum { RATES_OF_GYROS, RATES_OF_EARTH };
enum { SURFACE_DRIVEN, POSITION_DRIVEN, FORCE_DRIVEN };
/* kinds whose names are those of the lists: AM_INPUT ... AM_TARGET */
enum { NAMED_KINDS = AM_TARGET + 1 };

/* Where x lies from `from` up to that of the next cell, the fraction of the way between two
 * nodes is start + (x - point) per_step. */
typedef struct {
    double from, point, per_step, start;
} cell_t;

/* The cells of count breakpoints: below the first, between two, the last itself, beyond it;
 * behind them one that nothing reaches. */
typedef struct {
    const cell_t *cell;
    uint32_t cells, count, variable;
    /* index of its fraction in am_sim: the axes of a stage are located four at a time */
    uint32_t fraction;
} axis_t;

/* Variables of four axes, and which axes; an empty place has the constant 1. */
typedef struct {
    uint32_t variable[4], axis[4];
} bench_t;

/* Benches of a stage as four bits each, sixteen of them and then the first again; the last bit
 * stands for all axes as well. */
#define MARKED_BENCHES 16
#define ALL_AXES (1ull << 63)

/* Node at the lower end of a cell. */
static inline uint32_t lower_node(const axis_t *axis, uint32_t cell) {
    const uint32_t most = axis->count > 1 ? axis->count - 2 : 0;
    const uint32_t node = cell ? cell - 1 : 0;
    return node < most ? node : most;
}

static inline double within_reach(double x) {
    return x > FARTHEST ? FARTHEST : x < -FARTHEST ? -FARTHEST : x;
}

static inline double fraction_in(const cell_t *cell, double x) {
    return cell->start + (x - cell->point) * cell->per_step;
}

typedef struct {
    size_t first; /* node of the model */
    /* doubles from a node to the next along the axis; 0 when the axis has one point */
    size_t stride[MAX_AXES];
    uint32_t axis[MAX_AXES];
    uint32_t axes, width, slot;
    uint64_t marks; /* of its axes, and ALL_AXES */
} bundle_t;

/* Tables of one number of axes that a flight looks up four at a time: those of a bundle, or four of
 * any bundles.  The values at the corners of their cells lie packed in the simulation, those of
 * four tables side by side. */
typedef struct {
    uint64_t marks;   /* of all axes, and ALL_AXES */
    uint32_t corner;  /* where the corners begin */
    uint32_t vectors; /* of four tables of a bundle; 0: four tables of several bundles */
    uint32_t tables;  /* of the four that exist */
    uint32_t slot[4]; /* of the four, or of the first of a bundle */
    /* indices of the fractions of their axes; those of a bundle are the same four times */
    uint32_t fraction[MAX_AXES][4];
    uint32_t bundle[4], table[4]; /* of each: its bundle, and its place there */
} packet_t;

/* Packets of one way of look-up: so many axes, of several bundles or of one. */
#define WAYS (2 * (MAX_AXES + 1))

typedef struct {
    uint32_t K1, K2, T; /* slots of table values; 0 is the constant 1 */
    uint32_t v1, v2;    /* variables; A_ONE is the constant 1 */
    uint32_t target;
    uint32_t power; /* 0 none, else 1 + place among the power factors */
    /* switches that multiply it, as bits: where one is zero, so is the term */
    uint32_t switches;
    bool special; /* with a coefficient or an implicit variable */
    bool bounded; /* no value of its tables is infinite */
} term_t;

/* A term that an implicit variable multiplies, the one at a place in unknown; bare: nothing else
 * but its table does. */
typedef struct {
    uint32_t term, T, target, place;
    bool bare;
} implicit_t;

#define MAX_REGION_AXES 8
#define REGION_BITS 2 /* of a cell; the code of an axis is above them */
#define REGION_MASK 3u

/* Regions of the validity envelope over some variables: between two edges the byte of a cell. */
typedef struct {
    uint32_t axes, variable[MAX_REGION_AXES], edges[MAX_REGION_AXES];
    const double *edge[MAX_REGION_AXES];
    const unsigned char *cell;
} region_table_t;

/* A factor max(v, floor)^exponent; the exponent is a parameter. */
typedef struct {
    uint32_t variable;
    double floor;
} power_t;

struct am_model {
    unsigned char *block;
    const char *title, *meta;
    am_entry *entry[AM_AXIS + 1];
    int count[AM_AXIS + 1];
    uint32_t items[GROUPS];
    /* where the names of a group begin, and how many an item has */
    uint32_t first[NAMED_KINDS][GROUPS];
    uint32_t per[NAMED_KINDS][GROUPS];
    uint32_t total[NAMED_KINDS];
    uint32_t begin[NAMED_KINDS][GROUPS][MAX_ITEMS]; /* of each item: place */
    uint32_t first_memory[GROUPS], first_work[GROUPS], per_memory[GROUPS], per_work[GROUPS],
        memories, works;
    const char *item[GROUPS][MAX_ITEMS];
    int control[MAX_ITEMS]; /* that each circuit moves: U_DELTA_E ... U_DELTA_R, -1 none */
    uint32_t feed_engine[MAX_ITEMS], feed_tank[MAX_ITEMS]; /* the ends of each feed */
    uint32_t from_tank[MAX_ITEMS], to_tank[MAX_ITEMS];     /* and of each transfer */
    uint32_t *variable;     /* code of each catalogued variable */
    axis_t *axis;
    cell_t *cell;
    const double *node;
    bundle_t *bundle;
    packet_t *packet; /* of a stage by ways: where those of a way begin */
    uint32_t first_packet[STAGES * WAYS + 1];
    uint32_t corners; /* doubles at the corners of all cells */
    bench_t *bench;
    uint32_t first_bench[STAGES + 1];
    term_t *term;
    power_t *power;
    implicit_t *implicit;
    region_table_t *region;
    uint32_t regions;
    /* the implicit variables in use, 0..2 from A_ALPHADOTHAT */
    uint32_t unknown[IMPLICIT], unknowns;
    /* terms that depend on coefficients, level by level; levels: how many there are; late_force:
     * one of them is a force */
    uint32_t *late, first_late[LEVELS + 1], levels;
    bool late_force;
    uint32_t axes, bundles, terms, powers, implicits, lates, slots;
    uint32_t first_axis[STAGES + 1], first_bundle[STAGES + 1], first_term[STAGES + 1];
    uint32_t *target_stage, *first_of; /* terms of target t: first_of[t] ... end_of[t] - 1 */
    uint32_t *end_of;
    uint32_t rows;               /* most terms of a coefficient */
    uint64_t decks[MAX_ENGINES]; /* targets of each spool that have terms, as bits */
    /* variables that are zero for whole flights: configuration, tabs, devices */
    uint32_t switch_of[MAX_SWITCHES], switches;
    double S, cbar, b, x_ref_mac;
    int force_axes;
    bool uses_phi;
    size_t sim_bytes;
    int lanes; /* doubles that the processor has side by side: 1, 4 (AVX2), 8 (AVX-512) */
};

static inline uint32_t items(const am_model *m, int group) { return m->items[group]; }

/* Index of the first name of one kind that belongs to an item of a group. */
static inline uint32_t place(const am_model *m, int kind, int group, uint32_t item) {
    return m->begin[kind][group][item];
}

static inline bool has_terms(const am_model *m, int group, uint32_t item, uint32_t target) {
    const uint32_t t = place(m, AM_TARGET, group, item) + target;
    return m->first_of[t] < m->end_of[t];
}

#endif
