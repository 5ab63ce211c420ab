/* Steps of the explicit method of order 8 of Dormand and Prince over y' = f(t, y).

   Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.5 and II.10. The coefficients come from Python;
   a row of a table ends where its next row begins. */
#include "core.h"

enum { STAGES = 12, ALL = 16, STUCK = 1000 };

typedef struct { const I *row, *column; const double *value; } Coefficients; /* of row i: row[i] <= k < row[i + 1] */

typedef struct {
  const Equations *e;
  Coefficients stages, errors, dense;       /* (ALL, ALL), orders 5 and 3 (2, 13), rows 3 to 6 of the interpolant (4, ALL) */
  const double *c, *nodes, *atol; I inner;  /* (ALL,), (inner,) parts of a step at which the interpolant is stored, (n,) */
  double rtol, h, longest;                  /* next step, and the longest that may be taken */
  double *K, *y, *next, *F;                 /* (ALL, n), (n,), (n,), (8, n) */
  I evaluations, rejected, after_rejection;
} Explicit;

static int stage(Explicit *x, double t, double h, I i, double *out) {
  I n = x->e->n;
  const I *row = x->stages.row;
  memcpy(x->next, x->y, sizeof(double) * (size_t)n);
  for (I k = row[i]; k < row[i + 1]; k++) {
    double a = h * x->stages.value[k];
    const double *rate = x->K + x->stages.column[k] * n;
    for (I j = 0; j < n; j++) x->next[j] += a * rate[j];
  }
  x->evaluations++;
  int code = x->e->rates(x->e->self, t + x->c[i] * h, x->next, out);
  return code < 0 ? RAISED : code > 0 || !all_finite(out, n);
}

/* Error of the step in units of the tolerance: the estimate of order 5, weakened by that of order 3. */
static double error_of(const Explicit *x, double h) {
  I n = x->e->n;
  double sum[2] = {0, 0};
  for (I j = 0; j < n; j++) {
    double largest = fmax(fabs(x->y[j]), fabs(x->next[j])), weight = x->atol[j] + x->rtol * largest;
    for (int i = 0; i < 2; i++) {
      double error = 0;
      for (I k = x->errors.row[i]; k < x->errors.row[i + 1]; k++) error += x->errors.value[k] * x->K[x->errors.column[k] * n + j];
      sum[i] += error / weight * (error / weight);
    }
  }
  double below = sum[0] + 0.01 * sum[1];
  return below > 0 ? fabs(h) * sum[0] / sqrt(below * (double)n) : 0;
}

/* Increments at the inner nodes of the step from y to end, by the interpolant of order 7. */
static int interpolate(Explicit *x, double t, double h, const double *end, double *out) {
  I n = x->e->n;
  for (I i = STAGES + 1; i < ALL; i++) {
    int code = stage(x, t, h, i, x->K + i * n);
    if (code) return code;
  }
  const double *first = x->K, *last = x->K + STAGES * n;
  double *F = x->F;
  for (I j = 0; j < n; j++) {
    double d = end[j] - x->y[j];
    F[j] = d;
    F[n + j] = h * first[j] - d;
    F[2 * n + j] = 2 * d - h * (last[j] + first[j]);
    for (I i = 0; i < 4; i++) {
      double sum = 0;
      for (I k = x->dense.row[i]; k < x->dense.row[i + 1]; k++) sum += x->dense.value[k] * x->K[x->dense.column[k] * n + j];
      F[(3 + i) * n + j] = h * sum;
    }
  }
  for (I k = 0; k < x->inner; k++)
    for (I j = 0; j < n; j++) {
      double part = x->nodes[k], sum = 0;
      for (I i = 7; i-- > 0;) sum = (sum + F[i * n + j]) * (i % 2 ? 1 - part : part);
      out[k * n + j] = sum;
    }
  return DONE;
}

/* One accepted step from t; y and K's first row are those at its beginning, and at its end afterwards. end: where no step goes
   beyond. Returns DONE, RAISED or STUCK; *t is the end of the step. */
static int one_step(Explicit *x, double *t, double end, double *inner) {
  I n = x->e->n;
  for (;;) {
    double h = fmin(x->h, x->longest);
    if (*t + 1.01 * h >= end) h = end - *t;
    if (!(*t + h > *t)) return STUCK;
    int code = DONE;
    for (I i = 1; i <= STAGES && !code; i++) code = stage(x, *t, h, i, x->K + i * n);
    if (code == RAISED) return RAISED;
    double error = code ? INFINITY : error_of(x, h);
    if (!(error < 1)) {
      x->h = h * (isfinite(error) ? fmax(0.2, 0.9 * pow(error, -0.125)) : 0.2);
      x->rejected++;
      x->after_rejection = 1;
      continue;
    }
    double *reached = x->F + 7 * n; /* `next` serves the stages of the interpolant */
    memcpy(reached, x->next, sizeof(double) * (size_t)n);
    code = interpolate(x, *t, h, reached, inner);
    if (code == RAISED) return RAISED;
    if (code) { /* the step stands, its interpolant does not: a shorter one */
      x->h = 0.5 * h;
      x->rejected++;
      continue;
    }
    double factor = error > 0 ? fmin(10, 0.9 * pow(error, -0.125)) : 10;
    if (x->after_rejection) factor = fmin(1, factor);
    x->h = fmax(factor * h, h < x->h && factor >= 1 ? x->h : 0); /* a step cut by the end says little of the next one */
    x->after_rejection = 0;
    *t = h == end - *t ? end : *t + h;
    memcpy(x->y, reached, sizeof(double) * (size_t)n);
    memcpy(x->K, x->K + STAGES * n, sizeof(double) * (size_t)n);
    return DONE;
  }
}

/* Steps from `from` to `end`, until there is no room for more, more than `most` evaluations were made, or `seconds` are over.
   Row m of t, Y, Yp and inner (inner nodes, n) belongs to step m; *made: how many there are. */
API int explicit_steps(Explicit *x, double from, double end, double most, double seconds, I room, double *t, double *Y, double *Yp,
                       double *inner, I *made) {
  I n = x->e->n;
  size_t size = sizeof(double) * (size_t)n;
  double begin = clock_s();
  for (*made = 0; *made < room && from < end;) {
    int code = one_step(x, &from, end, inner + *made * x->inner * n);
    if (code) return code;
    t[*made] = from;
    memcpy(Y + *made * n, x->y, size);
    memcpy(Yp + *made * n, x->K, size);
    ++*made;
    if ((double)x->evaluations > most || clock_s() - begin > seconds) break;
  }
  return DONE;
}
