/* A pure delay of a signal that is linear between knots and may jump: exact, whatever the steps
 * that bring the knots. */
#ifndef AEROMATCH_DELAY_H
#define AEROMATCH_DELAY_H

#include <stdbool.h>
#include <stddef.h>

#define DELAY_KNOTS 512
#define DELAY_DOUBLES (1 + 2 * DELAY_KNOTS) /* what a delay needs of the discrete memory */

void delay_start(double *line, double t, double value); /* value since ever */
/* linear from the knot before; a second one at the same t jumps */
void delay_record(double *line, double t, double value, double delay);
/* bytes from outside: whether no knot lies beyond the last place */
bool delay_valid(const double *line, bool started);
/* at a jump: the value after or before it */
double delay_search(const double *line, double t, bool after);

/* ---- lines that stand still, as most do in most steps ---------------------------------------- */

/* times that count as one, for a jump: sums of steps round differently [s] */
#define DELAY_NEAR 1e-9

/* Count of knots, and time and value of the first two. */
enum { DELAY_COUNT, DELAY_T0, DELAY_V0, DELAY_T1, DELAY_V1 };

/* doubles that hold something, from the first on */
static inline size_t delay_used(const double *line) {
    return DELAY_T0 + 2 * (size_t)line[DELAY_COUNT];
}

static inline bool delay_level(const double *line) {
    return line[DELAY_COUNT] == 2.0 && line[DELAY_V0] == line[DELAY_V1];
}

static inline double delay_read(const double *line, double t, bool after) {
    return delay_level(line) ? line[DELAY_V0] : delay_search(line, t, after);
}

/* Whether the line is at a value from its first knot to its last, which is not beyond t; moves the
 * end of such a line: what delay_record of the same value does. */
static inline bool delay_still(const double *line, double t, double value) {
    return delay_level(line) && line[DELAY_V0] == value && line[DELAY_T0] < line[DELAY_T1]
           && line[DELAY_T1] <= t + DELAY_NEAR;
}

static inline void delay_extend(double *line, double t) {
    if (line[DELAY_T1] < t) line[DELAY_T1] = t;
}

#endif
