/* What the parts of the native core share. Arrays belong to Python, which checks their sizes where it makes the tables
   and keeps them alive; nothing is allocated here. */
#ifndef MBDAE_CORE_H
#define MBDAE_CORE_H
#if !defined(_WIN32)
#define _POSIX_C_SOURCE 199309L /* clock_gettime */
#endif
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <time.h>
#if defined(_WIN32)
/* of windows.h, which takes the names `near` and `far` for itself */
__declspec(dllimport) unsigned long long __stdcall GetTickCount64(void);
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif
/* Loops over numbers, compiled for wide registers too; the processor decides when the library is opened. Numbers are the same. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif
typedef int64_t I;

/* Results of a call. Positive: the numbers cannot be computed there (a method may shorten its step and try again);
   negative: Python raised an exception in a call back, which its caller keeps. */
enum { DONE = 0, NOT_FINITE = 1, SINGULAR = 2, RAISED = -1 };

/* F(t, y, y') = 0 as the methods of integration call it. Where a member is NULL the equations do not have it.
   The Jacobian comes as the data (nnz,) of a pattern by columns that the caller has; a dense one has n * n entries, column by
   column. `rates` fills out with y' of y' = f(t, y), `rate_jacobian` with df/dy (n, n), column by column, at yp = f(t, y). */
typedef struct {
  void *self;
  I n, nnz;
  int (*residual)(void *self, double t, const double *y, const double *yp, double *out);
  int (*jacobian)(void *self, double t, const double *y, const double *yp, double *fy, double *fyp);
  int (*rates)(void *self, double t, const double *y, double *out);
  int (*rate_jacobian)(void *self, double t, const double *y, const double *yp, double *out);
} Equations;

/* y' = f(t, y) of n unknowns with its derivatives at stage `at` of a method, which `value` evaluates first: `along` fills out (n,
   columns) with the changes of f for changes dy (n, columns) of y and for those of the numbers by which one differentiates; `back`
   fills out (n) with the weights of y for weights (n) of f, and adds up those of the numbers. */
typedef struct {
  void *self;
  I n, columns;
  int (*value)(void *self, I at, double t, const double *y, double *out);
  int (*along)(void *self, I at, const double *dy, double *out);
  int (*back)(void *self, I at, const double *weight, double *out);
} Twin;

/* Derivatives of a list of operations (Twins of evaluation.c) at k states, rows of y (k, n) and y' each, numbered from `first` on: by
   the numbers alone (count, columns), where no weights (k, count) of the results are given, else (n) the weights of y. */
API int twins_states(void *self, I first, I k, const double *t, const double *y, const double *yp, const double *weights, double *out);

/* How long a step may be because of inputs of time: `share` of the stretch between two edges in which it begins and, where it
   reaches into the next one, the same share of that. No edges: no bound. No step goes beyond a kink. */
typedef struct { const double *edges; I count; double share; const double *kinks; I kink_count; } Stretches;

/* From t to the first kink after it; one that is as near as round-off is passed. */
static inline double to_kink(const Stretches *s, double t) {
  if (!s->kink_count) return INFINITY;
  const double last = s->kinks[s->kink_count - 1], passed = t + 1e3 * 2.220446049250313e-16 * fmax(fabs(t), fabs(last));
  if (passed >= last) return INFINITY;
  I low = -1, high = s->kink_count - 1; /* kinks[low] <= passed < kinks[high] */
  while (high - low > 1) {
    const I middle = (low + high) / 2;
    if (s->kinks[middle] <= passed) low = middle;
    else high = middle;
  }
  return s->kinks[high] - t;
}

static inline double longest_of_stretches(const Stretches *s, double t) {
  if (s->count < 2) return INFINITY;
  I low = 0, high = s->count - 1; /* edges[low] <= t < edges[high], but for a time outside of them */
  while (high - low > 1) {
    const I middle = (low + high) / 2;
    if (s->edges[middle] <= t) low = middle;
    else high = middle;
  }
  const double a = s->edges[low], b = s->edges[high], whole = s->share * (b - a);
  return high == s->count - 1 ? whole : fmin(whole, b - t + s->share * (t - a) / (b - a) * (s->edges[high + 1] - b));
}

static inline double longest_step(const Stretches *s, double t) { return fmin(longest_of_stretches(s, t), to_kink(s, t)); }

static inline int all_finite(const double *x, I n) {
  for (I i = 0; i < n; i++)
    if (!isfinite(x[i])) return 0;
  return 1;
}

/* Time from an arbitrary begin, s, on a clock that nobody sets: a call that ends by the time of day would go on for ever where that
   is set back. */
static inline double clock_s(void) {
#if defined(_WIN32)
  return 1e-3 * (double)GetTickCount64();
#else
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#endif
}
#endif
