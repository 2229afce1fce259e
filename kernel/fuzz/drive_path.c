/* The calls of kernel.h that an estimation makes, chosen by bytes: a path that an inertial unit
 * drives, sums over its steps and readings, and the elimination of its states. Every array has
 * exactly the size that kernel.h states. */
#include "drive_path.h"

#include "kernel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    MOST_SAMPLES = 6,
    PATH = 7,            /* states of attitude, velocity and height */
    MOST_INPUTS = AM_LAG + 1,
    MOST_CONSTANTS = 9,
    MOST_ROWS = 3,       /* of a reading */
    READINGS = 4,
    MOST_STATES = 40,    /* of an elimination; more than AM_MOST_UNKNOWNS are refused */
    STRANGE = 32         /* one size in so many is one that is to be refused */
};

/* Numbers of moderate size, or now and then of any. */
static double *numbers(bytes_t *bytes, size_t n) {
    double *to = room(n);
    const int tame = take_byte(bytes) % 4;
    for (size_t i = 0; i < n; i++) {
        to[i] = tame ? (take_byte(bytes) - 128) / 64.0 : take_value(bytes);
    }
    return to;
}

static double *zeros(size_t n) {
    double *to = room(n);
    if (n) memset(to, 0, n * sizeof *to);
    return to;
}

static int strange(bytes_t *bytes) { return take_byte(bytes) % STRANGE == 0; }

static void fill(double *to, size_t n, bytes_t *bytes) {
    double *from = numbers(bytes, n);
    memcpy(to, from, n * sizeof *to);
    free(from);
}

/* ---- a path ---------------------------------------------------------------------------------- */

typedef struct {
    am_drive drive;
    size_t samples;
    int input[MOST_INPUTS + 1];
    double *x, *rates, *force, *sensed;
    unsigned char *slow;
} path_t;

static void take_path(path_t *p, bytes_t *bytes) {
    am_drive *d = &p->drive;
    memset(p, 0, sizeof *p);
    p->samples = 1 + take_byte(bytes) % MOST_SAMPLES;
    d->vanes = strange(bytes) ? 3 : take_byte(bytes) % 3;
    d->gusts = take_byte(bytes) % 4 == 0;
    d->states = PATH + d->vanes + (d->gusts ? 3 : 0) + (take_byte(bytes) % 4 == 0);
    d->inputs = strange(bytes) ? MOST_INPUTS + 1 : take_byte(bytes) % (MOST_INPUTS + 1);
    for (int i = 0; i < d->inputs; i++) {
        p->input[i] = strange(bytes) ? take_byte(bytes) - 100 : (i + 7) % MOST_INPUTS;
    }
    d->input = p->input;
    for (int i = 0; i < 2; i++) d->side[i] = strange(bytes) ? 0 : 1 + take_byte(bytes) % 2;
    p->x = numbers(bytes, p->samples * (size_t)d->states);
    p->rates = numbers(bytes, 3 * p->samples);
    p->force = numbers(bytes, 3 * p->samples);
    p->sensed = numbers(bytes, 3 * p->samples);
    p->slow = malloc(p->samples);
    if (!p->slow) exit(0);
    for (size_t k = 0; k < p->samples; k++) p->slow[k] = take_byte(bytes) % 4 == 0;
    d->slow = take_byte(bytes) % 2 ? p->slow : NULL;
    d->sensed = p->sensed;
    d->path = (am_path){.x = p->x, .rates = p->rates, .force = p->force};
    d->path.dt = take_byte(bytes) % 8 ? 0.02 : take_value(bytes);
    d->path.gravity = take_byte(bytes) % 8 ? 9.8 : take_value(bytes);
    fill(d->path.spin, 3, bytes);
    fill(d->path.transport[0], 9, bytes);
    fill(d->path.sensed, 3, bytes);
    fill(d->gain, 6, bytes);
    fill(d->arm, 3, bytes);
    fill(d->wind, 3, bytes);
    fill(d->vane_arm[0], 6, bytes);
    fill(d->lag, 3, bytes);
    fill(d->lag_slope, 3, bytes);
}

static void free_path(path_t *p) {
    free(p->x);
    free(p->rates);
    free(p->force);
    free(p->sensed);
    free(p->slow);
}

/* ---- readings -------------------------------------------------------------------------------- */

typedef struct {
    am_residual_group group;
    int column[MOST_CONSTANTS];
    long long k[READINGS];
    double *r, *weight, *J, *A, *f;
} readings_t;

/* Readings at states of the path, their columns among `constants`. */
static void take_readings(readings_t *o, size_t samples, int states, int constants,
                          bytes_t *bytes) {
    am_residuals *given = &o->group.given;
    size_t k = 0;
    memset(o, 0, sizeof *o);
    given->rows = 1 + take_byte(bytes) % MOST_ROWS;
    given->states = take_byte(bytes) % 2 ? states : states / 2;
    given->columns = constants ? take_byte(bytes) % (constants + 1) : 0;
    for (int i = 0; i < given->columns; i++) o->column[i] = i;
    o->group.count = take_byte(bytes) % (READINGS + 1);
    const size_t n = o->group.count * (size_t)given->rows;
    o->group.same = take_byte(bytes) % 4 == 0;
    o->r = numbers(bytes, n);
    o->weight = numbers(bytes, n);
    o->J = numbers(bytes, n * (size_t)given->columns);
    o->A = numbers(bytes, (o->group.same ? (size_t)given->rows : n) * (size_t)given->states);
    o->f = room(READINGS);
    for (size_t i = 0; i < READINGS; i++) {
        if (k + 1 < samples && take_byte(bytes) % 2) k++;
        o->k[i] = (long long)k;
        o->f[i] = k + 1 < samples ? take_byte(bytes) / 256.0 : 0.0;
    }
    given->column = o->column;
    given->r = o->r;
    given->weight = o->weight;
    given->J = o->J;
    o->group.A = o->A;
    o->group.k = o->k;
    o->group.f = o->f;
}

static void free_readings(readings_t *o) {
    free(o->r);
    free(o->weight);
    free(o->J);
    free(o->A);
    free(o->f);
}

/* ---- sums ------------------------------------------------------------------------------------ */

static am_normal take_sums(size_t samples, int states, int constants) {
    const size_t n = (size_t)states;
    const size_t c = (size_t)constants;
    return (am_normal){.states = states,
                       .constants = constants,
                       .D = zeros(samples * n * n),
                       .O = zeros((samples - 1) * n * n),
                       .G = zeros(samples * n * c),
                       .C = zeros(c * c),
                       .gx = zeros(samples * n),
                       .gc = zeros(c),
                       .cost = zeros(1)};
}

static void free_sums(am_normal *e) {
    free(e->D);
    free(e->O);
    free(e->G);
    free(e->C);
    free(e->gx);
    free(e->gc);
    free(e->cost);
}

static void eliminate(const am_normal *e, size_t samples) {
    const size_t n = (size_t)e->states;
    const size_t width = ((size_t)e->constants + 4) / 4 * 4;
    double *L = room(samples * n * n);
    double *V = room(samples * n * n);
    double *right = room(samples * n * width);
    double *border = zeros(width * width);
    const long long failed = am_eliminate(e, samples, L, V, right, border);
    if (n > AM_MOST_UNKNOWNS) promise(failed == -2, "more states are refused");
    else promise(failed >= -1 && failed < (long long)(samples * n), "a state that there is");
    if (failed == -1) {
        double *x = zeros(samples * n * 3);
        am_substitute(e->states, samples, L, V, 3, x);
        for (size_t i = 0; i < samples * n * 3; i++) {
            promise(x[i] == 0.0 || x[i] != x[i], "0 = F 0");
        }
        free(x);
    }
    free(L);
    free(V);
    free(right);
    free(border);
}

/* Sums over the steps of the path and readings along it, then the elimination. */
static void add_residuals(const path_t *p, bytes_t *bytes) {
    const am_drive *d = &p->drive;
    readings_t readings;
    const int rows = PATH + d->vanes;
    const size_t steps = p->samples - 1;
    am_normal e = take_sums(p->samples, d->states, d->inputs);
    double *r = numbers(bytes, steps * (size_t)rows);
    double *weight = numbers(bytes, steps * (size_t)rows);
    double *J = numbers(bytes, steps * (size_t)(rows * d->inputs));
    int column[MOST_INPUTS + 1];
    for (int i = 0; i < d->inputs; i++) column[i] = i;
    take_readings(&readings, p->samples, d->states, d->inputs < 9 ? d->inputs : 9, bytes);
    const am_residual_group group[2] = {
        {.given = {.rows = rows,
                   .states = rows + (d->gusts ? 3 : 0),
                   .columns = d->inputs,
                   .column = column,
                   .r = r,
                   .weight = weight,
                   .J = J},
         .count = steps,
         .drive = d},
        readings.group};
    const int first = take_byte(bytes) % 2;
    const int status = am_add_residuals(&e, p->samples, group + first, 2 - first);
    promise(status == AM_OK || status == AM_BAD_ARGUMENT, "sums are made or refused");
    for (size_t i = 0; take_byte(bytes) % 2 && i < p->samples * (size_t)d->states; i++) {
        const size_t n = (size_t)d->states;
        e.D[i / n * n * n + i % n * (n + 1)] += 1e3; /* so that all states are determined */
    }
    eliminate(&e, p->samples);
    free(r);
    free(weight);
    free(J);
    free_readings(&readings);
    free_sums(&e);
}

/* Sums of any numbers, of more states than a path has. */
static void eliminate_any(bytes_t *bytes) {
    const size_t samples = 1 + take_byte(bytes) % 3;
    const int states = 1 + take_byte(bytes) % MOST_STATES;
    const int constants = take_byte(bytes) % MOST_CONSTANTS;
    const size_t n = (size_t)states;
    am_normal e = take_sums(samples, states, constants);
    fill(e.D, samples * n * n, bytes);
    fill(e.O, (samples - 1) * n * n, bytes);
    fill(e.G, samples * n * (size_t)constants, bytes);
    const double added = take_byte(bytes) % 4 ? 1e4 : 0.0; /* so that all states are determined */
    for (size_t i = 0; i < samples * n; i++) e.D[i / n * n * n + i % n * (n + 1)] += added;
    eliminate(&e, samples);
    free_sums(&e);
}

static void follow(const path_t *p, bytes_t *bytes) {
    const am_drive *d = &p->drive;
    const size_t n = (size_t)d->states;
    const size_t columns = n + (size_t)d->inputs;
    const int unknowns = (int)columns + take_byte(bytes) % 3;
    const size_t wide = (size_t)unknowns;
    readings_t readings;
    double *start = numbers(bytes, n);
    double *x = room(p->samples * n);
    double *X = zeros(p->samples * n * columns);
    double *noise = numbers(bytes, 6);
    double *pressed = zeros(p->samples * n * wide);
    double *products = zeros(wide * wide);
    take_readings(&readings, p->samples, d->states, MOST_CONSTANTS, bytes);
    for (int i = 0; i < readings.group.given.columns; i++) {
        readings.column[i] = (int)take_number(bytes, (uint32_t)unknowns + 1) - 1;
    }
    const size_t rows = (size_t)readings.group.given.rows;
    double *row_products = zeros(rows * (wide + 1) * (wide + 1));
    double *series = zeros(rows * wide * readings.group.count);
    const am_driven driven = {d->states, (int)columns, unknowns, X};
    int status = am_follow(d, p->samples, start, x, take_byte(bytes) % 4 ? X : NULL);
    promise(status == AM_OK || status == AM_BAD_ARGUMENT, "a path is followed or refused");
    if (status == AM_OK) {
        status = am_add_driven(&driven, &readings.group, row_products,
                               take_byte(bytes) % 2 ? series : NULL,
                               take_byte(bytes) % 4 ? pressed : NULL);
        promise(status == AM_OK, "readings of a path that was followed are added");
        status = am_add_noise(d, p->samples, x, unknowns, noise, pressed, products);
        promise(status == AM_OK, "and its noise");
    }
    free(start);
    free(x);
    free(X);
    free(noise);
    free(pressed);
    free(products);
    free(row_products);
    free(series);
    free_readings(&readings);
}

void call_estimation(bytes_t *bytes) {
    path_t path;
    take_path(&path, bytes);
    follow(&path, bytes);
    add_residuals(&path, bytes);
    eliminate_any(bytes);
    free_path(&path);
}
