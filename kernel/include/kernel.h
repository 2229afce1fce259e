/* aeromatch simulation kernel: public interface, in reading order.
 *
 * An aircraft is data: one packed block of tables, terms and constants, written by
 * flightmech.compile and read by am_load.  A model is immutable and may be shared by threads.  A
 * simulation (am_sim) is all that moves; it is plain memory, and am_copy of it is a rollback
 * point.  Nothing here prints, keeps a global variable or allocates inside a step.
 *
 * Units are SI and radians.  Body axes x forward, y right, z down; north-east-down; Euler angles
 * 3-2-1.  p, q, r are relative to inertial space; u, v, w, V, alpha, beta relative to the air.
 *
 * Arrays belong to the caller and are not kept.  Calls on one simulation must not overlap in time;
 * simulations of one model may run in different threads.
 *
 *     am_model *m = am_load(bytes, n, text, sizeof text);      NULL: text states why
 *     am_sim *s = am_new(m);
 *     am_set_parameter(s, am_find(m, AM_PARAMETER, "init.V"), 80.0);
 *     am_set_inputs(s, u);                                      inputs at the start
 *     am_initialize(s, 0.0);                                    trims when mode.trim requires it
 *     am_outputs(s, y);
 *     am_step(s, t, dt, u0, u1);         as often as wanted, or am_run for a record
 *     am_delete(s);
 *     am_free(m); */
#ifndef AEROMATCH_KERNEL_H
#define AEROMATCH_KERNEL_H

#include <stddef.h>

/* What a library shows.  That of an FMU (AM_FMU) shows the functions of FMI alone (AM_FMI,
 * shell/fmu.h): the linker drops what these do not reach, and two FMUs in one process cannot call
 * into each other. */
#if defined(_WIN32)
#define AM_SHOWN __declspec(dllexport)
#else
#define AM_SHOWN __attribute__((visibility("default")))
#endif
#if defined(AM_FMU)
#define AM_API
#else
#define AM_API AM_SHOWN
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct am_model am_model;
typedef struct am_sim am_sim;

#define AM_TEXT 200 /* bytes of the text of a failure */

/* Status of a call.  After any status but AM_OK of a call that may change the
 * simulation, am_error(sim) is a sentence for the user. */
enum {
    AM_OK = 0,
    AM_BAD_INDEX = 1, /* no such input, output or parameter */
    AM_BAD_VALUE = 2, /* a parameter that has no physical meaning, e.g. a negative mass */
    /* NaN or infinity in an input, a parameter, the state or an output: am_error names it,
     * am_time states when */
    AM_NOT_FINITE = 3,
    AM_BAD_ARGUMENT = 4, /* a wrong argument of the call itself, e.g. a negative dt */
    AM_NOT_READY = 5,    /* am_initialize has not been called or has failed */
    AM_NOT_SOLVED = 6    /* an iteration did not converge; of am_follow_circuit only */
};

/* What can be counted, named and found. */
typedef enum {
    AM_INPUT = 0,  /* delta_e ... wind_d, engine1.throttle ... */
    AM_OUTPUT = 1, /* V ... out_of_range, engine1.thrust ... */
    /* init.V ... mode.step, engine1.time_constant ..., term.CL.basic ..., power.CL.ground ... */
    AM_PARAMETER = 2,
    AM_STATE = 3, /* state.x ... state.r, state.engine1.thrust ... */
    /* model variables that the tables and terms of this block use: columns of am_evaluate */
    AM_VARIABLE = 4,
    /* what terms add to: CL ..., engine1.thrust ...; am_known only */
    AM_TARGET = 5,
    /* CL/basic ..., engine1/thrust ..., in order of evaluation; columns of am_evaluate */
    AM_TERM = 6,
    /* table axes: the name is that of the variable, low and high are the range */
    AM_AXIS = 7
} am_kind;

/* am_entry.flags */
enum {
    /* a parameter that acts at am_initialize only (init.*, mode.*); others may change between
     * steps */
    AM_FIXED = 1,
    AM_INTEGER = 2, /* an enumeration: mode.earth, mode.engine, mode.controls, mode.trim */
    /* an axis that continues linearly beyond its ends instead of holding the end value */
    AM_LINEAR = 4
};

/* One row of the catalogue; the texts live as long as the model. */
typedef struct {
    const char *name, *units, *display_units, *description;
    double value; /* start value of an input or parameter; else 0 */
    /* range: limits of a control or parameter (-DBL_MAX, DBL_MAX: none), range of an axis */
    double low, high;
    int flags;
} am_entry;

/* ---- model ----------------------------------------------------------------------------------- */

/* Check and copy a block of n bytes.  Any bytes are safe; they may be freed after the call. NULL
 * on a fault: err (nerr bytes, may be NULL) states what and where.  Free the model with am_free. */
AM_API am_model *am_load(const void *bytes, size_t n, char *err, size_t nerr);

/* Free a model, after all its simulations; NULL is allowed. */
AM_API void am_free(am_model *model);

/* Format of the blocks that this library reads. */
AM_API int am_format(void);

/* Name of the aircraft, and provenance, force axes and source hash as JSON; the texts belong to the
 * model. */
AM_API const char *am_title(const am_model *model);
AM_API const char *am_meta(const am_model *model);

/* Number of names of a kind; 0 for AM_TARGET. */
AM_API int am_count(const am_model *model, am_kind kind);

/* Row i of the catalogue of a kind; its texts belong to the model.  AM_OK or AM_BAD_INDEX. */
AM_API int am_entry_at(const am_model *model, am_kind kind, int i, am_entry *entry);

/* Index of a name, or -1. */
AM_API int am_find(const am_model *model, am_kind kind, const char *name);

/* Name i of AM_INPUT ... AM_TARGET that this library can compute, before any block exists; NULL
 * past the end.  The texts are constants of the library.
 *
 * Names come in groups (am_known_group: "" the core, "weather", "engine" ...).  A group has
 * items; those of the core and the weather are always there, the others once per item of the
 * aircraft, with the item's name in place of the star: engine*.throttle becomes
 * engine1.throttle, gear.*.force gear.nose.force.  In a block the groups stand in this order,
 * all names of the first item before those of the second; term.<name> for every term and
 * power.<name> for every power factor follow the parameters. */
AM_API const char *am_known(am_kind kind, int i);
AM_API const char *am_known_group(am_kind kind, int i);

/* Variables: the first stage of the evaluation that may use it; targets: the stage that evaluates
 * it; -1 past the end. */
AM_API int am_known_stage(am_kind kind, int i);

/* Name of group i; NULL past the last. */
AM_API const char *am_group(int i);

/* ---- simulation ------------------------------------------------------------------------------ */

/* A simulation of a model, with the start values of the catalogue.  NULL: no memory.  The model
 * must outlive it; free it with am_delete. */
AM_API am_sim *am_new(const am_model *model);
AM_API void am_delete(am_sim *sim);

/* Copy states, inputs, parameters and counters between simulations of one model. */
AM_API int am_copy(am_sim *to, const am_sim *from);

/* Text of the last failure, "" when there was none; it belongs to the simulation and stays until
 * the next failure or am_initialize. */
AM_API const char *am_error(const am_sim *sim);

/* Time reached, or at which a step failed. [s] */
AM_API double am_time(const am_sim *sim);

/* Set or get parameter i, in the units of the catalogue.  NaN and infinity are refused
 * (AM_NOT_FINITE); after a refusal the old value stays.
 *
 * Beyond the catalogued parameters every table has some that only am_find knows: its nodes
 * (node.CL.basic[3,1], node.CL.gear.K1[0]), a scale (table.CL.basic, start value 1) and an offset
 * (offset.CL.basic).  They change this simulation, not the model; at most 256 of them. */
AM_API int am_set_parameter(am_sim *sim, int i, double value);
AM_API int am_get_parameter(const am_sim *sim, int i, double *value);

/* Set or get the present inputs, one or all (u[am_count(AM_INPUT)]), in the units of the catalogue;
 * refused as parameters are. */
AM_API int am_set_input(am_sim *sim, int i, double value);
AM_API int am_get_input(const am_sim *sim, int i, double *value);
AM_API int am_set_inputs(am_sim *sim, const double *u);
AM_API int am_get_inputs(const am_sim *sim, double *u);

/* Put the state to init.* (body axes, wind of the present inputs), engines to their steady thrust,
 * counters and trim.* to zero; then am_trim when mode.trim is 1, 2 or 3.  Time is set to t [s],
 * within 1e10 s. */
AM_API int am_initialize(am_sim *sim, double t);

/* Trim at the start of a run, as mode.trim.
 *
 * 1 or 2: solve for alpha, beta and biases of elevator, aileron, rudder and of thrust (1, N per
 * engine) or throttle (2), and for a bank within init.phi_range of init.phi, so that u', v', w',
 * p', q', r' take the values init.u_dot ... init.r_dot, with init.V gamma psi h p q r psi_dot
 * held: regularised minimum-norm Newton steps inside the limits of the inputs.
 * 3: stand on the runway, rolling with init.V over the ground along init.psi (0: at rest): height,
 * pitch, bank and, at rest, deflections of the tyres, so that the legs carry the aircraft and, at
 * rest, nothing accelerates.
 *
 * A trim with residuals is a result, not an error: outputs trim.u_dot ... trim.r_dot are the
 * residuals, trim.alpha ... trim.throttle the solution. */
AM_API int am_trim(am_sim *sim, int mode);

/* What a trim moves: input, parameter or state of a submodel (kind AM_INPUT, AM_PARAMETER,
 * AM_STATE) of an index follows an unknown; several may follow one, as the throttles of all
 * engines do. */
typedef struct {
    int kind, index, unknown;
} am_mover;

/* What ties the start together. */
enum {
    AM_PATH_GAMMA = 0, /* theta follows from init.gamma */
    AM_PATH_THETA = 1, /* init.theta is given, the climb angle follows */
    /* init.V is the speed over the ground along init.psi; airspeed and flow angles follow with
     * attitude and wind */
    AM_PATH_GROUND = 2
};

enum { AM_GOAL_CLIMB = -1 }; /* in place of an output: acceleration upward [m s-2] */

/* The arrays belong to the caller and are not changed. */
typedef struct {
    int path, movers, unknowns, goals;
    const am_mover *mover;           /* [movers] */
    const double *low, *high, *size; /* [unknowns]: limits; typical size of a change, > 0 */
    /* [goals]: outputs or AM_GOAL_CLIMB; trim.u_dot ...: accelerations less init.u_dot ... */
    const int *goal;
    const double *wanted; /* [goals], in the units of the outputs */
} am_trim_task;

/* Solve for unknowns so that outputs take wanted values, inside limits, by steps of the smallest
 * norm; no more goals than unknowns.  init.p q r are here rates relative to the horizon; the
 * turn init.psi_dot about the vertical comes on top.
 *
 * found[unknowns]: in the first guess (NaN: the present value; on the ground, for init.h and
 * init.theta, that of standing), out the solution.  y[outputs]: the outputs there.  left[goals]:
 * the residuals, output less wanted value, weighed as an acceleration (m s-2; rotations times
 * half the span, angles and load factors times g, forces times 0.01).  jacobian[goals *
 * unknowns] (may be NULL): slope of `left` over one size of each unknown.  All belong to the
 * caller.
 *
 * The simulation is then in that state, and inputs and init.* hold it: am_initialize with
 * mode.trim = 0 (3 on the ground) comes back to it.  A trim with residuals is a result, not an
 * error. */
AM_API int am_trim_for(am_sim *sim, const am_trim_task *task, double *found, double *y,
                       double *left, double *jacobian);

/* Advance from t to t + dt [s] with inputs linear from u0 to u1 (u1 == u0: held), in equal RK4
 * steps of at most mode.step.  u1 becomes the present input.  On failure the state is that of
 * the last good internal step.  Times lie within 1e10 s. */
AM_API int am_step(am_sim *sim, double t, double dt, const double *u0, const double *u1);

/* All outputs at the present state and input, finite or AM_NOT_FINITE: y[am_count(AM_OUTPUT)],
 * in the units of the catalogue. */
AM_API int am_outputs(am_sim *sim, double *y);

/* A whole record from an initialised simulation: t[n] rising [s], u[n * inputs], y[n * outputs]
 * (row by row).
 *
 * hold = 0: inputs linear between samples; 1: u[k] held from t[k] to t[k + 1], as an importer
 * without interpolation does, and the outputs at t[k + 1] are those under u[k].  *done is the
 * number of rows of y that are valid; on failure am_time and am_error state when and why. */
AM_API int am_run(am_sim *sim, size_t n, const double *t, const double *u, int hold, double *y,
                  size_t *done);

/* The same with a choice of outputs, y[n * outputs] (output NULL: all of them), and, unless
 * terms is NULL, the contribution of every term: terms[n * am_count(AM_TERM)], scales and
 * implicit variables included. */
AM_API int am_record(am_sim *sim, size_t n, const double *t, const double *u, int hold,
                     const int *output, size_t outputs, double *y, double *terms, size_t *done);

/* A loop that is closed sample by sample, as by a pilot: with e = target - output,
 *
 *     gain e + integral * Int e dt,   at most limit in size,
 *
 * is added to an input at both ends of the step to the next sample.  While the limit is reached the
 * integral stands still, unless it comes back.  turns: of an angle, e is taken below half a turn.
 * Loops of one input add up. */
typedef struct {
    int input, output, turns;
    double gain, integral, limit; /* [input / output], [input / output / s], [input] */
    const double *target;         /* target[samples] */
} am_loop;

#define AM_MOST_LOOPS 16

/* Runs of one record from one simulation, each with its own parameters and, where each_inputs is
 * 1, its own inputs.  The arrays belong to the caller; y is written. */
typedef struct {
    size_t samples, parameters, outputs;
    const double *t, *u;  /* t[samples] [s], u[samples * inputs], or u[runs * samples * inputs] */
    const int *parameter; /* indices; values[runs * parameters] */
    const double *values;
    const int *output; /* indices */
    double *y;         /* y[runs * samples * outputs] */
    int hold;          /* as am_run */
    int each_inputs;   /* 0: one u for all runs */
    /* most runs side by side: 0 as many as the processor has lanes for, 1 one after the other; the
     * results have the same bits */
    int lanes;
    size_t loops; /* at most AM_MOST_LOOPS */
    const am_loop *loop;
} am_batch_task;

/* Fly runs first ... last - 1 of a task, so that threads can share a batch, best by multiples of
 * am_lanes; each starts with am_initialize at t[0].  base is not changed.  status, done and text
 * have one place per run.  AM_NOT_READY: no memory. */
AM_API int am_batch(const am_sim *base, const am_batch_task *task, size_t first, size_t last,
                    int *status, size_t *done, char (*text)[AM_TEXT]);

/* Runs that this processor flies side by side: 8 (AVX-512), 4 (AVX2) or 1. */
AM_API int am_lanes(const am_model *model);

/* ---- state access: linearisation, model exchange --------------------------------------------- */

/* Number of states.  x as AM_STATE lists it: position [m] (3) and velocity [m s-1] (3) in Earth
 * axes, quaternion Earth to body (4), p q r [rad s-1], then the submodels.  Earth axes are
 * Earth-centred Earth-fixed, or north-east-down at the start on the flat Earth (mode.earth = 0). */
AM_API int am_state_count(const am_model *model);

/* Copy the state to or from x[am_state_count]. */
AM_API int am_get_state(const am_sim *sim, double *x);
AM_API int am_set_state(am_sim *sim, const double *x);

/* Rate dx[am_state_count] (units of x per second) of the state x under inputs u.  What is not a
 * state, such as a control system with friction, stands still. */
AM_API int am_derivative(am_sim *sim, const double *x, const double *u, double *dx);

/* Model exchange: an accepted step of the importer ends at t [s]; moves what is not a state from
 * am_time to t. */
AM_API int am_complete_step(am_sim *sim, double t);

/* ---- the aero model alone -------------------------------------------------------------------- */

/* Evaluate the tables and terms for n rows of model variables v[n * am_count(AM_VARIABLE)]
 * (columns in catalogue order and units; alphadothat, betadothat and dnz are taken as given).
 * Either result may be NULL.
 *
 * coefficients[n * 6]: CL CD CY Cl Cm Cn (CX CZ CY Cl Cm Cn with body force axes), with the
 * scales of sim, without its biases; terms[n * am_count(AM_TERM)]: contribution of each term
 * with its scale. State and counters of sim are not touched. */
AM_API int am_evaluate(am_sim *sim, size_t n, const double *v, double *coefficients, double *terms);

/* Internal steps since am_initialize that lay outside each axis: below[axes], above[axes]. */
AM_API int am_out_of_range(const am_sim *sim, double *below, double *above);

/* ---- normal equations of a trajectory -------------------------------------------------------- */

enum {
    AM_MOST_UNKNOWNS = 32, /* states of a sample, and constants behind one residual */
    AM_MOST_GROUPS = 32    /* of residuals */
};

/* Sums over residuals of a trajectory with constants, all of the caller, which clears them: of each
 * sample the block D[samples * states * states] and that with the next sample (rows) O[(samples -
 * 1) * states * states], the border G[samples * states * constants], C[constants * constants], the
 * gradients gx[samples * states] and gc[constants], the sum of squares cost. */
typedef struct {
    int states, constants;
    double *D, *O, *G, *C, *gx, *gc, *cost;
} am_normal;

/* Residuals r[n * rows] with their derivatives J[n * rows * columns] by the constants of the
 * indices column[columns], each to be multiplied by weight[n * rows].  Derivatives by the state go
 * to the first `states` of a sample. */
typedef struct {
    int rows, states, columns;
    const int *column;
    const double *r, *weight, *J;
} am_residuals;

/* A flight path and its surroundings: x[samples * states] begins with phi, theta, psi, velocity
 * north, east, down and height; rates and specific force[samples * 3] in body axes, free of the
 * errors of the constants; gravity at the height `level` and what it loses per metre; rate of the
 * Earth, the turning of the level axes by velocity, and the part of the rate of the Earth that the
 * gyros show. [SI] */
typedef struct {
    const double *x, *rates, *force;
    double dt, gravity, fall, level;
    double spin[3], transport[3][3], sensed[3];
} am_path;

/* Constants behind a path: biases of p, q, r and of the specific force forward, right, down, the
 * scale errors of the six, the wind north, east, down, and the lag of the vanes. */
enum { AM_BIAS = 0, AM_SCALE = 6, AM_WIND = 12, AM_LAG = 15 };

/* A path between gyros and accelerometers, at uniform steps.
 *
 * states: those of a sample of x, 7, the lagged angles of the vanes, and any number of others, of
 * which the first three are gusts north, east, down where `gusts` is not zero. input[inputs]: the
 * constants to which derivatives are wanted, each once; gain[6]: 1/(1 + scale error); arm: the
 * inertial unit from the c.g.; sensed[samples * 3]: the specific force where it sits, of which
 * scale errors are a part. Vanes: side is 1 where the angle is atan(v/u), 2 where it is atan(w/u),
 * at vane_arm from the c.g.; their state is y[k + 1] = lag[0] y[k] + lag[1] angle[k] + lag[2]
 * angle[k + 1], and lag_slope are the derivatives of the three by the time constant; over the steps
 * of slow[samples - 1] that are not zero it stays as it is, null: none. [SI] */
typedef struct {
    am_path path;
    int states, inputs, vanes, gusts, side[2];
    const int *input;
    const unsigned char *slow;
    const double *sensed;
    double gain[6], arm[3], wind[3], vane_arm[2][3], lag[3], lag_slope[3];
} am_drive;

/* Residuals of one kind. Between neighbouring samples: A and B[count * rows * states] are the
 * derivatives by the state before and after; or `drive` gives them with r and J, rows are then 7
 * and the vanes, states the rows and gusts, columns its inputs: what the instruments would have to
 * be wrong by; a step of which the first weight is zero parts two windows. Of readings, where k is
 * not null: at the states (1 - f) x[k] + f x[k + 1], with the derivatives A; k < samples, and k <
 * samples - 1 where f is not zero. */
typedef struct {
    am_residuals given;
    size_t count;
    const double *A, *B;
    const am_drive *drive;
    int same; /* not zero: A is that of one reading, and all others have the same */
    const long long *k;
    const double *f;
} am_residual_group;

/* Add groups of residuals, all of a stretch of samples before the next stretch. AM_BAD_ARGUMENT:
 * more unknowns than AM_MOST_UNKNOWNS or groups than AM_MOST_GROUPS, or a drive of other sizes. */
AM_API int am_add_residuals(const am_normal *e, size_t samples, const am_residual_group *group,
                            int groups);

/* Eliminate the states, by Cholesky's factors of the block-tridiagonal matrix: T = F F'.
 *
 * L[samples * states * states]: its diagonal blocks, lower halves; V[samples * states * states]:
 * the transposed blocks below them, of all samples but the last; right[samples * states * width],
 * width = constants + 1 in fours: F^-1 [G, gx, 0]; border[width * width], which the caller clears:
 * the products of these columns are added to its lower half.  Returns -1; the number of the state
 * that nothing determines, by a pivot below 1e-12 of its diagonal in D; or -2 for no state or more
 * than AM_MOST_UNKNOWNS, and nothing is written. */
AM_API long long am_eliminate(const am_normal *e, size_t samples, double *L, double *V,
                              double *right, double *border);

/* x[samples * states * columns] = F'^-1 x, with what am_eliminate left. */
AM_API void am_substitute(int states, size_t samples, const double *L, const double *V,
                          size_t columns, double *x);

/* The path that an inertial unit drives: x[samples * states] from start[states]; gravity, Coriolis
 * acceleration and the turning of the level axes are those of the x of `d`. X[samples * states *
 * (states + inputs)], unless null: the derivatives of each by the start, then by the constants.
 * AM_BAD_ARGUMENT: more vanes than two, states besides, an unknown input, no sample. */
AM_API int am_follow(const am_drive *d, size_t samples, const double *start, double *x, double *X);

/* The unknowns behind a driven path: the first `columns` are those of X, see am_follow. */
typedef struct {
    int states, columns, unknowns;
    const double *X;
} am_driven;

/* Readings at a driven path, see am_residual_group, the indices column[columns] among the unknowns,
 * -1 for a constant that stays. With the derivatives z of a row by the unknowns, then its residual,
 * without weight, each where not null: products[rows * (unknowns + 1) ^ 2], to which the products
 * z' z of each row of a reading are added; series[rows * unknowns * count], zero before, takes the
 * derivatives; pressed[samples * states * unknowns], to which those by the state times weight ^ 2 z
 * are added. AM_BAD_ARGUMENT: more unknowns than three times AM_MOST_UNKNOWNS. */
AM_API int am_add_driven(const am_driven *d, const am_residual_group *group, double *products,
                         double *series, double *pressed);

/* Add to products[unknowns ^ 2] the covariance of the sum of pressed that comes from the noise of
 * gyros and accelerometers on the way to the path x, one sigma of each sample in noise[6]; vanes
 * act without lag. */
AM_API int am_add_noise(const am_drive *d, size_t samples, const double *x, int unknowns,
                        const double *noise, const double *pressed, double *products);

/* ---- free motion of a control circuit -------------------------------------------------------- */

enum { AM_MOST_CIRCUIT_UNKNOWNS = 130 };

/* Constants of a circuit, reduced to the travel s in the cockpit: mass, damping and friction of the
 * cockpit end and of the surface end of the cable, stiffness and damping of the cable; preload and
 * stiffness of the centring spring; deflection at zero travel [rad].  Friction is developed over
 * the rate width, preload over the place width: F tanh(x / width); with bristles, friction is built
 * up over the bristle travel. [SI] */
enum {
    AM_MASS,
    AM_DAMPING,
    AM_FRICTION,
    AM_AFT_MASS,
    AM_AFT_DAMPING,
    AM_AFT_FRICTION,
    AM_CABLE,
    AM_CABLE_DAMPING,
    AM_PRELOAD,
    AM_STIFFNESS,
    AM_RATE_WIDTH,
    AM_PLACE_WIDTH,
    AM_RIGGING,
    AM_BRISTLE_TRAVEL,
    AM_CIRCUIT_CONSTANTS
};

/* A circuit at rest at its start, and what drives it, at uniform steps; by_* are derivatives by the
 * unknowns, which follow each number.
 *
 * bodies: 1, or 2 with a cable.  bristles: 0 friction by rate, 1 by bristles.
 * constants[AM_CIRCUIT_CONSTANTS]; start[2]: travel of both ends; bend[2]: first deflections of
 * their bristles, -1 to 1;
 * force[samples]: at the hand; moment[samples * powers]: hinge moment as a polynomial of the
 * deflection rigging + gearing s, from power 0; edge[samples]: part of the step after a jump of the
 * force between this sample and the next one, NaN without a jump.  parts: sub-steps of a step. */
typedef struct {
    int bodies, bristles, unknowns, powers, parts;
    double step, gearing;
    const double *constants, *by_constants;
    const double *start, *by_start;
    const double *bend, *by_bend;
    const double *force, *by_force;
    const double *moment, *by_moment;
    const double *edge, *by_edge;
} am_circuit;

/* Follow a circuit: travel of both ends y[samples * 2] and derivatives Y[samples * 2 * unknowns],
 * which may be NULL.  AM_BAD_ARGUMENT: sizes, or a width that is not positive; AM_NOT_FINITE: the
 * motion is unbounded; AM_NOT_SOLVED: the velocity at the end of a sub-step did not converge, and
 * the motion after it is not computed. */
AM_API int am_follow_circuit(const am_circuit *c, size_t samples, double *y, double *Y);

#ifdef __cplusplus
}
#endif
#endif
