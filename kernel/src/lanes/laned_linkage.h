/* The moving parts of a circuit in lanes, for the parts of a step that hold no event.  Each lane
 * does what linkage.c does for one run, in the same order.  A lane in which a body reverses, passes
 * neutral or meets a stop takes that part of the step by itself; the energy that is lost is not
 * counted: no run records it. */
#ifndef AEROMATCH_LANED_LINKAGE_H
#define AEROMATCH_LANED_LINKAGE_H

#include "control_drive.h"
#include "laned.h"
#include "linkage_interval.h"

static inline mask_t turns(real start, real end) {
    return ((start > 0.0) & (end < 0.0)) | ((start < 0.0) & (end > 0.0));
}

/* Lanes with an event of a body in the interval, as event_of and happens. */
static mask_t events_of(const linkage_t *c, const motion_t *m, const interval_t *p, int i) {
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

static mask_t lanes_with_event(const linkage_t *c, const motion_t *m, const interval_t *p) {
    mask_t found = everywhere(false);
    for (int i = c->driven ? 1 : 0; i < c->bodies; i++) found |= events_of(c, m, p, i);
    return found;
}

static void laned_hold_back(const linkage_t *c, motion_t *m, const interval_t *p, int i) {
    const real w = p->w[i];
    const real v = m->v[i];
    mask_t held = p->threshold[i] > 0.0;
    if (i == 0) held |= (c->preload > 0.0) & (p->to_neutral == 0.0);
    const real up = -c->restitution * larger(v, (real)0.0);
    const real down = -c->restitution * smaller(v, (real)0.0);
    const real inside = PICK((w == 0.0) & held, 0.0, v);
    m->v[i] = PICK(w == p->high[i], up, PICK(w == p->low[i], down, inside));
}

static void laned_accept(const linkage_t *c, motion_t *m, const interval_t *p) {
    for (int i = 0; i < c->bodies; i++) {
        const real w = p->w[i];
        const real inside = m->q[i] + p->h * w;
        m->friction[i] = p->friction[i];
        m->stop[i] = p->stop[i];
        m->q[i] = PICK(w == p->high[i], c->high[i], PICK(w == p->low[i], c->low[i], inside));
        m->v[i] = 2.0 * w - m->v[i];
        if (i > 0 || !c->driven) {
            m->q[i] = clamp(m->q[i], c->low[i], c->high[i]);
            laned_hold_back(c, m, p, i);
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
    copy_from_lane((const real *)c, offsetof(one_linkage_t, bodies) / sizeof(double), lane,
                   (double *)&one);
    copy_from_lane((const real *)before, n, lane, (double *)&motion);
    linkage_part(&one, &motion, t, h);
    copy_to_lane((const double *)&motion, n, lane, (real *)after);
}

static void linkage_part_in_lanes(const linkage_t *c, motion_t *m, double t, double h) {
    interval_t p;
    motion_t after = *m;
    solve_interval(c, m, t, h, &p);
    const mask_t apart = lanes_with_event(c, m, &p);
    laned_accept(c, &after, &p);
    for (int l = 0; l < LANES && ANY(apart); l++) {
        if (apart[l]) advance_alone(c, m, &after, l, t, h);
    }
    *m = after;
}

/* A circuit through a step; lanes with parts of another length go through them one by one. */
static void laned_move_bodies(const flight_t *f, uint32_t item, double h, const linkage_t *c,
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
