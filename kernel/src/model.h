/* Private to the kernel: what a loaded model and a simulation consist of. */
#ifndef AEROMATCH_MODEL_H
#define AEROMATCH_MODEL_H

#include "catalogue.h"
#include "kernel.h"

#include <stdbool.h>
#include <stdint.h>

#define AM_FORMAT 1
#define MAX_AXES 4
#define MAX_ENGINES 16
#define G0 9.80665       /* standard gravity [m s-2] */
#define V_FLOOR 1e-3     /* lower bound of V in reduced rates [m s-1] */
#define FLOW_FLOOR 0.15   /* below it alpha-dot and beta-dot are zero [m s-1] */
#define RIGID_STATES 13
#define COEFFICIENTS 6   /* CL CD CY Cl Cm Cn; with body force axes CX CZ CY Cl Cm Cn */
#define IMPLICIT 3       /* alphadothat, betadothat, dnz: consecutive variables from A_ALPHADOTHAT */

enum { ENGINE_GROUP, AERO_GROUP, GROUPS };
enum { STABILITY_AXES, WIND_AXES, BODY_AXES };
enum { FLAT_EARTH, WGS84_EARTH };
enum { THROTTLE_DRIVEN = 0, THRUST_DRIVEN = 2 };

typedef struct {
    const double *point;
    uint32_t count, variable;
    bool linear;
} axis_t;

typedef struct {
    const double *node;
    size_t stride[MAX_AXES]; /* doubles from a node to the next along the axis; 0 when the axis has one point */
    uint32_t axis[MAX_AXES];
    uint32_t axes, width, slot;
} bundle_t;

typedef struct {
    uint32_t K1, K2, T; /* slots of table values; 0 is the constant 1 */
    uint32_t v1, v2;    /* variables; A_ONE is the constant 1 */
    uint32_t coefficient; /* 0..5, or 6 + engine */
} term_t;

typedef struct {
    double position[3], direction[3];
    bool has_table;
} engine_t;

struct am_model {
    unsigned char *block;
    const char *title, *meta;
    am_entry *entry[AM_AXIS + 1];
    int count[AM_AXIS + 1];
    uint32_t *variable; /* code of each catalogued variable */
    axis_t *axis;
    bundle_t *bundle;
    term_t *term;
    uint32_t (*implicit)[2]; /* term, place in unknown of the implicit variable that multiplies it */
    uint32_t unknown[IMPLICIT], unknowns; /* the implicit variables in use, 0..2 from A_ALPHADOTHAT */
    engine_t *engine;
    uint32_t axes, bundles, terms, implicits, engines, slots, variables;
    uint32_t first_axis[GROUPS + 1], first_bundle[GROUPS + 1], first_term[GROUPS + 1];
    uint32_t first_of[COEFFICIENTS + 1]; /* terms of coefficient c: first_of[c] ... first_of[c + 1] - 1 */
    double S, cbar, b, x_ref_mac;
    int force_axes;
    bool uses_phi;
    size_t sim_bytes;
};

/* Layers of the standard atmosphere below 84.852 km (geopotential), moved by env.delta_T and env.qnh. */
#define LAYERS 7
typedef struct {
    double T[LAYERS], p[LAYERS];
} atmosphere_t;

/* What one evaluation of the derivative found; the outputs read it. */
typedef struct {
    double lat, lon, h;                          /* lat and lon only after locate_angles */
    double north[3], east[3], down[3];           /* in Earth axes */
    double T, p, rho, a;
    double C[3][3];                              /* Earth to body */
    double u, v, w, V, Vxz, alpha, beta, mach, qbar;
    double ca, sa, cb, sb;                       /* cosine and sine of alpha and beta */
    double rate[3];                              /* body rates relative to Earth and air */
    double F[3], M[3];                           /* non-gravitational force, moment about the c.g., body axes */
    double acceleration[3], angular[3];          /* d(u, v, w)/dt relative to the air, d(p, q, r)/dt */
    double alpha_dot, beta_dot;
    double c[COEFFICIENTS];                      /* CL CD stability axes, CY body axis, Cl Cm Cn body axes at the reference */
    double thrust[MAX_ENGINES], steady[MAX_ENGINES];
} now_t;

typedef struct {
    double alpha, beta, delta[3], thrust, throttle, residual[6];
} trim_t;

/* The pointers lead into the same piece of memory, after the struct; am_copy copies everything from `now` on. */
struct am_sim {
    const am_model *model;
    double *par, *scale, *u, *x, *var, *slot, *term, *fraction, *below, *above;
    double *x_work, *k, *u_work;
    uint32_t *cell;
    int8_t *outside; /* -1 below, 0 inside, 1 above */
    now_t now;
    atmosphere_t atmosphere;
    trim_t trim;
    double J[3][3], J_inverse[3][3], omega;
    double time;
    int earth, drive;
    bool prepared, ready;
    bool fresh; /* now, slots and first slope k belong to the present x, u and parameters */
    char text[200];
};

static inline double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void cross(const double a[3], const double b[3], double c[3]) {
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    c[0] = x, c[1] = y, c[2] = z;
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
int known_count(am_kind kind, bool per_engine);
/* table.c */
void look_up(am_sim *sim, int group);
/* air_data.c */
void set_atmosphere(atmosphere_t *atm, double delta_T, double qnh);
void atmosphere_at(const atmosphere_t *atm, double h, double *T, double *p, double *rho, double *a);
void air_data(now_t *now, const double velocity[3]);
double calibrated_airspeed(double mach, double p);
/* earth.c */
void place_at(double lat, double lon, double h, int earth, double position[3], now_t *now);
void place_of(const double position[3], int earth, now_t *now);
void locate_angles(const am_sim *sim, const double position[3], now_t *now);
void gravitation(const double position[3], int earth, double g[3]);
/* axes.c */
void quaternion_matrix(const double q[4], double C[3][3]);
void matrix_quaternion(const double C[3][3], double q[4]);
void euler_matrix(double phi, double theta, double psi, double C[3][3]);
/* aero.c */
void evaluate_terms(am_sim *sim, int group);
void sum_coefficients(const am_model *model, const double *term, double c[COEFFICIENTS]);
void aero_forces(am_sim *sim, const double thrust_force[3], const double free_fall[3]);
/* engine.c */
double applied_throttle(const am_sim *sim, const double *u, uint32_t engine);
void engine_thrust(am_sim *sim, const double *x, const double *u);
void engine_forces(const am_sim *sim, double F[3], double M[3], double H[3]);
void engine_derivative(const am_sim *sim, const double *x, double *dx);
/* sixdof.c */
double applied(const am_sim *sim, const double *u, int control);
void derivative(am_sim *sim, const double *x, const double *u, double *dx);
void settle_engines(am_sim *sim);
/* sim.c */
size_t sim_size(const am_model *model);
int fail(am_sim *sim, int status, const char *format, ...);
void take_inputs(am_sim *sim, const double *u);
int ready(am_sim *sim);
int refresh(am_sim *sim);
void start_state(am_sim *sim, double alpha, double beta, double theta);
double start_pitch(const am_sim *sim, double alpha, double beta);

#endif
