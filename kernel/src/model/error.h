/* Failures: the text that am_error returns, and the checks that every unit makes. */
#ifndef AEROMATCH_ERROR_H
#define AEROMATCH_ERROR_H

#include "four.h"
#include "simulation.h"

/* Write the text of a failure (printf format) and return the status. */
int fail(am_sim *sim, int status, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* Fail with AM_BAD_VALUE: <name> is <value>; it must be <rule>. */
int bad_parameter(am_sim *sim, uint32_t parameter, const char *rule);

/* The same for a parameter given by its place in sim->par. */
int bad_value(am_sim *sim, const double *parameter, const char *rule);

/* AM_NOT_FINITE when one of the values of a kind is NaN or infinite: names the first, and the
 * time. */
int check_finite(am_sim *sim, am_kind kind, const double *values);

static inline bool all_finite(const double *a, size_t n) {
    /* NaN and infinity by zero are NaN, and stay it; four sums do not wait for each other */
    four nothing = {0.0};
    size_t i = 0;
    for (; i + 4 <= n; i += 4) nothing += AT(a + i) * 0.0;
    for (; i < n; i++) nothing[0] += a[i] * 0.0;
    return (nothing[0] + nothing[1]) + (nothing[2] + nothing[3]) == 0.0;
}

#endif
