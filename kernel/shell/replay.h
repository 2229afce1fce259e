/* A whole record in one step: the arrays of FMI 3.0. */
#ifndef AEROMATCH_REPLAY_H
#define AEROMATCH_REPLAY_H

#include "instance.h"

/* Doubles of t, u and y together for n samples. */
size_t replay_doubles(const fmu *f, uint64_t n);

/* New arrays of n samples: times zero, inputs at their present values, outputs NaN. */
int replay_resize(fmu *f, uint64_t n);
int replay_copy(const fmu *f, replay *to, const replay *from);

/* Elements of one of the three arrays, and their values. */
size_t replay_elements(const fmu *f, uint32_t vr);
void replay_get(const fmu *f, uint32_t vr, double values[]);
void replay_set(fmu *f, uint32_t vr, const double values[]);

/* A record is there and has not been run. */
int replay_waiting(const fmu *f);

/* Run the record, which must be that of the step from t to t + dt. [s] */
int replay_run(fmu *f, double t, double dt);

#endif
