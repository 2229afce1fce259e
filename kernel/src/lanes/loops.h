/* The loops of a batch between two samples: what they add to the inputs of the next step. */
#ifndef AEROMATCH_LOOPS_H
#define AEROMATCH_LOOPS_H

#include "kernel.h"

#include <math.h>
#include <stdbool.h>

#define TURN 6.283185307179586

/* Of one run: the integral of each loop, and at the first loop of an input the sum of all of it. */
typedef struct {
    double integral[AM_MOST_LOOPS], push[AM_MOST_LOOPS];
} loops_t;

/* The remainder of IEEE 754 by a turn: every difference is exact. */
static inline double below_half_turn(double off) {
    double x = fabs(off);
    double part = TURN;
    bool odd = false;
    while (part <= 0.5 * x) part *= 2.0;
    for (; part >= TURN; part *= 0.5) {
        odd = x >= part;
        if (odd) x -= part;
    }
    if (x > 0.5 * TURN || (x == 0.5 * TURN && odd)) x -= TURN;
    return signbit(off) ? -x : x;
}

static inline size_t first_loop(const am_batch_task *task, size_t i) {
    size_t first = 0;
    while (task->loop[first].input != task->loop[i].input) first++;
    return first;
}

/* Loops at sample k, with the output that each holds. */
static inline void close_loops(const am_batch_task *task, size_t k, const double *y, loops_t *p) {
    for (size_t i = 0; i < task->loops; i++) p->push[i] = 0.0;
    for (size_t i = 0; i < task->loops; i++) {
        const am_loop *loop = task->loop + i;
        const double off = loop->target[k] - y[i];
        const double e = loop->turns && isfinite(off) ? below_half_turn(off) : off;
        const double wanted = loop->gain * e + p->integral[i];
        const double least = wanted < -loop->limit ? -loop->limit : wanted;
        const double found = least > loop->limit ? loop->limit : least;
        const double rise = loop->integral * e;
        if (k + 1 < task->samples && (found == wanted || rise * wanted < 0.0)) {
            p->integral[i] += rise * (task->t[k + 1] - task->t[k]);
        }
        p->push[first_loop(task, i)] += found;
    }
}

/* Inputs of the step from sample k on, at one of its ends. */
static inline void add_push(const am_batch_task *task, const loops_t *p, double *u) {
    for (size_t i = 0; i < task->loops; i++) {
        if (first_loop(task, i) == i) u[task->loop[i].input] += p->push[i];
    }
}

#endif
