/* Elementary functions of the kernel's own: the same bits on every platform, on which no two
 * mathematical libraries agree.
 *
 * Double precision, round to nearest, no fused multiply-add (-ffp-contract=off), only + - * /
 * and sqrt.  Every function is within 1 ulp of the exact value for every argument (measured:
 * docs/explanation/simulation/kernel.md) and treats NaN, infinities, signed zeros and subnormal
 * numbers as C11 annex F states; every NaN that comes out of numbers is the same NaN. */
#ifndef AEROMATCH_ELEMENTARY_H
#define AEROMATCH_ELEMENTARY_H

/* any finite x: reduced with as many bits of 2/pi as it takes */
double am_sin(double x);
double am_cos(double x);
double am_tan(double x);
/* the same bits as am_sin and am_cos */
void am_sincos(double x, double *sine, double *cosine);
double am_asin(double x);
double am_atan2(double y, double x);
double am_exp(double x);
double am_log(double x);
double am_pow(double x, double y);

#endif
