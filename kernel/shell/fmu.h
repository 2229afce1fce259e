/* One instance of the model behind an FMI interface; fmi2.c and fmi3.c translate their
 * standard's calls to these.
 *
 * Value references: time 0, then catalogue index + the base of its kind (the writer of
 * modelDescription.xml uses the same). Statuses are those that FMI 2.0 and FMI 3.0 have in
 * common.  A call that is refused leaves the instance as it was; a failed initialisation or step
 * leaves it in FMU_FAILED, where only reading, fmu_reset and fmu_set_state are allowed. */
#ifndef AEROMATCH_FMU_H
#define AEROMATCH_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "kernel.h"

#define AM_FMI AM_SHOWN /* a function of the standard */

enum { FMU_OK = 0, FMU_DISCARD = 2, FMU_ERROR = 3 };
enum {
    FMU_TIME = 0,
    FMU_INPUTS = 1000,
    FMU_OUTPUTS = 10000,
    FMU_STATES = 50000,
    FMU_DERIVATIVES = 60000,
    FMU_PARAMETERS = 100000
};
enum { FMU_REPLAY_N = 70000, FMU_REPLAY_T, FMU_REPLAY_U, FMU_REPLAY_Y };

typedef enum { FMU_MODEL_EXCHANGE, FMU_CO_SIMULATION } fmu_kind;
/* The order is that of `phases` in guard.c; FMU_STEPPING belongs to co-simulation, FMU_EVENT and
 * FMU_CONTINUOUS to model exchange. */
typedef enum {
    FMU_CREATED,
    FMU_CONFIGURING,
    FMU_INITIALIZING,
    FMU_STEPPING,
    FMU_EVENT,
    FMU_CONTINUOUS,
    FMU_STOPPED,
    FMU_FAILED
} fmu_phase;

typedef struct fmu fmu;
typedef struct fmu_state fmu_state;

/* Where messages go: `report` passes the text to the importer's own logger in the manner of its
 * standard. */
typedef struct fmu_logger {
    void (*report)(const struct fmu_logger *logger, int status, const char *text);
    void *environment;
    void (*callback)(void); /* the importer's function, cast back by `report` */
    char name[128];         /* of the instance */
} fmu_logger;

/* ---- life.c ---------------------------------------------------------------------------------- */

/* Read model.bin in the folder `resources` (a path or a file URI), check it against the token (its
 * SHA-256) and make an instance; NULL after a message to the logger.  Free it with fmu_close. */
fmu *fmu_open(const char *resources, const char *token, fmu_kind kind, const fmu_logger *logger);
void fmu_close(fmu *f);

/* Back to FMU_CREATED with the start values of the model. */
int fmu_reset(fmu *f);

/* ---- guard.c --------------------------------------------------------------------------------- */

/* Send a message (printf format) and return FMU_ERROR. */
int fmu_refuse(const fmu *f, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* ---- steps.c: modes and steps of co-simulation ----------------------------------------------- */

/* Start time [s], before initialization mode. */
int fmu_set_start(fmu *f, double start);

/* Change of phase, refused where the standard does not allow it. */
int fmu_begin_configuration(fmu *f);
int fmu_end_configuration(fmu *f);
int fmu_begin_initialization(fmu *f);
int fmu_end_initialization(fmu *f);
int fmu_stop(fmu *f);

/* Advance from t, where the instance stands, to t + dt. [s] */
int fmu_step(fmu *f, double t, double dt);

/* Time reached. [s] */
double fmu_time(const fmu *f);

/* ---- values.c -------------------------------------------------------------------------------- */

/* Values of n variables one behind the other; an array takes as many as it has elements. */
int fmu_get(fmu *f, const uint32_t vr[], size_t n, double values[], size_t nvalues);
int fmu_set(fmu *f, const uint32_t vr[], size_t n, const double values[], size_t nvalues);
int fmu_check_integers(const fmu *f, const uint32_t vr[], size_t n);
/* Time derivatives of inputs at the start of the next step; they act in that step only. */
int fmu_set_slopes(fmu *f, const uint32_t vr[], size_t n, const double slopes[]);

/* ---- partials.c: partial derivatives --------------------------------------------------------- */

/* Of outputs and state derivatives (unknowns) over inputs and states (knowns): to[nu] = J seed[nk],
 * and to[nk] = J^T seed[nu]. */
int fmu_directional(fmu *f, const uint32_t unknowns[], size_t nu, const uint32_t knowns[],
                    size_t nk, const double seed[], double to[]);
int fmu_adjoint(fmu *f, const uint32_t unknowns[], size_t nu, const uint32_t knowns[], size_t nk,
                const double seed[], double to[]);

/* ---- replay.c: a whole record in one step ---------------------------------------------------- */

int fmu_get_samples(fmu *f, const uint32_t vr[], size_t n, uint64_t counts[]);
int fmu_set_samples(fmu *f, const uint32_t vr[], size_t n, const uint64_t counts[]);

/* ---- exchange.c: model exchange -------------------------------------------------------------- */

int fmu_begin_event(fmu *f);
int fmu_begin_continuous(fmu *f);
/* The discrete part is brought to the present time; *next_event is the time of the next time
 * event, or infinity. */
int fmu_update_discrete(fmu *f, double *next_event);
/* *event: event mode is needed. */
int fmu_complete_step(fmu *f, int *event);
int fmu_set_time(fmu *f, double t);
int fmu_set_states(fmu *f, const double x[], size_t n);
int fmu_get_states(fmu *f, double x[], size_t n);
int fmu_get_derivatives(fmu *f, double dx[], size_t n);
int fmu_get_nominals(fmu *f, double nominals[], size_t n);
int fmu_get_indicators(fmu *f, size_t n);
int fmu_count_states(fmu *f, size_t *n);

/* ---- store.c: stored states ------------------------------------------------------------------ */

int fmu_get_state(fmu *f, fmu_state **state);
int fmu_set_state(fmu *f, const fmu_state *state);
void fmu_free_state(fmu_state **state);
int fmu_state_size(const fmu *f, const fmu_state *state, size_t *size);
int fmu_save_state(const fmu *f, const fmu_state *state, void *image, size_t n);
int fmu_load_state(fmu *f, const void *image, size_t n, fmu_state **state);

#endif
