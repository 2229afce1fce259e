/* The knots of a piecewise linear signal, oldest first.  A knot on the line between its neighbours
 * is not stored, so the line is the same for any steps that describe the same signal; knots older
 * than the delay are dropped.  With more than DELAY_KNOTS / 2 knots within the delay the finest
 * are thinned. */
#include "delay.h"

#include <math.h>
#include <string.h>

#define STRAIGHT 1e-13 /* of the value: rounding of inputs blended between samples */
#define NEAR DELAY_NEAR

enum { COUNT = DELAY_COUNT, KNOT = DELAY_T0 };

static double *knot(double *line, int i) { return line + KNOT + 2 * i; }

static const double *knot_at(const double *line, int i) { return line + KNOT + 2 * i; }

static void drop_first(double *line, int n) {
    if (n == 0) return;
    line[COUNT] -= n;
    memmove(knot(line, 0), knot(line, n), sizeof(double) * 2 * (size_t)line[COUNT]);
}

static void append(double *line, double t, double value) {
    if (line[COUNT] >= DELAY_KNOTS) drop_first(line, 1);
    double *last = knot(line, (int)line[COUNT]);
    last[0] = t;
    last[1] = value;
    line[COUNT]++;
}

void delay_start(double *line, double t, double value) {
    line[COUNT] = 0.0;
    append(line, t, value);
}

/* Whether the last knot may go when (t, value) follows. */
static bool needless(const double *line, double t, double value, double finest) {
    const int n = (int)line[COUNT];
    if (n < 2) return false;
    const double *a = knot_at(line, n - 2);
    const double *b = knot_at(line, n - 1);
    /* a third value at one time: the middle one was never seen */
    if (!(t > a[0])) return b[0] == t;
    if (t - a[0] < finest) return true;
    if (b[0] == a[0] || b[0] == t) return false;
    const double between = a[1] + (value - a[1]) * ((b[0] - a[0]) / (t - a[0]));
    return fabs(between - b[1]) <= STRAIGHT * (fabs(a[1]) + fabs(value));
}

void delay_record(double *line, double t, double value, double delay) {
    /* time was put back */
    while (line[COUNT] > 1.0 && knot(line, (int)line[COUNT] - 1)[0] > t + NEAR) line[COUNT]--;
    /* no reading lies before it */
    const double *last = knot(line, (int)line[COUNT] - 1);
    const double oldest = last[0] - delay - NEAR;
    if (last[0] > t) t = last[0];
    if (last[0] == t && last[1] == value) return;
    if (needless(line, t, value, delay * (2.5 / DELAY_KNOTS))) line[COUNT]--;
    int old = 0;
    while (old + 1 < (int)line[COUNT] && knot(line, old + 1)[0] < oldest) old++;
    drop_first(line, old);
    append(line, t, value);
}

bool delay_valid(const double *line, bool started) {
    const double count = line[COUNT];
    return count >= (started ? 1.0 : 0.0) && count <= DELAY_KNOTS && count == floor(count);
}

double delay_search(const double *line, double t, bool after) {
    const double limit = after ? t + NEAR : t - NEAR;
    /* the last knot up to the limit, and the next */
    int low = -1;
    int high = (int)line[COUNT];
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (knot_at(line, middle)[0] <= limit) low = middle;
        else high = middle;
    }
    if (low < 0) return knot_at(line, 0)[1];
    const double *a = knot_at(line, low);
    if (high == (int)line[COUNT]) return a[1];
    const double *b = knot_at(line, high);
    const double part = (t - a[0]) / (b[0] - a[0]);
    return a[1] + (b[1] - a[1]) * fmin(fmax(part, 0.0), 1.0);
}
