/* Elementary functions of one number. */
#include "elementary.h"

#include "series.h"

#include <math.h>
#include <string.h>

static inline uint64_t bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline double of_bits(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* -1022 ... 1023 */
static inline double power_of_two(int e) { return of_bits((uint64_t)(e + 1023) << 52); }

/* ---- sine and cosine ------------------------------------------------------------------------- */

/* sin(y) without its first term, |y.high| <= pi/4 */
static inline double sine_rest(pair_t y, pair_t z) {
    const double s = z.high;
    const double s2 = s * s;
    const double s4 = s2 * s2;
    /* 1/5! 1/7! */
    const double a = 0x1.1111111111111p-7 - s * 0x1.a01a01a01a01ap-13;
    /* 1/9! 1/11! */
    const double b = 0x1.71de3a556c734p-19 - s * 0x1.ae64567f544e4p-26;
    /* 1/13! 1/15! */
    const double c = 0x1.6124613a86d09p-33 - s * 0x1.ae7f3e733b81fp-41;
    const double third = a * s2 + s4 * (b + s2 * (c + s2 * 0x1.952c77030ad4ap-49)); /* 1/17! */
    const double cube = s * y.high;
    const double sixth = 0x1.5555555555555p-3;
    return (y.low * (1.0 - 0.5 * s) + third * y.high) - cube * sixth;
}

static inline pair_t sine(pair_t y, pair_t z) { return sum(y.high, sine_rest(y, z)); }

static inline pair_t cosine(pair_t y, pair_t z) {
    const double s = z.high;
    const double s2 = s * s;
    const double s4 = s2 * s2;
    /* 1/4! 1/6! */
    const double a = 0x1.5555555555555p-5 - s * 0x1.6c16c16c16c17p-10;
    /* 1/8! 1/10! */
    const double b = 0x1.a01a01a01a01ap-16 - s * 0x1.27e4fb7789f5cp-22;
    /* 1/12! 1/14! */
    const double c = 0x1.1eed8eff8d898p-29 - s * 0x1.93974a8c07c9dp-37;
    const double fourth = a * s2 + s4 * (b + s2 * (c + s2 * 0x1.ae7f3e733b81fp-45)); /* 1/16! */
    const pair_t w = sum(1.0, -0.5 * s);
    return sum(w.high, w.low + (fourth - (0.5 * z.low + y.high * y.low)));
}

/* 64 bits of 2/pi from the place of weight 2^-(from + 1) on; from >= -64 */
static uint64_t two_over_pi(int from) {
    const unsigned at = (unsigned)(from + 64);
    const unsigned word = at / 64;
    const unsigned shift = at % 64;
    return shift ? TWO_OVER_PI[word] << shift | TWO_OVER_PI[word + 1] >> (64 - shift)
                 : TWO_OVER_PI[word];
}

static inline uint64_t multiply_wide(uint64_t a, uint64_t b, uint64_t *high) {
    const unsigned __int128 p = (unsigned __int128)a * b;
    *high = (uint64_t)(p >> 64);
    return (uint64_t)p;
}

/* x less the nearest multiple of pi/2 for any finite x of at least 1: Payne and Hanek (1983).  x
 * = m 2^e with an integer m; bits of 2/pi whose product is a multiple of 4 are left out, the
 * next 192 bits leave 2^-137 of a quarter turn. */
static pair_t reduce_large(double x, unsigned *quarter) {
    const uint64_t bits = bits_of(x);
    const uint64_t m = (bits & 0xfffffffffffff) | 0x10000000000000;
    const int e = (int)(bits >> 52 & 0x7ff) - 1075;
    const int from = e - 2;
    uint64_t high, carry;
    uint64_t low = multiply_wide(m, two_over_pi(from + 128), &carry);
    uint64_t middle = multiply_wide(m, two_over_pi(from + 64), &high);
    middle += carry;
    high += middle < carry;
    high += m * two_over_pi(from);
    /* now high:middle:low is the number of quarters modulo 4, times 2^190 */
    *quarter = (unsigned)(high >> 62);
    high = high << 2 | middle >> 62;
    middle = middle << 2 | low >> 62;
    low <<= 2;
    const bool negative = high >> 63;
    if (negative) {
        /* 2^-192 off */
        high = ~high;
        middle = ~middle;
        low = ~low;
        ++*quarter;
    }
    int zeros = 0;
    if (!high) {
        high = middle;
        middle = low;
        low = 0;
        zeros = 64;
    }
    const int shift = __builtin_clzll(high | 1);
    if (shift) {
        high = high << shift | middle >> (64 - shift);
        middle = middle << shift | low >> (64 - shift);
    }
    zeros += shift;
    /* 53 bits, then the next 53 */
    const double first = (double)(high >> 11) * power_of_two(-53 - zeros);
    const double second = (double)((high << 42 | middle >> 22) & 0x1fffffffffffff)
                          * power_of_two(-106 - zeros);
    const pair_t p = product(first, 0.5 * PI.high);
    const double rest = p.low + (first * (0.5 * PI.low) + second * (0.5 * PI.high));
    const pair_t y = sum(p.high, rest);
    *quarter &= 3;
    return negative ? (pair_t){-y.high, -y.low} : y;
}

/* x less the nearest multiple of pi/2, x >= 0: Cody and Waite (1980) in three parts, where these
 * have enough bits. */
static inline pair_t reduce_quarters(double x, unsigned *quarter) {
    *quarter = 0;
    if (x <= 0.25 * PI.high) return (pair_t){x, 0.0};
    if (x < 0x1p20) {
        const double n = (x * 0x1.45f306dc9c883p-1 + TO_INTEGER) - TO_INTEGER;
        /* both products are exact */
        const double r = x - n * 0x1.921fb54400000p+0;
        const double w = n * 0x1.0b4611a600000p-34;
        const double high = r - w;
        const double low = ((r - high) - w) - n * 0x1.3198a2e037073p-69;
        if (fabs(high) > 0x1p-20) {
            *quarter = (unsigned)(int)n & 3;
            return sum(high, low);
        }
    }
    return reduce_large(x, quarter);
}

static inline pair_t square(pair_t y) {
    const double y1 = leading(y.high);
    const double y2 = y.high - y1;
    const double z = y.high * y.high;
    return (pair_t){z, ((y1 * y1 - z) + 2.0 * y1 * y2) + y2 * y2};
}

static inline bool is_finite(double x) { return fabs(x) < INFINITY; }

double am_sin(double x) {
    if (!is_finite(x)) return NAN;
    if (fabs(x) < 0x1p-27) return x;
    unsigned quarter;
    const pair_t y = reduce_quarters(fabs(x), &quarter);
    const pair_t z = square(y);
    const double s = (quarter & 1 ? cosine(y, z) : sine(y, z)).high;
    return (quarter > 1) != (x < 0.0) ? -s : s;
}

double am_cos(double x) {
    if (!is_finite(x)) return NAN;
    unsigned quarter;
    const pair_t y = reduce_quarters(fabs(x), &quarter);
    const pair_t z = square(y);
    const double c = (quarter & 1 ? sine(y, z) : cosine(y, z)).high;
    return quarter == 1 || quarter == 2 ? -c : c;
}

void am_sincos(double x, double *sine_of, double *cosine_of) {
    if (!is_finite(x) || fabs(x) < 0x1p-27) {
        *sine_of = am_sin(x);
        *cosine_of = am_cos(x);
        return;
    }
    unsigned quarter;
    const pair_t y = reduce_quarters(fabs(x), &quarter);
    const pair_t z = square(y);
    const double s = sine(y, z).high;
    const double c = cosine(y, z).high;
    const double sin_x = quarter & 1 ? c : s;
    const double cos_x = quarter & 1 ? s : c;
    *sine_of = (quarter > 1) != (x < 0.0) ? -sin_x : sin_x;
    *cosine_of = quarter == 1 || quarter == 2 ? -cos_x : cos_x;
}

double am_tan(double x) {
    if (!is_finite(x)) return NAN;
    if (fabs(x) < 0x1p-27) return x;
    unsigned quarter;
    const pair_t y = reduce_quarters(fabs(x), &quarter);
    const pair_t z = square(y);
    const pair_t s = sine(y, z);
    const pair_t c = cosine(y, z);
    const pair_t top = quarter & 1 ? c : s;
    const pair_t bottom = quarter & 1 ? s : c;
    const double t = top.high / bottom.high;
    const pair_t back = product(t, bottom.high);
    const double tangent =
        t + (((top.high - back.high) - back.low) + (top.low - t * bottom.low)) / bottom.high;
    return (quarter & 1) != (x < 0.0) ? -tangent : tangent;
}

/* ---- inverse functions ----------------------------------------------------------------------- */

/* Zeros, infinities and NaN; -x or +x only counts by its sign. */
static double atan2_special(double y, double x) {
    if (y != y || x != x) return NAN;
    const bool left = signbit(x);
    const bool wide = fabs(x) < fabs(y);
    double angle = fabs(y) == fabs(x) && y != 0.0 ? 0.25 * PI.high : wide ? 0.5 * PI.high : 0.0;
    if (left && !wide) angle = angle == 0.0 ? PI.high : 0.75 * PI.high;
    return copysign(angle, y);
}

double am_atan2(double y, double x) {
    double n = fabs(y);
    double d = fabs(x);
    const bool steep = n > d;
    if (steep) {
        n = fabs(x);
        d = fabs(y);
    }
    if (!(n > 0.0 && d < INFINITY)) return atan2_special(y, x);
    if (d > 0x1p500 || n < 0x1p-500) {
        /* a ratio below 2^-60 is its own arctangent, and to any other angle it adds nothing;
         * else both move by the same power of two */
        const double scale = d > 1.0 ? 0x1p-600 : 0x1p600;
        if (n / d < 0x1p-60) {
            return steep ? copysign(0.5 * PI.high, y) : signbit(x) ? copysign(PI.high, y) : y / x;
        }
        n *= scale;
        d *= scale;
    }
    return angle_of(n, d, steep, y, x);
}

double am_asin(double x) {
    const double a = fabs(x);
    if (!(a <= 1.0)) return NAN;
    if (a < 0x1p-27) return x;
    if (a == 1.0) return copysign(0.5 * PI.high, x);
    /* the arc of sine a has the cosine c + rest, (c + rest)^2 = (1 - a) (1 + a) */
    const pair_t more = sum(1.0, a);
    const pair_t less = sum(1.0, -a);
    const pair_t squared = product(less.high, more.high);
    const double c = sqrt(squared.high);
    const pair_t back = product(c, c);
    const double rest = (((squared.high - back.high) - back.low)
                         + (squared.low + less.high * more.low + less.low * more.high))
                        / (2.0 * c);
    const pair_t angle = a <= c ? arctangent(a, c) : rest_of(0.5, arctangent(c, a));
    return copysign(angle.high + (angle.low - a * rest), x);
}

/* ---- exponential and logarithm --------------------------------------------------------------- */

/* e^(high + low), |high| < 746 */
static inline double exponential(double high, double low) {
    int64_t e;
    const double value = exponential_parts(high, low, &e);
    if (e > -1022 && e < 1024) return value * power_of_two((int)e);
    return e > 0 ? value * power_of_two((int)e - 1) * 2.0
                 : value * power_of_two((int)e + 200) * 0x1p-200;
}

/* of a positive finite number */
static inline pair_t logarithm(double x) {
    return x < 0x1p-1022 ? logarithm_of(x * 0x1p52, -52) : logarithm_of(x, 0);
}

double am_exp(double x) {
    if (x > 709.79) return INFINITY;
    if (x < -745.2) return 0.0;
    return x == x ? exponential(x, 0.0) : NAN;
}

double am_log(double x) {
    if (x > 0.0 && x < INFINITY) return logarithm(x).high;
    return x == 0.0 ? -INFINITY : x > 0.0 ? x : NAN;
}

/* 0: no integer, 1: odd, 2: even */
static int parity(double y) {
    if (fabs(y) >= 0x1p53) return 2;
    if (floor(y) != y) return 0;
    return (int64_t)y & 1 ? 1 : 2;
}

/* One of the two is zero, infinite or NaN, or x is negative. */
static double pow_special(double x, double y) {
    if (y == 0.0 || x == 1.0) return 1.0;
    if (x != x || y != y) return NAN;
    if (!is_finite(y)) return fabs(x) == 1.0 ? 1.0 : (fabs(x) > 1.0) == (y > 0.0) ? INFINITY : 0.0;
    const int integer = parity(y);
    double size;
    if (x == 0.0 || !is_finite(x)) size = (x == 0.0) == (y > 0.0) ? 0.0 : INFINITY;
    else size = integer ? am_pow(-x, y) : NAN;
    return integer == 1 && signbit(x) ? -size : size;
}

double am_pow(double x, double y) {
    if (!(x > 0.0 && x < INFINITY && is_finite(y)) || y == 0.0) return pow_special(x, y);
    const pair_t l = logarithm(x);
    const double rough = l.high * y;
    if (rough > 710.0) return INFINITY;
    if (rough < -746.0) return 0.0;
    const pair_t p = product(l.high, y);
    return exponential(p.high, p.low + l.low * y);
}
