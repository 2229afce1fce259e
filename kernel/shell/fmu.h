/* One instance of the model behind an FMI interface; fmi2.c and fmi3.c translate their standard's calls to these.
 *
 * Value references: time 0, then catalogue index + the base of its kind (the writer of modelDescription.xml uses the same).
 * Statuses are those that FMI 2.0 and FMI 3.0 have in common.  A value that is refused leaves the instance as it was; a
 * failed initialisation or step leaves it in FMU_FAILED, where only reading, fmu_reset and fmu_put_state are allowed. */
#ifndef AEROMATCH_FMU_H
#define AEROMATCH_FMU_H

#include <stddef.h>
#include <stdint.h>

#include "kernel.h"

enum { FMU_OK = 0, FMU_ERROR = 3 };
enum { FMU_TIME = 0, FMU_INPUTS = 1000, FMU_OUTPUTS = 10000, FMU_PARAMETERS = 100000 };

typedef enum { FMU_CREATED, FMU_INITIALIZING, FMU_STEPPING, FMU_STOPPED, FMU_FAILED } fmu_phase;

typedef struct fmu fmu;
typedef struct fmu_state fmu_state;

/* Where messages go: `tell` passes the text to the importer's own logger in the manner of its standard. */
typedef struct fmu_logger {
    void (*tell)(const struct fmu_logger *logger, int status, const char *text);
    void *environment;
    void (*callback)(void); /* the importer's function, cast back by `tell` */
    char name[128];         /* of the instance */
} fmu_logger;

/* Read <resources>/model.bin, check it against the token and make an instance; NULL after a message to the logger. */
fmu *fmu_open(const char *resources, const char *token, const fmu_logger *logger);
void fmu_close(fmu *f);

/* Send a message (printf format) and return FMU_ERROR. */
int fmu_refuse(const fmu *f, const char *format, ...) __attribute__((format(printf, 2, 3)));

int fmu_set_start(fmu *f, double start);
int fmu_begin_initialization(fmu *f);
int fmu_end_initialization(fmu *f);
int fmu_step(fmu *f, double t, double dt);
int fmu_stop(fmu *f);
int fmu_reset(fmu *f);
double fmu_time(const fmu *f);

int fmu_get(fmu *f, const uint32_t vr[], size_t n, double values[]);
int fmu_set(fmu *f, const uint32_t vr[], size_t n, const double values[]);
int fmu_check_integers(const fmu *f, const uint32_t vr[], size_t n);
/* Time derivatives of inputs at the start of the next step; they act in that step only. */
int fmu_set_slopes(fmu *f, const uint32_t vr[], size_t n, const double slopes[]);

int fmu_take_state(fmu *f, fmu_state **state);
int fmu_put_state(fmu *f, const fmu_state *state);
void fmu_free_state(fmu_state **state);
size_t fmu_image_size(const fmu *f);
int fmu_save_state(const fmu *f, const fmu_state *state, void *image, size_t n);
int fmu_load_state(fmu *f, const void *image, size_t n, fmu_state **state);

#endif
