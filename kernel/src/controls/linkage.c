/* Time stepping of bodies with dry friction and unilateral stops, set-valued, on the level of
 * velocities.
 *
 * Over a piece of length h the mean velocity w = (v + v+) / 2 solves the midpoint rule with the
 * friction law at w:
 *
 *     M (v+ - v) / h = f - K (q + h w / 2) - W w - r
 *     r in friction Sgn(w) + preload Sgn(q + h w - neutral) + normal cone of the stops
 *     q+ = q + h w
 *
 * The matrix is positive definite and the graphs of r are monotone, so there is one solution,
 * and it is found exactly.  With v+ = 2 w - v the energy of masses and springs changes by the
 * work of f minus h (W w + r) w: friction and dampers only take. A body that sticks (w = 0)
 * comes out with v+ = 0, a body that meets a stop with v+ = -restitution times its speed; both
 * only take kinetic energy, since M is diagonal.  A body at rest whose friction suffices has q+
 * = q and v+ = 0 to the last bit.
 *
 * Reversals, passages through neutral and impacts are located and end the piece (switching
 * points of Studer, Leine and Glocker, Int. J. Numer. Meth. Engng 76, 2008), which keeps the
 * second order of the midpoint rule.  When a sub-step holds more than MAX_EVENTS of them its
 * rest is done in one piece, less accurate but no less dissipative.  Scheme without switching
 * points: Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008. */
#include "linkage.h"

#include "algebra.h"

#include <math.h>

#define MAX_EVENTS 16
#define SHORTEST 1e-13 /* part of a piece within which an event happens at once */

/* A piece of motion and its solution. */
typedef struct {
    /* cable: what binds the velocities of body 0 and another */
    double h, cable;
    double a[LINKAGE_BODIES], b[LINKAGE_BODIES], threshold[LINKAGE_BODIES];
    /* mean velocities that end at a stop, at neutral */
    double low[LINKAGE_BODIES], high[LINKAGE_BODIES], to_neutral;
    double w[LINKAGE_BODIES];
    double friction[LINKAGE_BODIES], stop[LINKAGE_BODIES], preload;
} piece_t;

typedef enum { NOTHING, REVERSAL, HIGH_STOP, LOW_STOP, NEUTRAL } kind_t;
typedef struct {
    kind_t kind;
    int body;
    /* value at the start and at the end of the piece; zero is where it happens */
    double start, end;
} event_t;

static double signed_force(double size, double direction) { return direction > 0.0 ? size : -size; }

static void set_up(const linkage_t *c, const motion_t *m, double t, double h, piece_t *p) {
    p->h = h;
    p->cable = c->cable_damping + 0.5 * h * c->cable_stiffness;
    for (int i = 0; i < c->bodies; i++) {
        const double k = c->stiffness[i];
        /* an unstable spring would spoil the definite matrix: it acts at the place where the
         * present velocity leads */
        const double place = k > 0.0 ? m->q[i] : m->q[i] + 0.5 * h * m->v[i];
        p->a[i] = 2.0 * c->mass[i] / h + c->damping[i] + (k > 0.0 ? 0.5 * h * k : 0.0);
        p->b[i] = 2.0 * c->mass[i] * m->v[i] / h + c->load[i] + c->load_rate[i] * (t + 0.5 * h)
                  - k * (place - c->origin[i]);
        p->low[i] = (c->low[i] - m->q[i]) / h;
        p->high[i] = (c->high[i] - m->q[i]) / h;
        p->threshold[i] = m->v[i] == 0.0 ? c->breakout[i] : c->friction[i];
        if (i == 0) continue;
        const double tension = c->cable_stiffness * (m->q[i] - m->q[0]);
        p->a[0] += p->cable;
        p->a[i] += p->cable;
        p->b[0] += tension;
        p->b[i] -= tension;
    }
    p->to_neutral = (c->neutral - m->q[0]) / h;
}

/* Solution w of a w + friction Sgn(w) + preload Sgn(w - neutral) = b between low and high. */
static double balance(double a, double b, double friction, double preload, double neutral,
                      double low, double high) {
    const bool first = neutral < 0.0;
    const double p1 = first ? neutral : 0.0;
    const double p2 = first ? 0.0 : neutral;
    const double j1 = first ? preload : friction;
    const double j2 = first ? friction : preload;
    double w;
    if ((b + j1 + j2) / a < p1) w = (b + j1 + j2) / a;
    else if ((b - j1 + j2) / a <= p1) w = p1;
    else if ((b - j1 + j2) / a < p2) w = (b - j1 + j2) / a;
    else if ((b - j1 - j2) / a <= p2) w = p2;
    else w = (b - j1 - j2) / a;
    return clamp(w, low, high);
}

/* Velocity of body i > 0 when body 0 has w0; *slope states how it follows. */
static double follow(const piece_t *p, int i, double w0, double *slope) {
    const double w = balance(p->a[i], p->b[i] + p->cable * w0, p->threshold[i], 0.0, 0.0, p->low[i],
                             p->high[i]);
    const bool free = w > p->low[i] && w < p->high[i] && (w != 0.0 || p->threshold[i] == 0.0);
    *slope = free ? p->cable / p->a[i] : 0.0;
    return w;
}

/* Newton on a monotone, piecewise linear equation for w of body 0; the bracket excludes cycles. */
static double cockpit_velocity(const piece_t *p, int bodies, double preload, double guess) {
    double w0 = clamp(guess, p->low[0], p->high[0]);
    double below = -HUGE_VAL;
    double above = HUGE_VAL;
    for (int iteration = 0; iteration < 100; iteration++) {
        double a = p->a[0];
        double b = p->b[0];
        double slope;
        for (int i = 1; i < bodies; i++) {
            const double w = follow(p, i, w0, &slope);
            a -= p->cable * slope;
            b += p->cable * (w - slope * w0);
        }
        double next = balance(a, b, p->threshold[0], preload, p->to_neutral, p->low[0], p->high[0]);
        if (fabs(next - w0) <= 1e-15 * fabs(w0)) return next;
        if (next > w0) below = w0;
        else above = w0;
        if (next <= below || next >= above) next = 0.5 * (below + above);
        w0 = next;
    }
    return w0;
}

/* What friction, preload and stop have in the reaction on a body; where several could hold it,
 * preload first and stop last. */
static void split_reaction(const linkage_t *c, piece_t *p, int i, double reaction) {
    const double w = p->w[i];
    const double R = p->threshold[i];
    const double P = i ? 0.0 : c->preload;
    const bool at_neutral = w == p->to_neutral;
    p->friction[i] = w == 0.0 ? 0.0 : signed_force(R, w);
    const double preload = at_neutral ? clamp(reaction - p->friction[i], -P, P)
                                      : signed_force(P, w - p->to_neutral);
    if (w == 0.0) p->friction[i] = clamp(reaction - preload, -R, R);
    p->stop[i] = w == p->low[i] || w == p->high[i] ? reaction - preload - p->friction[i] : 0.0;
    if (i == 0) p->preload = preload;
}

static void solve_velocities(const linkage_t *c, const motion_t *m, piece_t *p) {
    double slope;
    for (bool again = true; again;) {
        p->w[0] = c->driven ? c->drive : cockpit_velocity(p, c->bodies, c->preload, m->v[0]);
        for (int i = 1; i < c->bodies; i++) p->w[i] = follow(p, i, p->w[0], &slope);
        again = false;
        for (int i = 0; i < c->bodies; i++) {
            /* broken out of stiction: solve once more with sliding friction */
            if (p->w[i] != 0.0 && p->threshold[i] > c->friction[i]) {
                p->threshold[i] = c->friction[i];
                again = true;
            }
        }
    }
}

static void solve(const linkage_t *c, const motion_t *m, double t, double h, piece_t *p) {
    set_up(c, m, t, h, p);
    solve_velocities(c, m, p);
    double reaction = p->b[0] - p->a[0] * p->w[0];
    for (int i = 1; i < c->bodies; i++) {
        reaction += p->cable * p->w[i];
        split_reaction(c, p, i, p->b[i] + p->cable * p->w[0] - p->a[i] * p->w[i]);
    }
    split_reaction(c, p, 0, reaction);
}

/* A value whose change of sign is an event in the piece.  Friction,
 * preload and stop are those before the event, so that the value is smooth in h. */
static event_t event_of(const linkage_t *c, const motion_t *m, const piece_t *p, kind_t kind,
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

static event_t first_event(const linkage_t *c, const motion_t *m, const piece_t *p) {
    event_t first = {NOTHING, 0, 0.0, 0.0};
    for (int i = c->driven ? 1 : 0; i < c->bodies; i++) {
        for (kind_t kind = REVERSAL; kind <= (i == 0 ? NEUTRAL : LOW_STOP); kind++) {
            const event_t e = event_of(c, m, p, kind, i);
            if (happens(&e) && (first.kind == NOTHING || part_of(&e) < part_of(&first))) first = e;
        }
    }
    return first;
}

/* Shorten the piece so that it ends with the event: regula falsi with halved weights.  False
 * when the search fails. */
static bool end_at(const linkage_t *c, const motion_t *m, double t, const event_t *first,
                   piece_t *p) {
    const double least = SHORTEST * p->h;
    double h0 = 0.0;
    double h1 = p->h;
    double e0 = first->start;
    double e1 = first->end;
    for (int iteration = 0, side = 0; iteration < 40; iteration++) {
        const double h = fmax(h0 + (h1 - h0) * (e0 / (e0 - e1)), least);
        solve(c, m, t, h, p);
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

static double give_up(const linkage_t *c, motion_t *m, int i, double v) {
    const double lost = 0.5 * c->mass[i] * (m->v[i] * m->v[i] - v * v);
    m->v[i] = v;
    return lost;
}

/* Velocity of a body after it sticks or meets a stop. */
static void hold_back(const linkage_t *c, motion_t *m, const piece_t *p, int i) {
    const double w = p->w[i];
    const bool held = p->threshold[i] > 0.0 || (i == 0 && c->preload > 0.0 && p->to_neutral == 0.0);
    if (w == p->high[i]) m->lost[2] += give_up(c, m, i, -c->restitution * fmax(m->v[i], 0.0));
    else if (w == p->low[i]) m->lost[2] += give_up(c, m, i, -c->restitution * fmin(m->v[i], 0.0));
    else if (w == 0.0 && held) m->lost[0] += give_up(c, m, i, 0.0);
}

static void accept(const linkage_t *c, motion_t *m, const piece_t *p) {
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
static void take_event(const linkage_t *c, motion_t *m, const event_t *e) {
    const int i = e->body;
    if (e->kind == REVERSAL) {
        m->lost[0] += give_up(c, m, i, 0.0);
    } else if (e->kind == NEUTRAL) {
        m->q[i] = c->neutral;
    } else {
        const bool up = e->kind == HIGH_STOP;
        m->q[i] = up ? c->high[i] : c->low[i];
        if (up ? m->v[i] > 0.0 : m->v[i] < 0.0) {
            m->lost[2] += give_up(c, m, i, -c->restitution * m->v[i]);
        }
    }
}

void linkage_part(const linkage_t *c, motion_t *m, double t, double h) {
    piece_t p;
    for (int events = 0; h > 0.0; events++) {
        solve(c, m, t, h, &p);
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
        if (there) take_event(c, m, &e);
    }
}

void linkage_advance(const linkage_t *c, motion_t *m, double h, int parts) {
    for (int k = 0; k < parts; k++) linkage_part(c, m, h * k / parts, h / parts);
}
