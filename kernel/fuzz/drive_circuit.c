/* The free motion of a control circuit, chosen by bytes. Every array has exactly the size that
 * kernel.h states. */
#include "drive_circuit.h"

#include "kernel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    MOST_SAMPLES = 8,
    MOST_POWERS = 4,
    MOST_PARTS = 3,
    SOME_UNKNOWNS = 5,
    BODIES = 2,
    STRANGE = 32 /* one size in so many is one that is to be refused */
};

static int strange(bytes_t *bytes) { return take_byte(bytes) % STRANGE == 0; }

/* Numbers of moderate size around a middle, or now and then of any. */
static double *numbers(bytes_t *bytes, size_t n, double middle) {
    double *to = room(n);
    const int tame = take_byte(bytes) % 8;
    for (size_t i = 0; i < n; i++) {
        to[i] = tame ? middle + (take_byte(bytes) - 128) / 128.0 : take_value(bytes);
    }
    return to;
}

/* Constants of a circuit that can move, or now and then of any. */
static double *take_constants(bytes_t *bytes) {
    double *q = numbers(bytes, AM_CIRCUIT_CONSTANTS, 1.5);
    if (strange(bytes)) return q;
    q[AM_CABLE] *= 1e3;
    q[AM_STIFFNESS] *= 1e2;
    q[AM_RATE_WIDTH] = 1e-3 * (1 + take_byte(bytes));
    q[AM_PLACE_WIDTH] = 1e-3 * (1 + take_byte(bytes));
    q[AM_BRISTLE_TRAVEL] = 1e-4 * (1 + take_byte(bytes));
    return q;
}

/* Jumps of the force: none, in the step, or at and beyond its ends. */
static double *take_edges(bytes_t *bytes, size_t samples) {
    double *to = room(samples);
    for (size_t k = 0; k < samples; k++) {
        const uint8_t kind = take_byte(bytes);
        to[k] = kind % 2 ? NAN : kind % 16 ? kind / 255.0 : take_value(bytes);
    }
    return to;
}

static void promise_motion(const double *y, const double *alone, size_t samples) {
    promise(memcmp(y, alone, samples * BODIES * sizeof *y) == 0,
            "derivatives do not change the motion");
    for (size_t i = 0; i < BODIES * samples; i++) {
        promise(isfinite(y[i]), "the travel of a circuit that was followed is finite");
    }
}

void call_circuit(bytes_t *bytes) {
    const size_t samples = 1 + take_byte(bytes) % MOST_SAMPLES;
    const size_t powers = 1 + take_byte(bytes) % MOST_POWERS;
    const size_t n = strange(bytes) ? AM_MOST_CIRCUIT_UNKNOWNS + take_byte(bytes) % 2
                                    : take_byte(bytes) % (SOME_UNKNOWNS + 1);
    double *constants = take_constants(bytes);
    double *start = numbers(bytes, BODIES, 0.0);
    double *bend = numbers(bytes, BODIES, 0.0);
    double *force = numbers(bytes, samples, 0.0);
    double *moment = numbers(bytes, samples * powers, 0.0);
    double *edge = take_edges(bytes, samples);
    double *by_constants = numbers(bytes, n * AM_CIRCUIT_CONSTANTS, 0.0);
    double *by_start = numbers(bytes, n * BODIES, 0.0);
    double *by_bend = numbers(bytes, n * BODIES, 0.0);
    double *by_force = numbers(bytes, n * samples, 0.0);
    double *by_moment = numbers(bytes, n * samples * powers, 0.0);
    double *by_edge = numbers(bytes, n * samples, 0.0);
    const am_circuit circuit = {
        .bodies = strange(bytes) ? take_byte(bytes) % 4 : 1 + take_byte(bytes) % BODIES,
        .bristles = take_byte(bytes) % 2,
        .unknowns = (int)n,
        .powers = (int)powers - (strange(bytes) ? (int)powers : 0),
        .parts = strange(bytes) ? 0 : 1 + take_byte(bytes) % MOST_PARTS,
        .step = take_byte(bytes) % 8 ? 0.02 : take_value(bytes),
        .gearing = take_byte(bytes) % 8 ? 1.2 : take_value(bytes),
        .constants = constants,
        .by_constants = by_constants,
        .start = start,
        .by_start = by_start,
        .bend = bend,
        .by_bend = by_bend,
        .force = force,
        .by_force = by_force,
        .moment = moment,
        .by_moment = by_moment,
        .edge = edge,
        .by_edge = by_edge};
    double *y = room(samples * BODIES);
    double *alone = room(samples * BODIES);
    double *Y = room(samples * BODIES * n);
    const int status = am_follow_circuit(&circuit, samples, y, Y);
    promise(status == AM_OK || status == AM_BAD_ARGUMENT || status == AM_NOT_FINITE
                || status == AM_NOT_SOLVED,
            "a circuit is followed or refused");
    promise(am_follow_circuit(&circuit, samples, alone, NULL) == status,
            "derivatives do not change the answer");
    if (status == AM_OK) promise_motion(y, alone, samples);
    double *owned[] = {constants, start,    bend,     force,   moment,    edge,
                       by_start,  by_bend,  by_force, by_moment, by_edge, by_constants,
                       y,         alone,    Y};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) free(owned[i]);
}
