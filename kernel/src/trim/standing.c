/* The attitude in which an aircraft stands, as a first guess: rigid legs on a plane. */
#include "standing.h"

#include "elementary.h"

#include <math.h>

#define SAG 0.02 /* of the legs in the first guess [m] */

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

void guess_standing(am_sim *sim) {
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
