/* The moving parts of a circuit in lanes: linkage.c over `real`, for the parts of a step that hold
 * no event.  Each lane does what linkage.c does for one run, in the same order.  A lane in which a
 * body reverses, passes neutral or meets a stop takes that part of the step by itself; the energy
 * that is lost is not counted: no run records it. */
#ifndef AEROMATCH_LANED_LINKAGE_H
#define AEROMATCH_LANED_LINKAGE_H

#include "algebra.h"
#include "control_drive.h"
#include "laned.h"

#define MOST_ROUNDS 100 /* of the velocity of body 0, as in linkage.c */

typedef struct {
    double h;
    real cable;
    real a[LINKAGE_BODIES], b[LINKAGE_BODIES], threshold[LINKAGE_BODIES];
    real low[LINKAGE_BODIES], high[LINKAGE_BODIES], to_neutral;
    real w[LINKAGE_BODIES];
    real friction[LINKAGE_BODIES], stop[LINKAGE_BODIES], preload;
} laned_piece_t;

static inline real signed_force(real size, real direction) {
    return PICK(direction > 0.0, size, -size);
}

static void set_up_piece(const linkage_t *c, const motion_t *m, double t, double h,
                         laned_piece_t *p) {
    p->h = h;
    p->cable = c->cable_damping + 0.5 * h * c->cable_stiffness;
    for (int i = 0; i < c->bodies; i++) {
        const real k = c->stiffness[i];
        const mask_t holds = k > 0.0;
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

static inline real balance(const laned_piece_t *p, real a, real b, real preload) {
    const mask_t first = p->to_neutral < 0.0;
    const real p1 = PICK(first, p->to_neutral, 0.0);
    const real p2 = PICK(first, 0.0, p->to_neutral);
    const real j1 = PICK(first, preload, p->threshold[0]);
    const real j2 = PICK(first, p->threshold[0], preload);
    const real under = (b + j1 + j2) / a;
    const real between = (b - j1 + j2) / a;
    const real over = (b - j1 - j2) / a;
    const real at_p2 = PICK(over <= p2, p2, over);
    const real above_p1 = PICK(between < p2, between, at_p2);
    const real w = PICK(under < p1, under, PICK(between <= p1, p1, above_p1));
    return clamp(w, p->low[0], p->high[0]);
}

/* A body with friction alone: both kinks of the balance are at rest. */
static inline real follow(const laned_piece_t *p, int i, real w0, real *slope) {
    const real pull = p->b[i] + p->cable * w0;
    const real under = (pull + p->threshold[i]) / p->a[i];
    const real over = (pull - p->threshold[i]) / p->a[i];
    const real sliding = PICK(over <= 0.0, (real)0.0, over);
    const real w = clamp(PICK(under < 0.0, under, sliding), p->low[i], p->high[i]);
    const mask_t free = (w > p->low[i]) & (w < p->high[i])
                        & ((w != 0.0) | (p->threshold[i] == 0.0));
    *slope = PICK(free, p->cable / p->a[i], 0.0);
    return w;
}

static real cockpit_velocity(const linkage_t *c, const laned_piece_t *p, real guess) {
    real w0 = clamp(guess, p->low[0], p->high[0]);
    real below = -HUGE_VAL;
    real above = HUGE_VAL;
    mask_t open = everywhere(true);
    for (int round = 0; round < MOST_ROUNDS && ANY(open); round++) {
        real a = p->a[0];
        real b = p->b[0];
        real slope;
        for (int i = 1; i < c->bodies; i++) {
            const real w = follow(p, i, w0, &slope);
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

static inline void split_reaction(const linkage_t *c, laned_piece_t *p, int i, real reaction) {
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

static void solve_velocities(const linkage_t *c, const motion_t *m, laned_piece_t *p) {
    real slope;
    for (bool again = true; again;) {
        p->w[0] = c->driven ? c->drive : cockpit_velocity(c, p, m->v[0]);
        for (int i = 1; i < c->bodies; i++) p->w[i] = follow(p, i, p->w[0], &slope);
        again = false;
        for (int i = 0; i < c->bodies; i++) {
            const mask_t breaks = (p->w[i] != 0.0) & (p->threshold[i] > c->friction[i]);
            p->threshold[i] = PICK(breaks, c->friction[i], p->threshold[i]);
            again = again || ANY(breaks);
        }
    }
}

static void solve_piece(const linkage_t *c, const motion_t *m, double t, double h,
                        laned_piece_t *p) {
    set_up_piece(c, m, t, h, p);
    solve_velocities(c, m, p);
    real reaction = p->b[0] - p->a[0] * p->w[0];
    for (int i = 1; i < c->bodies; i++) {
        reaction += p->cable * p->w[i];
        split_reaction(c, p, i, p->b[i] + p->cable * p->w[0] - p->a[i] * p->w[i]);
    }
    split_reaction(c, p, 0, reaction);
}

static inline mask_t turns(real start, real end) {
    return ((start > 0.0) & (end < 0.0)) | ((start < 0.0) & (end > 0.0));
}

/* Lanes with an event of a body in the piece, as event_of and happens. */
static mask_t events_of(const linkage_t *c, const motion_t *m, const laned_piece_t *p, int i) {
    const real v = m->v[i];
    const real q = m->q[i];
    const real w = p->w[i];
    const real to = q + p->h * w;
    const real drift = p->h / p->a[i];
    const mask_t may_turn = (c->breakout[i] > 0.0) & (w > p->low[i]) & (w < p->high[i]);
    const real back = 2.0 * w - v
                      - 2.0 / p->a[i] * (signed_force(c->friction[i], v) - p->friction[i]);
    const real under_high = larger(c->high[i] - q, (real)0.0);
    const real over_low = larger(q - c->low[i], (real)0.0);
    mask_t found = turns(PICK(may_turn, v, 0.0), back);
    found |= turns(under_high, c->high[i] - to - drift * larger(p->stop[i], (real)0.0));
    found |= turns(over_low, to - c->low[i] - drift * larger(-p->stop[i], (real)0.0));
    if (i) return found;
    const real start = PICK(c->preload > 0.0, q - c->neutral, 0.0);
    const real push = signed_force(c->preload, start) - p->preload;
    return found | turns(start, to - c->neutral - drift * push);
}

static mask_t events(const linkage_t *c, const motion_t *m, const laned_piece_t *p) {
    mask_t found = everywhere(false);
    for (int i = c->driven ? 1 : 0; i < c->bodies; i++) found |= events_of(c, m, p, i);
    return found;
}

static void hold_back(const linkage_t *c, motion_t *m, const laned_piece_t *p, int i) {
    const real w = p->w[i];
    const real v = m->v[i];
    mask_t held = p->threshold[i] > 0.0;
    if (i == 0) held |= (c->preload > 0.0) & (p->to_neutral == 0.0);
    const real up = -c->restitution * larger(v, (real)0.0);
    const real down = -c->restitution * smaller(v, (real)0.0);
    const real inside = PICK((w == 0.0) & held, 0.0, v);
    m->v[i] = PICK(w == p->high[i], up, PICK(w == p->low[i], down, inside));
}

static void accept_piece(const linkage_t *c, motion_t *m, const laned_piece_t *p) {
    for (int i = 0; i < c->bodies; i++) {
        const real w = p->w[i];
        const real inside = m->q[i] + p->h * w;
        m->friction[i] = p->friction[i];
        m->stop[i] = p->stop[i];
        m->q[i] = PICK(w == p->high[i], c->high[i], PICK(w == p->low[i], c->low[i], inside));
        m->v[i] = 2.0 * w - m->v[i];
        if (i > 0 || !c->driven) {
            m->q[i] = clamp(m->q[i], c->low[i], c->high[i]);
            hold_back(c, m, p, i);
        }
    }
    if (c->driven) m->v[0] = c->drive;
    else m->q[0] = PICK((p->w[0] == p->to_neutral) & (c->preload > 0.0), c->neutral, m->q[0]);
}

static void advance_alone(const linkage_t *c, const motion_t *before, motion_t *after, int lane,
                          double t, double h) {
    one_linkage_t one = {.bodies = c->bodies, .driven = c->driven};
    one_motion_t motion;
    const size_t n = sizeof motion / sizeof(double);
    give((const real *)c, offsetof(one_linkage_t, bodies) / sizeof(double), lane, (double *)&one);
    give((const real *)before, n, lane, (double *)&motion);
    linkage_part(&one, &motion, t, h);
    take((const double *)&motion, n, lane, (real *)after);
}

static void linkage_part_in_lanes(const linkage_t *c, motion_t *m, double t, double h) {
    laned_piece_t p;
    motion_t after = *m;
    solve_piece(c, m, t, h, &p);
    const mask_t apart = events(c, m, &p);
    accept_piece(c, &after, &p);
    for (int l = 0; l < LANES && ANY(apart); l++) {
        if (apart[l]) advance_alone(c, m, &after, l, t, h);
    }
    *m = after;
}

/* A circuit through a step; lanes with parts of another length take them one by one. */
static void move_bodies(const flight_t *f, uint32_t item, double h, const linkage_t *c,
                        motion_t *m) {
    const real longest = par_of(f, G_CIRCUIT, item)[P_CIRCUIT_STEP];
    const int parts = sub_steps(h, longest[0]);
    if (EVERY(longest == longest[0])) {
        for (int k = 0; k < parts; k++) linkage_part_in_lanes(c, m, h * k / parts, h / parts);
        return;
    }
    const motion_t before = *m;
    for (int l = 0; l < LANES; l++) {
        const int own = sub_steps(h, longest[l]);
        const motion_t *from = &before;
        for (int k = 0; k < own; k++, from = m) advance_alone(c, from, m, l, h * k / own, h / own);
    }
}

#endif
