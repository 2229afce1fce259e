/* What an instance consists of: private to the shell. */
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

#endif
