/* The pitch of a simulator in degrees: theta' = (2 elevator - theta) / 0.5 s, by Runge-Kutta steps of at most 5 ms; nz = 1 - 4 elevator. */
#ifndef LAG_H
#define LAG_H
#include <math.h>

#define DEGREE 0.017453292519943295

typedef struct {
    double elevator, pitch, first_pitch; /* deg; elevator is positive with the nose up */
    int actuator;                        /* 0 off, 1 on */
} lag;

static double lag_rate(const lag *m, double pitch) { return (-2.0 * (m->actuator ? m->elevator : 0.0) - pitch) / 0.5; }
static double lag_nz(const lag *m) { return 1.0 + 4.0 * m->elevator * DEGREE; }

static void lag_advance(lag *m, double duration) {
    const int count = (int)ceil(duration / 0.005 - 1e-9);
    const double h = duration / count;
    for (int i = 0; i < count; i++) {
        const double k1 = lag_rate(m, m->pitch), k2 = lag_rate(m, m->pitch + 0.5 * h * k1);
        const double k3 = lag_rate(m, m->pitch + 0.5 * h * k2), k4 = lag_rate(m, m->pitch + h * k3);
        m->pitch += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
    }
}
#endif
