/* What an instance consists of: private to fmu.c, exchange.c, replay.c and store.c. */
#ifndef AEROMATCH_INSTANCE_H
#define AEROMATCH_INSTANCE_H

#include "fmu.h"

/* Arrays of an FMI 3.0 replay; with n = 1 there is none.  t, u and y are one piece of memory
 * that begins at t. */
typedef struct {
    uint64_t n;
    double *t; /* [n], s */
    double *u; /* [n][inputs] */
    double *y; /* [n][outputs], NaN where not reached */
    int done;  /* the record has been run; steps are ordinary ones until t or u is set again */
} replay;

struct fmu {
    am_model *model;
    am_sim *sim;
    fmu_kind kind;
    fmu_phase phase;
    size_t inputs, outputs, parameters, states;
    double *u0, *u1; /* inputs at both ends of a step */
    double *slopes;  /* of the inputs, for the next step */
    double *y;       /* outputs, valid when fresh */
    double *x, *dx;  /* states and their derivatives, scratch */
    double *memory;  /* of model exchange: the discrete part before a step, scratch */
    double start;    /* [s] */
    double time;     /* of model exchange [s] */
    int moving;      /* the discrete part has been seen to move */
    int fresh;       /* y belongs to the present state, inputs and parameters */
    int initialized; /* am_initialize has run on the present inputs and parameters */
    replay replay;
    char token[65];
    fmu_logger logger;
};

/* fmu.c */
int demand(const fmu *f, int allowed, const char *what);
int demand_initialized(fmu *f, const char *what);
int refresh_outputs(fmu *f);

/* replay.c */
size_t replay_doubles(const fmu *f, uint64_t n); /* of t, u and y together */
int replay_resize(fmu *f, uint64_t n);
int replay_copy(const fmu *f, replay *to, const replay *from);
size_t replay_elements(const fmu *f, uint32_t vr); /* 0: not one of the arrays */
int replay_get(fmu *f, uint32_t vr, double values[]);
void replay_set(fmu *f, uint32_t vr, const double values[]);
int replay_waiting(const fmu *f);
int replay_run(fmu *f, double t, double dt);

#endif
