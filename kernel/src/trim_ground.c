/* Trim on the ground, at rest or rolling: height and attitude so that the legs carry the
 * aircraft; at rest also the deflections of the tyres along the ground, so that brakes, thrust,
 * wind and steering balance. */
#include "elementary.h"
#include "least_norm.h"
#include "trim.h"

#include <math.h>
#include <string.h>

#define SAG 0.02      /* of the legs in the first guess [m] */
#define ROOM 20.0     /* over and under the first guess of the height [m] */
#define TILT 0.5      /* most pitch and bank [rad] */
#define TYRE_ROOM 0.2 /* most deflection of a tyre along the ground [m] */
#define HEIGHT_SIZE 10.0
#define TYRE_SIZE 0.01

typedef struct {
    double x, z; /* from the c.g. */
} spot_t;

static int spots_that_carry(const am_sim *sim, spot_t spot[MAX_ITEMS]) {
    int n = 0;
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
        const double *p = par_of(sim, G_CONTACT, i);
        if (p[P_CONTACT_RETRACTS] != 0.0 && !(sim->u[U_GEAR] > 0.0)) continue;
        spot[n++] = (spot_t){p[P_CONTACT_X] - sim->now.cg[0], p[P_CONTACT_Z] - sim->now.cg[2]};
    }
    return n;
}

/* Pitch attitude on the edge of the lower hull of the contacts that spans the c.g.: the edge
 * that lies lowest there. */
static double rest_pitch(const spot_t *spot, int n) {
    double lowest = -INFINITY;
    double theta = 0.0;
    for (int fore = 0; fore < n; fore++) {
        for (int aft = 0; aft < n; aft++) {
            if (!(spot[fore].x > 0.0 && spot[aft].x <= 0.0)) continue;
            const double slope = (spot[fore].z - spot[aft].z) / (spot[fore].x - spot[aft].x);
            const double under = spot[aft].z - slope * spot[aft].x;
            if (under > lowest) {
                lowest = under;
                theta = am_atan2(slope, 1.0);
            }
        }
    }
    return theta;
}

void stand_up(am_sim *sim) {
    spot_t spot[MAX_ITEMS];
    const int n = spots_that_carry(sim, spot);
    if (n == 0) return;
    const double theta = rest_pitch(spot, n);
    const double s = am_sin(theta);
    const double c = am_cos(theta);
    double reach = -INFINITY;
    for (int i = 0; i < n; i++) reach = fmax(reach, spot[i].z * c - spot[i].x * s);
    sim->par[P_THETA] = theta;
    sim->par[P_H] = sim->par[P_RUNWAY] + reach - SAG;
}

typedef struct {
    am_mover mover[LARGEST_SYSTEM];
    double found[LARGEST_SYSTEM], low[LARGEST_SYSTEM], high[LARGEST_SYSTEM], size[LARGEST_SYSTEM];
    int n;
} unknowns_t;

static void add(unknowns_t *to, int kind, uint32_t index, double at, double room, double size) {
    to->mover[to->n] = (am_mover){kind, (int)index, to->n};
    to->found[to->n] = at;
    to->low[to->n] = at - room;
    to->high[to->n] = at + room;
    to->size[to->n] = size;
    to->n++;
}

static void add_tyres(const am_sim *sim, unknowns_t *to) {
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT) && to->n + 2 <= LARGEST_SYSTEM; i++) {
        if (par_of(sim, G_CONTACT, i)[P_CONTACT_FRICTION] != 0.0) continue;
        const uint32_t first = place(sim->model, AM_STATE, G_CONTACT, i);
        add(to, AM_STATE, first + X_CONTACT_LONG, 0.0, TYRE_ROOM, TYRE_SIZE);
        add(to, AM_STATE, first + X_CONTACT_SIDE, 0.0, TYRE_ROOM, TYRE_SIZE);
    }
}

static int balance(am_sim *sim) {
    static const int STANDING[] = {Y_TRIM_U_DOT, Y_TRIM_V_DOT, Y_TRIM_W_DOT,
                                   Y_TRIM_P_DOT, Y_TRIM_Q_DOT, Y_TRIM_R_DOT};
    static const int ROLLING[] = {AM_GOAL_CLIMB, Y_TRIM_P_DOT, Y_TRIM_Q_DOT};
    static const double NONE[6];
    const bool rest = sim->par[P_V] == 0.0;
    unknowns_t z = {.n = 0};
    double left[6];
    stand_up(sim);
    add(&z, AM_PARAMETER, P_H, sim->par[P_H], ROOM, HEIGHT_SIZE);
    add(&z, AM_PARAMETER, P_THETA, sim->par[P_THETA], TILT, 1.0);
    add(&z, AM_PARAMETER, P_PHI, 0.0, TILT, 1.0);
    if (rest) add_tyres(sim, &z);
    const am_trim_task task = {.path = AM_PATH_GROUND,
                               .movers = z.n,
                               .unknowns = z.n,
                               .goals = rest ? 6 : 3,
                               .mover = z.mover,
                               .low = z.low,
                               .high = z.high,
                               .size = z.size,
                               .goal = rest ? STANDING : ROLLING,
                               .wanted = NONE};
    return trim_seek(sim, &task, z.found, NULL, left, NULL);
}

int trim_on_ground(am_sim *sim) {
    double *p = sim->par;
    double kept[P_R + 1];
    if (!items(sim->model, G_CONTACT)) {
        return fail(
            sim, AM_BAD_VALUE,
            "mode.trim = 3 stands on the ground, but the aircraft has no landing gear; give it "
            "[gear]");
    }
    if (!(sim->u[U_GEAR] > 0.0)) {
        return fail(sim, AM_BAD_VALUE,
                    "mode.trim = 3 stands on the ground, but the input gear is %g; extend it (1)",
                    sim->u[U_GEAR]);
    }
    memcpy(kept, p, sizeof kept);
    const int status = balance(sim);
    memcpy(p, kept, sizeof kept);
    sim->prepared = sim->fresh = false;
    return status;
}
