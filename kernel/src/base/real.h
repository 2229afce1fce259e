/* A number of every run that flies side by side: LANES of them in a unit that defines it before its
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
#include <string.h>

#ifndef LANES
#define LANES 1
#endif

/* A unit that includes others once more, for another processor, defines what it is called by. */
#ifdef AGAIN
#define ORIGINAL 0
#define SUFFIX AGAIN
#else
#define ORIGINAL (LANES == 1)
#define SUFFIX LANES
#endif

/* Its functions: names with the number of lanes or the processor behind them. */
#define LANED_(name, suffix) name##_##suffix
#define LANED2(name, suffix) LANED_(name, suffix)
#define LANED(name) LANED2(name, SUFFIX)

#if LANES == 1

typedef double real;
typedef bool mask_t;
typedef int64_t whole_t;

#define EVERY(condition) (condition)
#define ANY(condition) (condition)
#define PICK(condition, yes, no) ((condition) ? (yes) : (no))
#define NOT(condition) (!(condition))
#define FIRST(x) (x)
#define WHOLE(x) ((int64_t)(x))
#define REAL(i) ((double)(i))
#define ONE_WHERE(condition) ((int64_t)(condition))

#else

typedef double real __attribute__((ext_vector_type(LANES)));
/* what a comparison gives, 64 bits by whatever name the platform has for them; -1: true */
typedef __typeof__((real){0.0} > (real){0.0}) mask_t;
typedef mask_t whole_t;

#define EVERY(condition) (__builtin_reduce_and(condition) != 0)
#define ANY(condition) (__builtin_reduce_or(condition) != 0)
#define PICK(condition, yes, no) ((condition) ? (real)(yes) : (real)(no))
#define NOT(condition) (~(condition))
#define FIRST(x) ((x)[0]) /* of what is the same in all lanes */
#define WHOLE(x) (__builtin_convertvector(x, whole_t))
#define REAL(i) (__builtin_convertvector(i, real))
#define ONE_WHERE(condition) (-(condition))

#endif

/* The same in every lane. */
static inline mask_t everywhere(bool yes) {
    const mask_t none = {0};
    return yes ? NOT(none) : none;
}

static inline whole_t words_of(real x) {
    whole_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline real of_words(whole_t bits) {
    real x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

#if LANES == 1

static inline real root(real x) { return sqrt(x); }
static inline real size_of(real x) { return fabs(x); }
static inline real with_sign(real x, real sign) { return copysign(x, sign); }

#else

static inline real root(real x) {
#if __has_builtin(__builtin_elementwise_sqrt)
    return __builtin_elementwise_sqrt(x);
#else
    for (int i = 0; i < LANES; i++) x[i] = sqrt(x[i]);
    return x;
#endif
}

static inline real size_of(real x) { return of_words(words_of(x) & INT64_MAX); }

static inline real with_sign(real x, real sign) {
    return of_words((words_of(x) & INT64_MAX) | (words_of(sign) & INT64_MIN));
}

#endif

/* The larger and the smaller; b where a is not a number. */
static inline real larger(real a, real b) { return PICK(a > b, a, b); }
static inline real smaller(real a, real b) { return PICK(a < b, a, b); }

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

#endif
