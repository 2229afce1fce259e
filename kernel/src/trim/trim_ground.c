/* Trim on the ground, at rest or rolling: height and attitude so that the legs carry the
 * aircraft; at rest also the deflections of the tyres along the ground, so that brakes, thrust,
 * wind and steering balance. */
#include "trim_ground.h"

#include "error.h"
#include "least_norm.h"
#include "standing.h"
#include "trim_for.h"

#include <math.h>
#include <string.h>

#define ROOM 20.0     /* over and under the first guess of the height [m] */
#define TILT 0.5      /* most pitch and bank [rad] */
#define TYRE_ROOM 0.2 /* most deflection of a tyre along the ground [m] */
#define HEIGHT_SIZE 10.0
#define TYRE_SIZE 0.01

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

static int balance_on_ground(am_sim *sim) {
    static const int STANDING[] = {Y_TRIM_U_DOT, Y_TRIM_V_DOT, Y_TRIM_W_DOT,
                                   Y_TRIM_P_DOT, Y_TRIM_Q_DOT, Y_TRIM_R_DOT};
    static const int ROLLING[] = {AM_GOAL_CLIMB, Y_TRIM_P_DOT, Y_TRIM_Q_DOT};
    static const double NONE[6];
    const bool rest = sim->par[P_V] == 0.0;
    unknowns_t z = {.n = 0};
    double left[6];
    guess_standing(sim);
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
    return solve_trim(sim, &task, z.found, NULL, left, NULL);
}

int trim_on_ground(am_sim *sim) {
    double *p = sim->par;
    double stored[P_R + 1];
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
    memcpy(stored, p, sizeof stored);
    const int status = balance_on_ground(sim);
    memcpy(p, stored, sizeof stored);
    sim->prepared = sim->fresh = false;
    return status;
}
