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
size_t delay_used(const double *line); /* doubles that hold something, from the first on */
/* Whether the line is at a value from its first knot to its last, which is not beyond t; moves the
 * end of such a line: what delay_record of the same value does. */
bool delay_still(const double *line, double t, double value);
void delay_extend(double *line, double t);
/* at a jump: the value after or before it */
double delay_read(const double *line, double t, bool after);

#endif
