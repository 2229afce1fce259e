/* A number of every run that flies side by side: LANES of them in a unit that says so before its
 * first include, one in all others.
 *
 * The equations are written once over `real`.  With one lane that is double, and the compiler
 * folds every choice into a branch; with four or eight it is a vector that holds one number of
 * each run.  Each lane does the operations that one run alone would do, in the same order, so
 * that it has the same bits. */
#ifndef AEROMATCH_REAL_H
#define AEROMATCH_REAL_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifndef LANES
#define LANES 1
#endif

#if LANES == 1

typedef double real;
typedef bool mask_t;
typedef int64_t whole_t;

#define EVERY(condition) (condition)
#define ANY(condition) (condition)
#define PICK(condition, yes, no) ((condition) ? (yes) : (no))
#define WHOLE(x) ((int64_t)(x))
#define REAL(i) ((double)(i))
#define ONE_WHERE(condition) ((int64_t)(condition))

static inline real root(real x) { return sqrt(x); }
static inline real size_of(real x) { return fabs(x); }
static inline real with_sign(real x, real sign) { return copysign(x, sign); }

#else

typedef double real __attribute__((ext_vector_type(LANES)));
typedef int64_t mask_t __attribute__((ext_vector_type(LANES))); /* -1: true */
typedef int64_t whole_t __attribute__((ext_vector_type(LANES)));

#define EVERY(condition) (__builtin_reduce_and(condition) != 0)
#define ANY(condition) (__builtin_reduce_or(condition) != 0)
#define PICK(condition, yes, no) ((condition) ? (real)(yes) : (real)(no))
#define WHOLE(x) (__builtin_convertvector(x, whole_t))
#define REAL(i) (__builtin_convertvector(i, real))
#define ONE_WHERE(condition) (-(condition))

#define root(x) __builtin_elementwise_sqrt(x)
#define size_of(x) __builtin_elementwise_abs(x)
#define with_sign(x, sign) __builtin_elementwise_copysign(x, sign)

/* A unit may be compiled for several numbers of lanes: names with the number behind them. */
#define LANED_(name, lanes) name##_##lanes
#define LANED2(name, lanes) LANED_(name, lanes)
#define LANED(name) LANED2(name, LANES)

#endif

/* One column of a table of doubles, at a row of each lane. */
static inline real gather(const double *from, whole_t at) {
#if LANES == 1
    return from[at];
#else
    real to = 0.0;
    for (int i = 0; i < LANES; i++) to[i] = from[at[i]];
    return to;
#endif
}

static inline real of_words(whole_t bits) {
    real x;
    __builtin_memcpy(&x, &bits, sizeof x);
    return x;
}

static inline whole_t words_of(real x) {
    whole_t bits;
    __builtin_memcpy(&bits, &x, sizeof bits);
    return bits;
}

#endif
