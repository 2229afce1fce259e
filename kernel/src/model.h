/* Private to the kernel: what a loaded model and a simulation consist of. */
#ifndef AEROMATCH_MODEL_H
#define AEROMATCH_MODEL_H

#include "catalogue.h"
#include "kernel.h"
#include "versions.h"

#include <stdbool.h>
#include <stdint.h>

#define AM_FORMAT 2
#define MAX_AXES 4
#define MAX_ENGINES 16
#define MAX_ITEMS 16    /* of one group */
#define G0 9.80665      /* standard gravity [m s-2] */
#define V_FLOOR 1e-3    /* lower bound of V in reduced rates [m s-1] */
#define QBAR_FLOOR 1.0  /* lower bound of the dynamic pressure in the thrust coefficient [Pa] */
#define FLOW_FLOOR 0.15 /* below it alpha-dot and beta-dot are zero [m s-1] */
#define COEFFICIENTS 6  /* CL CD CY Cl Cm Cn; with body force axes CX CZ CY Cl Cm Cn */
/* alphadothat, betadothat, dnz: consecutive variables from A_ALPHADOTHAT */
#define IMPLICIT 3
#define MAX_PATCHES 256 /* changed nodes, scales and offsets of tables in one simulation */
/* most of a time: beyond it the points of the turbulence could no longer be counted [s] */
#define LATEST 1e10
/* doubles and slots that a look-up touches beyond the last table of a bundle */
#define SPILL 3
#define FARTHEST 1e150 /* most of a breakpoint; beyond it a variable counts as this */
#define ROW 8          /* terms side by side: one of each coefficient, two empty */
#define NAME_SIZE 80   /* of a name with the item in place of the star */

enum { STABILITY_AXES, WIND_AXES, BODY_AXES };
enum { FLAT_EARTH, WGS84_EARTH, SPHERE_FIXED, SPHERE_ROTATING };
enum { LEVER_DRIVEN, N1_DRIVEN, THRUST_DRIVEN };
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
} axis_t;

/* Node at the lower end of a cell. */
static inline uint32_t lower_node(const axis_t *axis, uint32_t cell) {
    const uint32_t most = axis->count > 1 ? axis->count - 2 : 0;
    const uint32_t node = cell ? cell - 1 : 0;
    return node < most ? node : most;
}

typedef struct {
    size_t first; /* node of the model */
    /* doubles from a node to the next along the axis; 0 when the axis has one point */
    size_t stride[MAX_AXES];
    uint32_t axis[MAX_AXES];
    uint32_t axes, width, slot;
} bundle_t;

typedef struct {
    uint32_t K1, K2, T; /* slots of table values; 0 is the constant 1 */
    uint32_t v1, v2;    /* variables; A_ONE is the constant 1 */
    uint32_t target;
    bool first;     /* of its target */
    uint32_t power; /* 0 none, else 1 + place among the power factors */
    /* of its value in am_sim.term: row by row, a column for each coefficient, then the other
     * stages */
    uint32_t place;
} term_t;

/* The frequent forms of a term, T v and K T v. */
typedef struct {
    uint32_t term, place, T, v;
} plain_t;

typedef struct {
    uint32_t term, place, T, v, K;
} factored_t;

static inline double within_reach(double x) {
    return x > FARTHEST ? FARTHEST : x < -FARTHEST ? -FARTHEST : x;
}
static inline double fraction_in(const cell_t *cell, double x) {
    return cell->start + (x - cell->point) * cell->per_step;
}

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
    uint32_t first_memory[GROUPS], first_work[GROUPS], per_memory[GROUPS], per_work[GROUPS],
        memories, works;
    const char *item[GROUPS][MAX_ITEMS];
    uint32_t *variable; /* code of each catalogued variable */
    axis_t *axis;
    cell_t *cell;
    const double *node;
    bundle_t *bundle;
    term_t *term;
    plain_t *plain;
    factored_t *factored;
    uint32_t *mixed; /* terms of other forms, those with CL or an implicit variable apart */
    power_t *power;
    /* term, place in unknown of the implicit variable that multiplies it */
    uint32_t (*implicit)[2];
    /* the implicit variables in use, 0..2 from A_ALPHADOTHAT */
    uint32_t unknown[IMPLICIT], unknowns;
    uint32_t *late; /* terms with CL as a factor */
    uint32_t axes, bundles, terms, powers, implicits, lates, slots, plains, factoreds, mixeds, rows,
        places;
    uint32_t first_axis[STAGES + 1], first_bundle[STAGES + 1], first_term[STAGES + 1];
    uint32_t first_plain[STAGES + 1], first_factored[STAGES + 1], first_mixed[STAGES + 1];
    uint32_t *target_stage, *first_of; /* terms of target t: first_of[t] ... end_of[t] - 1 */
    uint32_t *end_of;
    double S, cbar, b, x_ref_mac;
    int force_axes;
    bool uses_phi;
    size_t sim_bytes;
    versions_t versions;
};

/* Layers of the standard atmosphere below 84.852 km (geopotential), moved by env.delta_T and
 * env.qnh. */
#define LAYERS 7
typedef struct {
    double T[LAYERS], p[LAYERS];
} atmosphere_t;

/* What one evaluation of the derivative found; the outputs read it. */
typedef struct {
    double lat, lon, h;                /* lat and lon only after locate_angles */
    double north[3], east[3], down[3]; /* in Earth axes */
    double T, p, rho, a;
    double C[3][3]; /* Earth to body */
    double u, v, w, V, Vxz, alpha, beta, mach, qbar;
    double per_V, per_Vxz; /* their reciprocals, 0 at rest */
    double ca, sa, cb, sb; /* cosine and sine of alpha and beta */
    double rate[3];        /* body rates relative to Earth and air */
    double gust_rate[3];   /* rotation of the air about the body axes */
    /* of the moment; cg from the moment reference point */
    double mass, cg[3], J[3][3], J_inverse[3][3];
    /* non-gravitational force, moment about the c.g., body axes */
    double F[3], M[3];
    /* d(u, v, w)/dt relative to the air, d(p, q, r)/dt */
    double acceleration[3], angular[3];
    double alpha_dot, beta_dot;
    /* CL CD stability axes, CY body axis, Cl Cm Cn body axes at the reference */
    double c[COEFFICIENTS];
    double thrust[MAX_ENGINES];
} now_t;

/* A place, and the radii of curvature there plus its height, north-south and east-west. */
typedef struct {
    double position[3], north[3], east[3], down[3], h, meridian, transverse;
} anchor_t;

typedef struct {
    double alpha, beta, delta[3], thrust, throttle, residual[6];
} trim_t;

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
    double *work; /* what the submodels found in the last derivative */
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

static inline uint32_t items(const am_model *m, int group) { return m->items[group]; }

/* Index of the first name of one kind that belongs to an item of a group. */
static inline uint32_t place(const am_model *m, int kind, int group, uint32_t item) {
    return m->first[kind][group] + item * m->per[kind][group];
}

/* The piece of an array that belongs to an item. */
static inline double *par_of(const am_sim *sim, int group, uint32_t item) {
    return sim->par + place(sim->model, AM_PARAMETER, group, item);
}
static inline double *var_of(const am_sim *sim, int group, uint32_t item) {
    return sim->var + place(sim->model, AM_VARIABLE, group, item);
}
static inline double *sum_of(const am_sim *sim, int group, uint32_t item) {
    return sim->sum + place(sim->model, AM_TARGET, group, item);
}
static inline const double *input_of(const am_sim *sim, const double *u, int group, uint32_t item) {
    return u + place(sim->model, AM_INPUT, group, item);
}
static inline double *output_of(const am_sim *sim, double *y, int group, uint32_t item) {
    return y + place(sim->model, AM_OUTPUT, group, item);
}
static inline const double *state_of(const am_sim *sim, const double *x, int group, uint32_t item) {
    return x + place(sim->model, AM_STATE, group, item);
}
static inline double *rate_of(const am_sim *sim, double *dx, int group, uint32_t item) {
    return dx + place(sim->model, AM_STATE, group, item);
}
static inline double *memory_of(const am_sim *sim, int group, uint32_t item) {
    return sim->memory + sim->model->first_memory[group] + item * sim->model->per_memory[group];
}
static inline double *work_of(const am_sim *sim, int group, uint32_t item) {
    return sim->work + sim->model->first_work[group] + item * sim->model->per_work[group];
}

static inline bool has_terms(const am_model *m, int group, uint32_t item, uint32_t target) {
    const uint32_t t = place(m, AM_TARGET, group, item) + target;
    return m->first_of[t] < m->end_of[t];
}

static inline double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross(const double a[3], const double b[3], double c[3]) {
    const double x = a[1] * b[2] - a[2] * b[1];
    const double y = a[2] * b[0] - a[0] * b[2];
    const double z = a[0] * b[1] - a[1] * b[0];
    c[0] = x;
    c[1] = y;
    c[2] = z;
}

/* b = C a and a = C^T b; C turns reference to body axes, the two vectors must not be the same */
static inline void to_body(const double C[3][3], const double a[3], double b[3]) {
    for (int i = 0; i < 3; i++) b[i] = dot(C[i], a);
}

static inline void from_body(const double C[3][3], const double b[3], double a[3]) {
    for (int i = 0; i < 3; i++) a[i] = C[0][i] * b[0] + C[1][i] * b[1] + C[2][i] * b[2];
}

/* pack.c */
bool all_finite(const double *a, size_t n);
/* names.c */
const char *group_pattern(int kind, int group, uint32_t code); /* NULL past the last */
uint32_t group_size(int kind, int group);
int pattern_stage(int kind, int group, uint32_t code); /* of a variable or target */
void item_name(char to[NAME_SIZE], const char *pattern, const char *item);
uint32_t memory_size(int group);
uint32_t work_size(int group);
/* table.c */
uint32_t find_cell(const axis_t *axis, double x);
void look_up(am_sim *sim, int stage);
void settle_cells(am_sim *sim);
/* nodes.c */
/* the changes of nodes and tables, after a look-up */
void apply_patches(am_sim *sim, int stage);
int set_table_parameter(am_sim *sim, uint32_t index, double value);
int get_table_parameter(const am_sim *sim, uint32_t index, double *value);
int find_table_parameter(const am_model *m, const char *name);
void check_patches(am_sim *sim);
/* air_data.c */
void set_atmosphere(atmosphere_t *atm, double delta_T, double qnh);
void set_standard(atmosphere_t *atm);
double pressure_altitude(const atmosphere_t *standard, double p);
void atmosphere_at(const atmosphere_t *atm, double h, double *T, double *p, double *rho, double *a);
void air_data(now_t *now, const double velocity[3]);
double calibrated_airspeed(double mach, double p);
/* earth.c */
void place_at(double lat, double lon, double h, int earth, double position[3], now_t *now);
void place_of(const double position[3], int earth, now_t *now);
void set_anchor(const double position[3], int earth, const now_t *now, anchor_t *anchor);
/* false: too far from the anchor */
bool place_near(const double position[3], const anchor_t *anchor, now_t *now);
void locate_angles(const am_sim *sim, const double position[3], now_t *now);
void gravitation(const double position[3], int earth, double g[3]);
/* axes.c */
void quaternion_matrix(const double q[4], double C[3][3]);
void matrix_quaternion(const double C[3][3], double q[4]);
void euler_matrix(double phi, double theta, double psi, double C[3][3]);
/* aero.c */
void evaluate_stage(am_sim *sim, int stage); /* tables, terms and sums of a stage */
void evaluate_terms(am_sim *sim, int stage);
/* of every term at the last derivative, implicit ones included */
void contributions(const am_sim *sim, double *term);
void evaluate_special(am_sim *sim);  /* terms with CL or an implicit variable, as these stand */
void leave_out_special(am_sim *sim); /* their places are zero but between these two calls */
void sum_coefficients(const am_sim *sim, double c[COEFFICIENTS]);
void aero_forces(am_sim *sim, const double applied[3], const double free_fall[3]);
/* weather.c */
int weather_check(am_sim *sim);
bool weather_sound(const am_sim *sim); /* as engine_sound */
void weather_start(am_sim *sim, double t);
void weather_advance(am_sim *sim, double t, double h, const double *u0, const double *u1);
void weather_wind(am_sim *sim, const double *u, double wind[3]);
/* n, e, d without gusts */
void steady_wind(const am_sim *sim, const double *u, double h, double wind[3]);
void weather_outputs(am_sim *sim, double *y);
/* fuel.c */
int fuel_check(am_sim *sim);
void fuel_start(am_sim *sim, double t);
void mass_now(am_sim *sim, const double *x);
void fuel_outputs(am_sim *sim, double *y);
/* engine.c */
int engine_check(am_sim *sim);
/* whether the memory, which may come from outside, can be worked with */
bool engine_sound(const am_sim *sim);
void engine_start(am_sim *sim, double t);
void engine_advance(am_sim *sim, double t, double h, const double *u0, const double *u1);
void engine_forces(am_sim *sim, const double *x, const double *u, double F[3], double M[3],
                   double H[3], double *dx);
double applied_throttle(const am_sim *sim, const double *u, uint32_t engine);
void engine_outputs(am_sim *sim, double *y);
/* gear.c */
int gear_check(am_sim *sim);
void gear_start(am_sim *sim, double t);
void gear_forces(am_sim *sim, const double *x, const double *u, double F[3], double M[3],
                 double *dx);
void gear_outputs(am_sim *sim, double *y);
/* control.c */
int control_check(am_sim *sim);
void control_start(am_sim *sim, double t);
void control_advance(am_sim *sim, double t, double h, const double *u0, const double *u1);
double control_deflection(const am_sim *sim, const double *u, int control);
void control_outputs(am_sim *sim, double *y);
/* sixdof.c */
double applied(const am_sim *sim, const double *u, int control);
void look_around(am_sim *sim, const double *x, const double *u);
void derivative(am_sim *sim, const double *x, const double *u, double *dx);
/* integrate.c */
void count_outside(am_sim *sim);
void advance_memory(am_sim *sim, double t, double h, const double *u0, const double *u1);
/* sim.c */
/* names the first of the catalogue that is not, and the time */
int check_finite(am_sim *sim, am_kind kind, const double *values);
size_t sim_size(const am_model *model);
int fail(am_sim *sim, int status, const char *format, ...);
/* fails with: <name> is <value>; it must be <rule> */
int bad_parameter(am_sim *sim, uint32_t parameter, const char *rule);
void take_inputs(am_sim *sim, const double *u);
int ready(am_sim *sim);
int refresh(am_sim *sim);
void start_state(am_sim *sim, double alpha, double beta, double theta);
double start_pitch(const am_sim *sim, double alpha, double beta);

#endif
