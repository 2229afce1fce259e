/* An interval of the motion of a circuit and its solution, of one run or of lanes: see
 * linkage.c. */
#ifndef AEROMATCH_LINKAGE_INTERVAL_H
#define AEROMATCH_LINKAGE_INTERVAL_H

#include "algebra.h"
#include "linkage_bodies.h"

#define MOST_ROUNDS 100 /* of the velocity of body 0 */

/* An interval of motion and its solution. */
typedef struct {
    double h;
    real cable; /* what binds the velocities of body 0 and another */
    real a[LINKAGE_BODIES], b[LINKAGE_BODIES], threshold[LINKAGE_BODIES];
    /* mean velocities that end at a stop, at neutral */
    real low[LINKAGE_BODIES], high[LINKAGE_BODIES], to_neutral;
    real w[LINKAGE_BODIES];
    real friction[LINKAGE_BODIES], stop[LINKAGE_BODIES], preload;
} interval_t;

static inline real signed_force(real size, real direction) {
    return PICK(direction > 0.0, size, -size);
}

static void set_up_interval(const linkage_t *c, const motion_t *m, double t, double h,
                            interval_t *p) {
    p->h = h;
    p->cable = c->cable_damping + 0.5 * h * c->cable_stiffness;
    for (int i = 0; i < c->bodies; i++) {
        const real k = c->stiffness[i];
        const mask_t holds = k > 0.0;
        /* an unstable spring would spoil the definite matrix: it acts at the place where the
         * present velocity leads */
        const real place = PICK(holds, m->q[i], m->q[i] + 0.5 * h * m->v[i]);
        p->a[i] = 2.0 * c->mass[i] / h + c->damping[i] + PICK(holds, 0.5 * h * k, 0.0);
        p->b[i] = 2.0 * c->mass[i] * m->v[i] / h + c->load[i] + c->load_rate[i] * (t + 0.5 * h)
                  - k * (place - c->origin[i]);
        p->low[i] = (c->low[i] - m->q[i]) / h;
        p->high[i] = (c->high[i] - m->q[i]) / h;
        p->threshold[i] = PICK(m->v[i] == 0.0, c->breakout[i], c->friction[i]);
        if (i == 0) continue;
        const real tension = c->cable_stiffness * (m->q[i] - m->q[0]);
        p->a[0] += p->cable;
        p->a[i] += p->cable;
        p->b[0] += tension;
        p->b[i] -= tension;
    }
    p->to_neutral = (c->neutral - m->q[0]) / h;
}

/* Solution w of a w + friction Sgn(w) + preload Sgn(w - neutral) = b, between the stops of body
 * 0. */
static inline real balance(const interval_t *p, real a, real b, real preload) {
    const mask_t first = p->to_neutral < 0.0;
    const real p1 = PICK(first, p->to_neutral, 0.0);
    const real p2 = PICK(first, 0.0, p->to_neutral);
    const real j1 = PICK(first, preload, p->threshold[0]);
    const real j2 = PICK(first, p->threshold[0], preload);
    /* divided where it is of use: one run takes one of these ways */
    const real w = PICK((b + j1 + j2) / a < p1, (b + j1 + j2) / a,
                        PICK((b - j1 + j2) / a <= p1, p1,
                             PICK((b - j1 + j2) / a < p2, (b - j1 + j2) / a,
                                  PICK((b - j1 - j2) / a <= p2, p2, (b - j1 - j2) / a))));
    return clamp(w, p->low[0], p->high[0]);
}

/* Velocity of body i > 0, with friction alone, when body 0 has w0; *slope states how it follows. */
static inline real follow_body(const interval_t *p, int i, real w0, real *slope) {
    const real pull = p->b[i] + p->cable * w0;
    const real R = p->threshold[i];
    const real w = clamp(PICK((pull + R) / p->a[i] < 0.0, (pull + R) / p->a[i],
                              PICK((pull - R) / p->a[i] <= 0.0, 0.0, (pull - R) / p->a[i])),
                         p->low[i], p->high[i]);
    const mask_t free = (w > p->low[i]) & (w < p->high[i])
                        & ((w != 0.0) | (p->threshold[i] == 0.0));
    *slope = PICK(free, p->cable / p->a[i], 0.0);
    return w;
}

/* Newton on a monotone, piecewise linear equation for w of body 0; the bracket excludes cycles. */
static real cockpit_velocity(const linkage_t *c, const interval_t *p, real guess) {
    real w0 = clamp(guess, p->low[0], p->high[0]);
    real below = -HUGE_VAL;
    real above = HUGE_VAL;
    mask_t open = everywhere(true);
    for (int round = 0; round < MOST_ROUNDS && ANY(open); round++) {
        real a = p->a[0];
        real b = p->b[0];
        real slope;
        for (int i = 1; i < c->bodies; i++) {
            const real w = follow_body(p, i, w0, &slope);
            a -= p->cable * slope;
            b += p->cable * (w - slope * w0);
        }
        real next = balance(p, a, b, c->preload);
        const mask_t moves = NOT(size_of(next - w0) <= 1e-15 * size_of(w0)) & open;
        const mask_t up = next > w0;
        below = PICK(moves & up, w0, below);
        above = PICK(moves & NOT(up), w0, above);
        const mask_t outside = moves & ((next <= below) | (next >= above));
        next = PICK(outside, 0.5 * (below + above), next);
        w0 = PICK(open, next, w0);
        open = moves;
    }
    return w0;
}

/* What friction, preload and stop have in the reaction on a body; where several could hold it,
 * preload first and stop last. */
static inline void split_reaction(const linkage_t *c, interval_t *p, int i, real reaction) {
    const real w = p->w[i];
    const real R = p->threshold[i];
    const real P = i ? (real)0.0 : c->preload;
    const real slides = PICK(w == 0.0, 0.0, signed_force(R, w));
    const real preload = PICK(w == p->to_neutral, clamp(reaction - slides, -P, P),
                              signed_force(P, w - p->to_neutral));
    p->friction[i] = PICK(w == 0.0, clamp(reaction - preload, -R, R), slides);
    p->stop[i] = PICK((w == p->low[i]) | (w == p->high[i]), reaction - preload - p->friction[i],
                      0.0);
    if (i == 0) p->preload = preload;
}

static void solve_velocities(const linkage_t *c, const motion_t *m, interval_t *p) {
    real slope;
    for (bool again = true; again;) {
        p->w[0] = c->driven ? c->drive : cockpit_velocity(c, p, m->v[0]);
        for (int i = 1; i < c->bodies; i++) p->w[i] = follow_body(p, i, p->w[0], &slope);
        again = false;
        for (int i = 0; i < c->bodies; i++) {
            /* broken out of stiction: solve once more with sliding friction */
            const mask_t breaks = (p->w[i] != 0.0) & (p->threshold[i] > c->friction[i]);
            p->threshold[i] = PICK(breaks, c->friction[i], p->threshold[i]);
            again = again || ANY(breaks);
        }
    }
}

static void solve_interval(const linkage_t *c, const motion_t *m, double t, double h,
                           interval_t *p) {
    set_up_interval(c, m, t, h, p);
    solve_velocities(c, m, p);
    real reaction = p->b[0] - p->a[0] * p->w[0];
    for (int i = 1; i < c->bodies; i++) {
        reaction += p->cable * p->w[i];
        split_reaction(c, p, i, p->b[i] + p->cable * p->w[0] - p->a[i] * p->w[i]);
    }
    split_reaction(c, p, 0, reaction);
}

#endif
