/* What the parameters of a control circuit must fulfil. */
#include "control_check.h"

#include "control_loads.h"
#include "error.h"

#include <math.h>

#define LARGEST 1e9 /* of any constant, so that no product of them overflows */

static bool order_fits(int control, double order) {
    return order == 2.0 || order == 4.0 || (control == U_DELTA_A && order == 6.0);
}

static int check_values(am_sim *sim, const double *p) {
    static const int POSITIVE[] = {P_CIRCUIT_MASS, P_CIRCUIT_STEP, P_CIRCUIT_S_HINGE,
                                   P_CIRCUIT_C_HINGE};
    static const int NOT_NEGATIVE[] = {
        P_CIRCUIT_INERTIA,       P_CIRCUIT_DAMPING,        P_CIRCUIT_HINGE_DAMPING,
        P_CIRCUIT_STIFFNESS,     P_CIRCUIT_PRELOAD,        P_CIRCUIT_FRICTION,
        P_CIRCUIT_STICTION,      P_CIRCUIT_HINGE_FRICTION, P_CIRCUIT_CABLE,
        P_CIRCUIT_CABLE_DAMPING, P_CIRCUIT_TRIM_LIMIT,     P_CIRCUIT_NOSE_SPRING};
    for (size_t k = 0; k < sizeof POSITIVE / sizeof *POSITIVE; k++) {
        if (!(p[POSITIVE[k]] >= 1.0 / LARGEST)) {
            return bad_value(sim, p + POSITIVE[k], "at least 1e-9");
        }
    }
    for (size_t k = 0; k < sizeof NOT_NEGATIVE / sizeof *NOT_NEGATIVE; k++) {
        if (!(p[NOT_NEGATIVE[k]] >= 0.0)) {
            return bad_value(sim, p + NOT_NEGATIVE[k], "zero or positive");
        }
    }
    for (int code = 0; code < P_PER_CIRCUIT; code++) {
        if (code != P_CIRCUIT_TRIM_LIMIT && !(fabs(p[code]) <= LARGEST)) {
            return bad_value(sim, p + code, "between -1e9 and 1e9");
        }
    }
    if (!(p[P_CIRCUIT_STEP] >= 1e-6)) return bad_value(sim, p + P_CIRCUIT_STEP, "at least 1e-6 s");
    const double e = p[P_CIRCUIT_RESTITUTION];
    if (!(e >= 0.0 && e <= 1.0)) {
        return bad_value(sim, p + P_CIRCUIT_RESTITUTION, "between 0 and 1");
    }
    const double share = p[P_CIRCUIT_TRIM_FRICTION];
    if (!(share >= 0.0 && share <= 1.0)) {
        return bad_value(sim, p + P_CIRCUIT_TRIM_FRICTION, "between 0 and 1");
    }
    return AM_OK;
}

static int check_geometry(am_sim *sim, uint32_t item) {
    const double *p = par_of(sim, G_CIRCUIT, item);
    const double G = p[P_CIRCUIT_GEARING];
    if (!(fabs(G) >= 1e-6)) return bad_value(sim, p + P_CIRCUIT_GEARING, "other than zero");
    if (!(p[P_CIRCUIT_LOW] < p[P_CIRCUIT_HIGH])) {
        return bad_value(sim, p + P_CIRCUIT_LOW, "below stop_high");
    }
    if (!(p[P_CIRCUIT_DELTA_LOW] < p[P_CIRCUIT_DELTA_HIGH])) {
        return bad_value(sim, p + P_CIRCUIT_DELTA_LOW, "below delta_high");
    }
    const double reach = fmax(fabs(p[P_CIRCUIT_LOW]), fabs(p[P_CIRCUIT_HIGH]));
    if (!(fabs(p[P_CIRCUIT_GEARING_SLOPE]) * reach < 0.9 * fabs(G))) {
        return bad_value(sim, p + P_CIRCUIT_GEARING_SLOPE,
                         "so small that the gearing keeps a tenth of itself up to the stops");
    }
    const bool cable = circuit_bodies(p) > 1;
    if (cable && !(p[P_CIRCUIT_CABLE] > 0.0)) {
        return bad_value(sim, p + P_CIRCUIT_CABLE, "positive when the order is 4 or 6");
    }
    if (cable && !(p[P_CIRCUIT_INERTIA] * G * G >= 1.0 / LARGEST)) {
        return bad_value(sim, p + P_CIRCUIT_INERTIA, "positive when the order is 4 or 6");
    }
    linkage_t c;
    circuit_linkage(sim, item, &c);
    for (int i = 0; i < c.bodies; i++) {
        if (!(c.low[i] < c.high[i])) {
            return bad_value(sim, p + P_CIRCUIT_DELTA_LOW,
                             "such that the surface and the stops leave some travel");
        }
    }
    return AM_OK;
}

int control_check(am_sim *sim) {
    for (uint32_t i = 0; i < items(sim->model, G_CIRCUIT); i++) {
        const double *p = par_of(sim, G_CIRCUIT, i);
        const int control = circuit_control(sim->model, i);
        if (control < 0 || i >= MAX_CIRCUITS) {
            return fail(sim, AM_BAD_VALUE, "circuit %s is unknown; allowed: column, wheel, pedal",
                        sim->model->item[G_CIRCUIT][i]);
        }
        if (!order_fits(control, p[P_CIRCUIT_ORDER])) {
            return bad_value(sim, p + P_CIRCUIT_ORDER,
                             control == U_DELTA_A ? "2, 4 or 6" : "2 or 4");
        }
        int status = check_values(sim, p);
        if (status == AM_OK) status = check_geometry(sim, i);
        if (status != AM_OK) return status;
    }
    return AM_OK;
}
