/* The free motion of a control circuit with smooth dry friction, and its derivatives by unknowns.
 *
 * Over a sub-step h from (s, v) to (s+, w), with the mean velocity (v + w) / 2 and positions in the
 * middle of the step,
 *
 *     M (w - v) / h = f - C s - W (v + w) / 2 - R T(v, w; v0) - P T(s, s+; s0) - cable
 *     s+ = s + h (v + w) / 2
 *
 * where T(x, y; z) is the mean of tanh(q / z) for a q that runs evenly from x to y (averaged vector
 * field of Quispel and McLaren, J. Phys. A 41, 2008).  A reversal inside a sub-step has the
 * friction of its time, wherever it lies, so the motion is a smooth function of all constants: a
 * pointwise rule would add the impulse of a part of a sub-step.  The derivatives are those of the
 * scheme.
 *
 * With bristles, friction is R y with a deflection y of -1 to 1 that the travel builds up (P. Dahl,
 * A solid friction model, 1968; LuGre without Stribeck effect):
 *
 *     dy/ds = (1 - y sgn(v)) / b
 *
 * It is solved exactly along the path of a velocity that changes evenly from v to w, back and forth
 * if the sub-step has a reversal, so y is smooth in both velocities.  The friction of a sub-step is
 * R times the mean of y at its ends. */
#include "elementary.h"
#include "kernel.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum { BODIES = 2, MOST_ROUNDS = 60, MOST_HALVINGS = 20 };
/* from here on ln cosh x = |x| - ln 2 and tanh x = 1 within rounding */
static const double SATURATED = 19.0;
static const double LN2 = 0.69314718055994530942;
/* difference over width below which the mean of tanh is a series */
static const double NEAR = 1e-2;
/* least part of a sub-step before or after a jump of the force; without length no equations */
static const double SHORTEST = 1e-6;
/* last change of a velocity over its size */
static const double SAME = 1e-12;
/* that of an iteration which rounding ends above SAME */
static const double ROUNDED = 1e-8;

/* A mean of tanh, and its derivatives by both ends and by the width. */
typedef struct {
    double mean, by_first, by_last, by_width;
} mean_t;

/* Deflection of a bristle at the end of a sub-step, and its derivatives by the deflection and the
 * velocity at the start, by the velocity at the end, by the length and by the bristle travel. */
typedef struct {
    double end, by_start, by_first, by_last, by_h, by_travel;
} bristle_t;

/* A sub-step in the record, by its middle. */
typedef struct {
    size_t k;
    double part;       /* of the step from sample k to the next one */
    double after;      /* part of the change of the force that has happened */
    double h, by_edge; /* length, and its derivative by the edge */
} middle_t;

/* A sub-step: its start, the velocities at its end, and what acts in its middle. */
typedef struct {
    double h, force;
    double s[BODIES], v[BODIES], w[BODIES];
    double y[BODIES]; /* deflections of the bristles at its start */
    double place[BODIES], rate[BODIES];
    mean_t rub[BODIES], centre;
    bristle_t bristle[BODIES];
    double deflection, pull, pull_slope; /* pull: hinge moment at the travel */
    double f[BODIES], J[BODIES][BODIES];
} sub_step_t;

/* Derivatives of the motion by the unknowns. */
typedef struct {
    double s[BODIES][AM_MOST_CIRCUIT_UNKNOWNS], v[BODIES][AM_MOST_CIRCUIT_UNKNOWNS];
    double y[BODIES][AM_MOST_CIRCUIT_UNKNOWNS];
} change_t;

static double hyperbolic_tangent(double x) {
    const double size = fabs(x);
    if (size > SATURATED) return x > 0.0 ? 1.0 : -1.0;
    const double e = am_exp(-2.0 * size);
    return copysign((1.0 - e) / (1.0 + e), x);
}

static double log_cosh(double x) {
    const double size = fabs(x);
    if (size > SATURATED) return size - LN2;
    return size + am_log(1.0 + am_exp(-2.0 * size)) - LN2;
}

static mean_t mean_tangent(double first, double last, double width) {
    mean_t m = {0.0, 0.0, 0.0, 0.0};
    const double a = first / width;
    const double b = last / width;
    const double d = b - a;
    if ((a > SATURATED && b > SATURATED) || (a < -SATURATED && b < -SATURATED)) {
        m.mean = a > 0.0 ? 1.0 : -1.0;
    } else if (fabs(d) < NEAR) {
        const double t = hyperbolic_tangent(0.5 * (a + b));
        const double slope = 1.0 - t * t;
        const double bend = -2.0 * t * slope;
        const double twist = slope * (6.0 * t * t - 2.0);
        m.mean = t + d * d / 24.0 * bend;
        m.by_last = 0.5 * slope + d / 12.0 * bend + d * d / 48.0 * twist;
        m.by_first = 0.5 * slope - d / 12.0 * bend + d * d / 48.0 * twist;
    } else {
        m.mean = (log_cosh(b) - log_cosh(a)) / d;
        m.by_last = (hyperbolic_tangent(b) - m.mean) / d;
        m.by_first = (m.mean - hyperbolic_tangent(a)) / d;
    }
    m.by_width = -(a * m.by_first + b * m.by_last) / width;
    m.by_first /= width;
    m.by_last /= width;
    return m;
}

/* Bend a bristle over a path d one way; by_h is the derivative by d. */
static bristle_t bend_one_way(double y, double d, double travel) {
    bristle_t b = {y, 1.0, 0.0, 0.0, 0.0, 0.0};
    const double sign = d < 0.0 ? -1.0 : 1.0;
    b.by_start = am_exp(-fabs(d) / travel);
    b.end = sign + (y - sign) * b.by_start;
    b.by_h = (1.0 - sign * y) * b.by_start / travel;
    b.by_travel = -d / travel * b.by_h;
    return b;
}

static bristle_t bend_bristle(double y, double v, double w, double h, double travel) {
    if (v * w >= 0.0) {
        bristle_t b = bend_one_way(y, 0.5 * h * (v + w), travel);
        b.by_first = b.by_last = 0.5 * h * b.by_h;
        b.by_h *= 0.5 * (v + w);
        return b;
    }
    /* one way to the reversal, then back */
    const double D = v - w;
    const bristle_t to = bend_one_way(y, 0.5 * h * v * v / D, travel);
    const bristle_t back = bend_one_way(to.end, -0.5 * h * w * w / D, travel);
    const double scale = 0.5 * h / (D * D);
    bristle_t b = {.end = back.end, .by_start = back.by_start * to.by_start};
    b.by_first = scale * (back.by_start * to.by_h * v * (v - 2.0 * w) + back.by_h * w * w);
    b.by_last = scale * (back.by_start * to.by_h * v * v - back.by_h * w * (2.0 * v - w));
    b.by_h = 0.5 * (back.by_start * to.by_h * v * v - back.by_h * w * w) / D;
    b.by_travel = back.by_start * to.by_travel + back.by_travel;
    return b;
}

/* Friction over its size in a sub-step from v to w: mean, and its derivatives. */
static mean_t mean_friction(const am_circuit *c, sub_step_t *p, int i) {
    const double *q = c->constants;
    if (!c->bristles) return mean_tangent(p->v[i], p->w[i], q[AM_RATE_WIDTH]);
    bristle_t *b = p->bristle + i;
    *b = bend_bristle(p->y[i], p->v[i], p->w[i], p->h, q[AM_BRISTLE_TRAVEL]);
    const double mean = 0.5 * (p->y[i] + b->end);
    return (mean_t){mean, 0.5 * b->by_first, 0.5 * b->by_last, 0.5 * b->by_travel};
}

static double between(const double *x, size_t stride, const middle_t *at) {
    const double first = x[at->k * stride];
    return first + at->part * (x[(at->k + 1) * stride] - first);
}

/* Hinge moment at the travel, and its slope, in the middle of the sub-step. */
static void pull_surface(const am_circuit *c, const middle_t *at, sub_step_t *p) {
    const double *q = c->constants;
    const size_t powers = (size_t)c->powers;
    p->deflection = q[AM_RIGGING] + c->gearing * p->place[c->bodies - 1];
    double H = 0.0;
    double slope = 0.0;
    for (size_t j = powers; j-- > 0;) {
        slope = slope * p->deflection + H;
        H = H * p->deflection + between(c->moment + j, powers, at);
    }
    p->pull = c->gearing * H;
    p->pull_slope = c->gearing * c->gearing * slope;
}

/* Equations of motion for the velocities w, and their derivatives by w. */
static void form_equations(const am_circuit *c, const middle_t *at, sub_step_t *p) {
    const double *q = c->constants;
    const double *body[BODIES] = {q + AM_MASS, q + AM_AFT_MASS};
    const double h = p->h;
    const int last = c->bodies - 1;
    for (int i = 0; i < c->bodies; i++) {
        const double mass = body[i][0];
        const double damping = body[i][1];
        const double friction = body[i][2];
        p->rate[i] = 0.5 * (p->v[i] + p->w[i]);
        p->place[i] = p->s[i] + 0.5 * h * p->rate[i];
        p->rub[i] = mean_friction(c, p, i);
        p->f[i] = mass * (p->w[i] - p->v[i]) / h + damping * p->rate[i] + friction * p->rub[i].mean;
        p->J[i][i] = mass / h + 0.5 * damping + friction * p->rub[i].by_last;
    }
    p->centre = mean_tangent(p->s[0], p->s[0] + h * p->rate[0], q[AM_PLACE_WIDTH]);
    p->f[0] += q[AM_PRELOAD] * p->centre.mean + q[AM_STIFFNESS] * p->place[0] - p->force;
    p->J[0][0] += 0.5 * h * q[AM_PRELOAD] * p->centre.by_last + 0.25 * h * q[AM_STIFFNESS];
    pull_surface(c, at, p);
    p->f[last] -= p->pull;
    p->J[last][last] -= 0.25 * h * p->pull_slope;
    if (last == 0) return;
    const double tension = q[AM_CABLE] * (p->place[0] - p->place[1])
                           + q[AM_CABLE_DAMPING] * (p->rate[0] - p->rate[1]);
    const double binds = 0.25 * h * q[AM_CABLE] + 0.5 * q[AM_CABLE_DAMPING];
    p->f[0] += tension;
    p->f[1] -= tension;
    p->J[0][0] += binds;
    p->J[1][1] += binds;
    p->J[0][1] = p->J[1][0] = -binds;
}

/* x of J x = f */
static void divide(const sub_step_t *p, int bodies, const double f[BODIES], double x[BODIES]) {
    if (bodies == 1) {
        x[0] = f[0] / p->J[0][0];
        return;
    }
    const double det = p->J[0][0] * p->J[1][1] - p->J[0][1] * p->J[1][0];
    x[0] = (p->J[1][1] * f[0] - p->J[0][1] * f[1]) / det;
    x[1] = (p->J[0][0] * f[1] - p->J[1][0] * f[0]) / det;
}

static double misfit(const sub_step_t *p, int bodies) {
    double sum = 0.0;
    for (int i = 0; i < bodies; i++) sum += p->f[i] * p->f[i];
    return sum;
}

/* Newton's iteration; a step that raises the misfit is halved, because tanh is steep.  It returns
 * whether the iteration has converged; if not, w is not a solution. */
static bool solve_sub_step(const am_circuit *c, const middle_t *at, sub_step_t *p) {
    double x[BODIES], from[BODIES];
    memcpy(p->w, p->v, sizeof p->w);
    form_equations(c, at, p);
    /* a velocity that counts as none */
    const double *q = c->constants;
    const double least = c->bristles ? q[AM_BRISTLE_TRAVEL] / p->h : q[AM_RATE_WIDTH];
    bool near = false;
    for (int round = 0; round < MOST_ROUNDS; round++) {
        const double before = misfit(p, c->bodies);
        divide(p, c->bodies, p->f, x);
        memcpy(from, p->w, sizeof from);
        bool small = true;
        near = true;
        for (int i = 0; i < c->bodies; i++) {
            const double size = fabs(from[i]) + least;
            small = small && fabs(x[i]) <= SAME * size;
            near = near && fabs(x[i]) <= ROUNDED * size;
        }
        double part = 1.0;
        for (int halving = 0; halving < MOST_HALVINGS; halving++, part *= 0.5) {
            for (int i = 0; i < c->bodies; i++) p->w[i] = from[i] - part * x[i];
            form_equations(c, at, p);
            if (small || misfit(p, c->bodies) < before) break;
        }
        if (small) return true;
    }
    return near;
}

/* Derivatives of the equations by unknown j, for the velocities w as they are. */
static void change_equations(const am_circuit *c, const middle_t *at, const sub_step_t *p,
                             const change_t *d, size_t j, double out[BODIES]) {
    const size_t n = (size_t)c->unknowns;
    const double *q = c->constants;
    const double *by = c->by_constants + j;
    const double *body[BODIES] = {q + AM_MASS, q + AM_AFT_MASS};
    const int last = c->bodies - 1;
    const double width = by[(c->bristles ? AM_BRISTLE_TRAVEL : AM_RATE_WIDTH) * n];
    double place[BODIES], rate[BODIES];
    for (int i = 0; i <= last; i++) {
        const double *own = by + (i ? AM_AFT_MASS : AM_MASS) * n;
        rate[i] = 0.5 * d->v[i][j];
        place[i] = d->s[i][j] + 0.5 * p->h * rate[i];
        out[i] = own[0] * (p->w[i] - p->v[i]) / p->h - body[i][0] * d->v[i][j] / p->h;
        out[i] += own[n] * p->rate[i] + body[i][1] * rate[i] + own[2 * n] * p->rub[i].mean;
        out[i] += body[i][2]
                  * (p->rub[i].by_first * d->v[i][j] + p->rub[i].by_width * width);
        if (c->bristles) out[i] += body[i][2] * 0.5 * (1.0 + p->bristle[i].by_start) * d->y[i][j];
    }
    const double to = d->s[0][j] + p->h * rate[0];
    out[0] += by[AM_PRELOAD * n] * p->centre.mean
              + q[AM_PRELOAD]
                    * (p->centre.by_first * d->s[0][j] + p->centre.by_last * to
                       + p->centre.by_width * by[AM_PLACE_WIDTH * n]);
    out[0] += by[AM_STIFFNESS * n] * p->place[0] + q[AM_STIFFNESS] * place[0];
    const double *force = c->by_force + at->k * n + j;
    out[0] -= force[0] + at->after * (force[n] - force[0]);
    const size_t powers = (size_t)c->powers;
    double H = 0.0;
    for (size_t m = powers; m-- > 0;) {
        H = H * p->deflection + between(c->by_moment + m * n + j, powers * n, at);
    }
    out[last] -= c->gearing * H + p->pull_slope * (by[AM_RIGGING * n] / c->gearing + place[last]);
    if (last == 0) return;
    const double tension = by[AM_CABLE * n] * (p->place[0] - p->place[1])
                           + by[AM_CABLE_DAMPING * n] * (p->rate[0] - p->rate[1])
                           + q[AM_CABLE] * (place[0] - place[1])
                           + q[AM_CABLE_DAMPING] * (rate[0] - rate[1]);
    out[0] += tension;
    out[1] -= tension;
}

/* Derivatives of the equations by the length of the sub-step. */
static void by_length(const am_circuit *c, const sub_step_t *p, double out[BODIES]) {
    const double *q = c->constants;
    const double mass[BODIES] = {q[AM_MASS], q[AM_AFT_MASS]};
    const double friction[BODIES] = {q[AM_FRICTION], q[AM_AFT_FRICTION]};
    const int last = c->bodies - 1;
    for (int i = 0; i <= last; i++) {
        out[i] = -mass[i] * (p->w[i] - p->v[i]) / (p->h * p->h);
        if (c->bristles) out[i] += 0.5 * friction[i] * p->bristle[i].by_h;
    }
    out[0] += (q[AM_PRELOAD] * p->centre.by_last + 0.5 * q[AM_STIFFNESS]) * p->rate[0];
    out[last] -= 0.5 * p->pull_slope * p->rate[last];
    if (last == 0) return;
    const double tension = 0.5 * q[AM_CABLE] * (p->rate[0] - p->rate[1]);
    out[0] += tension;
    out[1] -= tension;
}

static void advance_changes(const am_circuit *c, const middle_t *at, const sub_step_t *p,
                            change_t *d) {
    const size_t n = (size_t)c->unknowns;
    const double *by_travel = c->by_constants + AM_BRISTLE_TRAVEL * n;
    double f[BODIES], x[BODIES], longer[BODIES];
    if (at->by_edge != 0.0) by_length(c, p, longer);
    for (size_t j = 0; j < n; j++) {
        double length = 0.0;
        change_equations(c, at, p, d, j, f);
        if (at->by_edge != 0.0) {
            length = at->by_edge * c->by_edge[at->k * n + j];
            for (int i = 0; i < c->bodies; i++) f[i] += longer[i] * length;
        }
        divide(p, c->bodies, f, x);
        for (int i = 0; i < c->bodies; i++) {
            const bristle_t *b = p->bristle + i;
            if (c->bristles)
                d->y[i][j] = b->by_start * d->y[i][j] + b->by_first * d->v[i][j] - b->by_last * x[i]
                             + b->by_h * length + b->by_travel * by_travel[j];
            d->s[i][j] += 0.5 * p->h * (d->v[i][j] - x[i]) + p->rate[i] * length;
            d->v[i][j] = -x[i];
        }
    }
}

/* The pieces of sub-step i: two if the force jumps in it, with the force before and after. */
static int divide_sub_step(const am_circuit *c, size_t k, int i, middle_t piece[2]) {
    const double per_part = 1.0 / c->parts;
    const double whole = c->step * per_part;
    const middle_t at = {k, (i + 0.5) * per_part, (i + 0.5) * per_part, whole, 0.0};
    piece[0] = piece[1] = at;
    if (isnan(c->edge[k])) return 1;
    /* part of the sub-step before the jump, which may happen at its ends */
    const double before = (1.0 - c->edge[k]) * c->parts - i;
    const bool here = (before > 0.0 && before <= 1.0) || (i == 0 && before <= 0.0);
    piece[0].after = before > 0.0 ? 0.0 : 1.0;
    if (!here) return 1;
    piece[1].after = 1.0;
    piece[0].after = 0.0;
    piece[0].h = whole * fmax(before, SHORTEST);
    piece[1].h = whole * fmax(1.0 - before, SHORTEST);
    piece[0].by_edge = -c->step;
    piece[1].by_edge = c->step;
    return 2;
}

static bool take_sub_step(const am_circuit *c, const middle_t *at, sub_step_t *p, change_t *d) {
    p->h = at->h;
    p->force = c->force[at->k] + at->after * (c->force[at->k + 1] - c->force[at->k]);
    if (!solve_sub_step(c, at, p)) return false;
    if (d) advance_changes(c, at, p, d);
    for (int b = 0; b < c->bodies; b++) {
        p->s[b] += p->h * p->rate[b];
        p->v[b] = p->w[b];
        p->y[b] = p->bristle[b].end;
    }
    return true;
}

static void record_sample(const am_circuit *c, const sub_step_t *p, const change_t *d, double *y,
                          double *Y) {
    const size_t n = (size_t)c->unknowns;
    for (int i = 0; i < BODIES; i++) {
        const int body = i < c->bodies ? i : 0;
        y[i] = p->s[body];
        if (Y) memcpy(Y + (size_t)i * n, d->s[body], n * sizeof *Y);
    }
}

static bool is_sound_circuit(const am_circuit *c, size_t samples) {
    const int width = c->bristles ? AM_BRISTLE_TRAVEL : AM_RATE_WIDTH;
    return (c->bodies == 1 || c->bodies == BODIES) && c->powers > 0 && c->parts > 0 && samples > 0
           && c->unknowns >= 0 && c->unknowns <= AM_MOST_CIRCUIT_UNKNOWNS && c->gearing != 0.0
           && c->constants[width] > 0.0 && c->constants[AM_PLACE_WIDTH] > 0.0;
}

int am_follow_circuit(const am_circuit *c, size_t samples, double *y, double *Y) {
    if (!is_sound_circuit(c, samples)) return AM_BAD_ARGUMENT;
    const size_t n = (size_t)c->unknowns;
    sub_step_t p = {.h = 0.0};
    change_t d;
    memset(&d, 0, sizeof d);
    for (int i = 0; i < c->bodies; i++) {
        p.s[i] = c->start[i];
        p.y[i] = c->bend[i];
        memcpy(d.s[i], c->by_start + (size_t)i * n, n * sizeof *d.s[i]);
        memcpy(d.y[i], c->by_bend + (size_t)i * n, n * sizeof *d.y[i]);
    }
    for (size_t k = 0;; k++, y += BODIES) {
        record_sample(c, &p, &d, y, Y);
        if (Y) Y += BODIES * n;
        if (k + 1 == samples) return isfinite(y[0]) ? AM_OK : AM_NOT_FINITE;
        for (int i = 0; i < c->parts; i++) {
            middle_t piece[2];
            const int pieces = divide_sub_step(c, k, i, piece);
            for (int m = 0; m < pieces; m++) {
                if (take_sub_step(c, piece + m, &p, Y ? &d : NULL)) continue;
                return isfinite(misfit(&p, c->bodies)) ? AM_NOT_SOLVED : AM_NOT_FINITE;
            }
        }
    }
}
