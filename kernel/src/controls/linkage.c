/* Time stepping of bodies with dry friction and unilateral stops, set-valued, on the level of
 * velocities.
 *
 * Over a interval of length h the mean velocity w = (v + v+) / 2 solves the midpoint rule with the
 * friction law at w:
 *
 *     M (v+ - v) / h = f - K (q + h w / 2) - W w - r
 *     r in friction Sgn(w) + preload Sgn(q + h w - neutral) + normal cone of the stops
 *     q+ = q + h w
 *
 * The matrix is positive definite and the graphs of r are monotone, so there is one solution,
 * and it is found exactly.  With v+ = 2 w - v the energy of masses and springs changes by the
 * work of f minus h (W w + r) w: friction and dampers only remove it. A body that sticks (w = 0)
 * comes out with v+ = 0, a body that meets a stop with v+ = -restitution times its speed; both
 * only remove kinetic energy, since M is diagonal.  A body at rest whose friction suffices has q+
 * = q and v+ = 0 to the last bit.
 *
 * Reversals, passages through neutral and impacts are located and end the interval (switching
 * points of Studer, Leine and Glocker, Int. J. Numer. Meth. Engng 76, 2008), which keeps the
 * second order of the midpoint rule.  When a sub-step holds more than MAX_EVENTS of them its
 * rest is done in one interval, less accurate but no less dissipative.  Scheme without switching
 * points: Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008. */
#include "linkage.h"

#include "linkage_interval.h"

#include <math.h>

#define MAX_EVENTS 16
#define SHORTEST 1e-13 /* part of an interval within which an event happens at once */

typedef enum { NOTHING, REVERSAL, HIGH_STOP, LOW_STOP, NEUTRAL } kind_t;
typedef struct {
    kind_t kind;
    int body;
    /* value at the start and at the end of the interval; zero is where it happens */
    double start, end;
} event_t;

/* A value whose change of sign is an event in the interval.  Friction,
 * preload and stop are those before the event, so that the value is smooth in h. */
static event_t event_of(const linkage_t *c, const motion_t *m, const interval_t *p, kind_t kind,
                        int i) {
    const double v = m->v[i];
    const double q = m->q[i];
    const double to = q + p->h * p->w[i];
    const double drift = p->h / p->a[i];
    event_t e = {kind, i, 0.0, 0.0};
    if (kind == REVERSAL) {
        e.start = c->breakout[i] > 0.0 && p->w[i] > p->low[i] && p->w[i] < p->high[i] ? v : 0.0;
        e.end = 2.0 * p->w[i] - v
                - 2.0 / p->a[i] * (signed_force(c->friction[i], v) - p->friction[i]);
    } else if (kind == NEUTRAL) {
        e.start = c->preload > 0.0 ? q - c->neutral : 0.0;
        e.end = to - c->neutral - drift * (signed_force(c->preload, e.start) - p->preload);
    } else {
        const double gap = kind == HIGH_STOP ? c->high[i] - to : to - c->low[i];
        e.start = fmax(kind == HIGH_STOP ? c->high[i] - q : q - c->low[i], 0.0);
        e.end = gap - drift * fmax(kind == HIGH_STOP ? p->stop[i] : -p->stop[i], 0.0);
    }
    return e;
}

static bool happens(const event_t *e) {
    return (e->start > 0.0 && e->end < 0.0) || (e->start < 0.0 && e->end > 0.0);
}

static double part_of(const event_t *e) { return e->start / (e->start - e->end); }

static event_t first_event(const linkage_t *c, const motion_t *m, const interval_t *p) {
    event_t first = {NOTHING, 0, 0.0, 0.0};
    for (int i = c->driven ? 1 : 0; i < c->bodies; i++) {
        for (kind_t kind = REVERSAL; kind <= (i == 0 ? NEUTRAL : LOW_STOP); kind++) {
            const event_t e = event_of(c, m, p, kind, i);
            if (happens(&e) && (first.kind == NOTHING || part_of(&e) < part_of(&first))) first = e;
        }
    }
    return first;
}

/* Shorten the interval so that it ends with the event: regula falsi with halved weights.  False
 * when the search fails. */
static bool end_at(const linkage_t *c, const motion_t *m, double t, const event_t *first,
                   interval_t *p) {
    const double least = SHORTEST * p->h;
    double h0 = 0.0;
    double h1 = p->h;
    double e0 = first->start;
    double e1 = first->end;
    for (int iteration = 0, side = 0; iteration < 40; iteration++) {
        const double h = fmax(h0 + (h1 - h0) * (e0 / (e0 - e1)), least);
        solve_interval(c, m, t, h, p);
        const event_t e = event_of(c, m, p, first->kind, first->body);
        if (fabs(e.end) <= 1e-12 * fabs(first->start)
            || (h == least && (e.end > 0.0) != (e0 > 0.0))) {
            return true;
        }
        if ((e.end > 0.0) == (e0 > 0.0)) {
            h0 = h;
            e0 = e.end;
            if (side == 1) e1 *= 0.5;
            side = 1;
        } else {
            h1 = h;
            e1 = e.end;
            if (side == -1) e0 *= 0.5;
            side = -1;
        }
    }
    return false;
}

static double change_velocity(const linkage_t *c, motion_t *m, int i, double v) {
    const double lost = 0.5 * c->mass[i] * (m->v[i] * m->v[i] - v * v);
    m->v[i] = v;
    return lost;
}

/* Velocity of a body after it sticks or meets a stop. */
static void hold_back(const linkage_t *c, motion_t *m, const interval_t *p, int i) {
    const double w = p->w[i];
    const bool held = p->threshold[i] > 0.0 || (i == 0 && c->preload > 0.0 && p->to_neutral == 0.0);
    if (w == p->high[i])
        m->lost[2] += change_velocity(c, m, i, -c->restitution * fmax(m->v[i], 0.0));
    else if (w == p->low[i])
        m->lost[2] += change_velocity(c, m, i, -c->restitution * fmin(m->v[i], 0.0));
    else if (w == 0.0 && held) m->lost[0] += change_velocity(c, m, i, 0.0);
}

static void accept(const linkage_t *c, motion_t *m, const interval_t *p) {
    const double from = m->q[0] - c->neutral;
    for (int i = 0; i < c->bodies; i++) {
        const double w = p->w[i];
        const double slip = i ? w - p->w[0] : 0.0;
        m->lost[0] += p->h * p->friction[i] * w;
        m->lost[1] += p->h * (c->damping[i] * w * w + c->cable_damping * slip * slip);
        m->lost[2] += p->h * p->stop[i] * w;
        m->friction[i] = p->friction[i];
        m->stop[i] = p->stop[i];
        m->q[i] = w == p->high[i] ? c->high[i] : w == p->low[i] ? c->low[i] : m->q[i] + p->h * w;
        m->v[i] = 2.0 * w - m->v[i];
        if (i > 0 || !c->driven) {
            m->q[i] = clamp(m->q[i], c->low[i], c->high[i]);
            hold_back(c, m, p, i);
        }
    }
    if (c->driven) m->v[0] = c->drive;
    else if (p->w[0] == p->to_neutral && c->preload > 0.0) m->q[0] = c->neutral;
    m->lost[0] += p->h * p->preload * p->w[0]
                  - c->preload * (fabs(m->q[0] - c->neutral) - fabs(from));
}

/* Put what the event is about exactly to where it happens; it is within rounding of it. */
static void apply_event(const linkage_t *c, motion_t *m, const event_t *e) {
    const int i = e->body;
    if (e->kind == REVERSAL) {
        m->lost[0] += change_velocity(c, m, i, 0.0);
    } else if (e->kind == NEUTRAL) {
        m->q[i] = c->neutral;
    } else {
        const bool up = e->kind == HIGH_STOP;
        m->q[i] = up ? c->high[i] : c->low[i];
        if (up ? m->v[i] > 0.0 : m->v[i] < 0.0) {
            m->lost[2] += change_velocity(c, m, i, -c->restitution * m->v[i]);
        }
    }
}

void linkage_part(const linkage_t *c, motion_t *m, double t, double h) {
    interval_t p;
    for (int events = 0; h > 0.0; events++) {
        solve_interval(c, m, t, h, &p);
        const event_t e = first_event(c, m, &p);
        if (e.kind == NOTHING || events == MAX_EVENTS) {
            accept(c, m, &p);
            return;
        }
        bool there = part_of(&e) <= SHORTEST;
        if (!there) {
            there = end_at(c, m, t, &e, &p);
            accept(c, m, &p);
            t += p.h;
            h -= p.h;
        }
        if (there) apply_event(c, m, &e);
    }
}

void linkage_advance(const linkage_t *c, motion_t *m, double h, int parts) {
    for (int k = 0; k < parts; k++) linkage_part(c, m, h * k / parts, h / parts);
}
