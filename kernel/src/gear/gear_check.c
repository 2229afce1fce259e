/* What the parameters of runway and contacts must fulfil, and the reach of the contacts. */
#include "gear_check.h"

#include "error.h"
#include "gear.h"
#include "steering.h"
#include "tyre.h"

#include <math.h>

static int check_contact(am_sim *sim, const double *p) {
    static const int POSITIVE[] = {P_CONTACT_STROKE, P_CONTACT_SIDE, P_CONTACT_CORNERING_LOAD};
    static const int NOT_NEGATIVE[] = {
        P_CONTACT_RADIUS,         P_CONTACT_STIFFNESS, P_CONTACT_PRELOAD,     P_CONTACT_DAMPING,
        P_CONTACT_DAMPING_EXT,    P_CONTACT_ORIFICE,   P_CONTACT_ORIFICE_EXT, P_CONTACT_TYRE,
        P_CONTACT_CORNERING,      P_CONTACT_LOSS,      P_CONTACT_ROLLING,     P_CONTACT_BRAKE,
        P_CONTACT_BRAKE_FRICTION, P_CONTACT_FRICTION};
    for (size_t k = 0; k < sizeof POSITIVE / sizeof *POSITIVE; k++) {
        if (!(p[POSITIVE[k]] > 0.0)) return bad_value(sim, p + POSITIVE[k], "positive");
    }
    for (size_t k = 0; k < sizeof NOT_NEGATIVE / sizeof *NOT_NEGATIVE; k++) {
        if (!(p[NOT_NEGATIVE[k]] >= 0.0)) {
            return bad_value(sim, p + NOT_NEGATIVE[k], "zero or positive");
        }
    }
    if (p[P_CONTACT_PRELOAD] > 0.0 && p[P_CONTACT_TYRE] == 0.0) {
        return bad_value(
            sim, p + P_CONTACT_PRELOAD,
            "zero without a tyre_stiffness, or the ground would push at a touch with the whole "
            "preload");
    }
    if (p[P_CONTACT_FRICTION] == 0.0 && p[P_CONTACT_CORNERING] == 0.0) {
        return bad_value(sim, p + P_CONTACT_CORNERING,
                         "positive for a wheel; a skid has a friction instead");
    }
    /* more would return energy where the rubber is renewed */
    if (p[P_CONTACT_LOSS] > 2.0 * TYRE_LAG) {
        return bad_value(sim, p + P_CONTACT_LOSS, "at most 0.04 s");
    }
    if (p[P_CONTACT_RETRACTS] != 0.0 && p[P_CONTACT_RETRACTS] != 1.0) {
        return bad_value(sim, p + P_CONTACT_RETRACTS, "0 (fixed) or 1 (retracts)");
    }
    return AM_OK;
}

static void find_reach(am_sim *sim) {
    sim->reach = -INFINITY;
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
        const double *p = par_of(sim, G_CONTACT, i);
        const double *at = p + P_CONTACT_X;
        sim->reach = larger(sim->reach,
                            2.0 * p[P_CONTACT_RADIUS] + fabs(at[0]) + fabs(at[1]) + fabs(at[2]));
    }
}

static int check_runway(am_sim *sim, const double *p) {
    static const int NOT_NEGATIVE[] = {P_MU_DRY, P_MU_ICY};
    for (size_t k = 0; k < sizeof NOT_NEGATIVE / sizeof *NOT_NEGATIVE; k++) {
        if (!(p[NOT_NEGATIVE[k]] >= 0.0)) {
            return bad_value(sim, p + NOT_NEGATIVE[k], "zero or positive");
        }
    }
    if (p[P_RUNWAY_CONDITION] != DRY && p[P_RUNWAY_CONDITION] != WET
        && p[P_RUNWAY_CONDITION] != ICY) {
        return bad_value(sim, p + P_RUNWAY_CONDITION, "0 (dry), 1 (wet) or 2 (icy)");
    }
    if (!(p[P_SKID_RATIO] >= 0.0 && p[P_SKID_RATIO] <= 1.0)) {
        return bad_value(sim, p + P_SKID_RATIO, "between 0 and 1");
    }
    if (!(p[P_ANTISKID] >= 0.0 && p[P_ANTISKID] <= 1.0)) {
        return bad_value(sim, p + P_ANTISKID, "between 0 (none) and 1");
    }
    return AM_OK;
}

int gear_check(am_sim *sim) {
    if (!items(sim->model, G_GEAR)) return AM_OK;
    int status = check_runway(sim, par_of(sim, G_GEAR, 0));
    if (status == AM_OK) status = steering_check(sim);
    for (uint32_t i = 0; i < items(sim->model, G_CONTACT) && status == AM_OK; i++) {
        status = check_contact(sim, par_of(sim, G_CONTACT, i));
    }
    find_reach(sim);
    sim->off_ground = false;
    return status;
}
