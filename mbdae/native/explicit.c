/* Steps of the explicit method of order 8 of Dormand and Prince over y' = f(t, y).

   Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.5 and II.10. The coefficients come from Python;
   a row of a table ends where its next row begins. */
#include <float.h>
#include "core.h"

enum { STAGES = 12, ALL = 16, STUCK = 1000, FIRST = 2 };

/* Shortest step after a rejection, over the time: shorter ones are round-off of the time, and would go on for ever where the
   equations end. */
static const double SHORTEST = 10 * DBL_EPSILON;

/* Error of a first step, over the tolerance. Where a motion begins at rest, terms that the estimate sees cancel in the first step:
   such steps were up to 3 times as long as those after them, and forces within them, by the interpolant, 15 times as far off. */
static const double BEGIN = 1e-4;

typedef struct { const I *row, *column; const double *value; } Coefficients; /* of row i: row[i] <= k < row[i + 1] */

typedef struct {
  const Equations *e;
  Coefficients stages, errors, dense;       /* (ALL, ALL), orders 5 and 3 (2, 13), rows 3 to 6 of the interpolant (4, ALL) */
  const double *c, *nodes, *atol; I inner;  /* (ALL,), (inner,) parts of a step at which the interpolant is stored, (n,) */
  double rtol, h, longest; Stretches stretches; /* next step, and what bounds it */
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

/* Coefficients F of the interpolant of order 7 over the step from y to end. */
static int interpolant(Explicit *x, double t, double h, const double *end) {
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
  return DONE;
}

/* What y has grown by after a part of the step. */
static void inside(const Explicit *x, double part, double *out) {
  I n = x->e->n;
  for (I j = 0; j < n; j++) {
    double sum = 0;
    for (I i = 7; i-- > 0;) sum = (sum + x->F[i * n + j]) * (i % 2 ? 1 - part : part);
    out[j] = sum;
  }
}

/* One accepted step from t; y and K's first row are those at its beginning, and at its end afterwards. end: where no step goes
   beyond. out: takes the increments at the nodes, or where `times` (ending with infinity) are given y at those within the step; its
   last stages are evaluated where something is taken. Returns DONE, RAISED or STUCK; *t is the end of the step, *taken how many. */
static int one_step(Explicit *x, double *t, double end, const double *times, double *out, I *taken) {
  I n = x->e->n;
  for (;;) {
    double h = fmin(x->h, fmin(x->longest, longest_step(&x->stretches, *t)));
    if (*t + (h < x->longest ? 1.01 : 1) * h >= end) h = end - *t;
    if (!(*t + h > *t)) return STUCK;
    int code = DONE;
    for (I i = 1; i <= STAGES && !code; i++) code = stage(x, *t, h, i, x->K + i * n);
    if (code == RAISED) return RAISED;
    double error = code ? INFINITY : error_of(x, h), over = error / (x->after_rejection == FIRST ? BEGIN : 1);
    if (!(over < 1)) {
      x->h = h * (isfinite(over) ? fmax(0.2, 0.9 * pow(over, -0.125)) : 0.2);
      x->rejected++;
      if (x->after_rejection != FIRST) x->after_rejection = 1;
      if (x->h < SHORTEST * fabs(*t)) return STUCK;
      continue;
    }
    double *reached = x->F + 7 * n; /* `next` serves the stages of the interpolant */
    memcpy(reached, x->next, sizeof(double) * (size_t)n);
    double later = h == end - *t ? end : *t + h;
    code = times && !(*times < later) ? DONE : interpolant(x, *t, h, reached);
    if (code == RAISED) return RAISED;
    if (code) { /* the step stands, its interpolant does not: a shorter one */
      x->h = 0.5 * h;
      x->rejected++;
      if (x->h < SHORTEST * fabs(*t)) return STUCK;
      continue;
    }
    double factor = error > 0 ? fmin(10, 0.9 * pow(error, -0.125)) : 10;
    if (x->after_rejection == 1) factor = fmin(1, factor);
    x->h = fmax(factor * h, h < x->h && factor >= 1 ? x->h : 0); /* a step cut by the end says little of the next one */
    x->after_rejection = 0;
    for (*taken = 0; times ? times[*taken] < later : *taken < x->inner; ++*taken, out += n) {
      inside(x, times ? (times[*taken] - *t) / h : x->nodes[*taken], out);
      for (I j = 0; times && j < n; j++) out[j] += x->y[j];
    }
    for (; times && times[*taken] == later; ++*taken, out += n) memcpy(out, reached, sizeof(double) * (size_t)n);
    *t = later;
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
    I taken;
    int code = one_step(x, &from, end, NULL, inner + *made * x->inner * n, &taken);
    if (code) return code;
    t[*made] = from;
    memcpy(Y + *made * n, x->y, size);
    memcpy(Yp + *made * n, x->K, size);
    ++*made;
    if ((double)x->evaluations > most || clock_s() - begin > seconds) break;
  }
  return DONE;
}

/* Root mean square of v in units of the tolerance at y. */
static double size_of(const Explicit *x, const double *v) {
  double sum = 0;
  for (I j = 0; j < x->e->n; j++) {
    double part = v[j] / (x->atol[j] + x->rtol * fabs(x->y[j]));
    sum += part * part;
  }
  return sqrt(sum / (double)x->e->n);
}

/* A first step by the sizes of y, y' and a difference quotient of y' (Hairer, Norsett, Wanner, II.4); K's first row is y'. */
API int explicit_begin(Explicit *x, double t, double span) {
  I n = x->e->n;
  double *rate = x->K, *later = x->K + n;
  x->after_rejection = FIRST;
  x->evaluations += 2;
  int code = x->e->rates(x->e->self, t, x->y, rate);
  if (code) return code;
  double size = size_of(x, x->y), speed = size_of(x, rate);
  double h = fmin(span, fmin(size, speed) > 1e-5 ? 0.01 * size / speed : 1e-6 * span);
  for (I j = 0; j < n; j++) x->next[j] = x->y[j] + h * rate[j];
  code = x->e->rates(x->e->self, t + h, x->next, later);
  if (code < 0) return RAISED;
  for (I j = 0; j < n; j++) later[j] -= rate[j];
  double change = code ? NAN : size_of(x, later) / h, steepest = isfinite(change) ? fmax(speed, change) : speed;
  x->h = fmin(fmin(100 * h, span), steepest > 1e-15 ? pow(0.01 * BEGIN / steepest, 0.125) : fmax(1e-6 * span, 1e-3 * h));
  return isfinite(speed) ? DONE : NOT_FINITE;
}

/* Runs of the same equations from `from` to `end`, one behind the other: row i of starts (points, n), and of numbers (points,
   width), which go to `slots` of W. times: of the outputs, then infinity; row i of out is (times, n). *code, steps, rejected and
   evaluations have an entry for every point. A point that fails ends, the next one begins. */
typedef struct {
  I points, width, outputs, point, begun, taken;
  double from, end, t;
  const double *starts, *numbers, *times; const I *slots;
  double *W, *out, *last;
  I *code, *steps, *rejected, *evaluations;
} Batch;

/* Go on for so many seconds, and to the end of a point where a call back raised. */
API int explicit_batch(Explicit *x, Batch *b, double seconds) {
  size_t size = sizeof(double) * (size_t)x->e->n;
  double begin = clock_s();
  for (int code = DONE; code >= 0 && b->point < b->points; b->point++) {
    I n = x->e->n, i = b->point;
    double *out = b->out + i * b->outputs * n;
    code = DONE;
    if (!b->begun) {
      for (I k = 0; k < b->width; k++) b->W[b->slots[k]] = b->numbers[i * b->width + k];
      memcpy(x->y, b->starts + i * n, size);
      x->evaluations = x->rejected = b->steps[i] = b->taken = 0;
      for (b->t = b->from; b->times[b->taken] == b->from; b->taken++) memcpy(out + b->taken * n, x->y, size);
      code = explicit_begin(x, b->from, b->end - b->from);
    }
    for (b->begun = 1; !code && b->t < b->end;) {
      I taken;
      code = one_step(x, &b->t, b->end, b->times + b->taken, out + b->taken * n, &taken);
      if (code) break;
      b->steps[i]++;
      b->taken += taken;
      if (b->t < b->end && clock_s() - begin > seconds) return DONE;
    }
    b->begun = 0;
    b->code[i] = code;
    b->rejected[i] = x->rejected;
    b->evaluations[i] = x->evaluations;
    memcpy(b->last + i * n, x->y, size);
  }
  return DONE;
}

/* The derivatives of a run along its steps, which are constants of the derivative. A (ALL, ALL), c (ALL,): the stages; the step ends
   at stage STAGES; B (inner, ALL): increments at the inner nodes over h. side: takes the time at which conditions of inputs are
   read, inside the step. K, x: room for (ALL, n), (n); dK, dx: the same for every column, or for weights. */
typedef struct {
  const Twin *f;
  I inner;
  const double *A, *c, *B;
  double *side, *K, *x, *dK, *dx;
} Path;

/* to = from + h sum_k a[k] rates[k] */
WIDE static void combine(I n, const double *restrict from, double h, const double *restrict a, I count, const double *restrict rates,
                         double *restrict to) {
  memcpy(to, from, sizeof(double) * (size_t)n);
  for (I k = 0; k < count; k++)
    for (I j = 0; a[k] != 0 && j < n; j++) to[j] += h * a[k] * rates[k * n + j];
}

/* The stages of step m of m + 1 or more times t and states y (n); their number `at` counts from the first step. */
static int stage_of(const Path *p, I m, I s, const double *t, const double *y) {
  const double h = t[m + 1] - t[m];
  *p->side = t[m] + h / 2;
  combine(p->f->n, y + m * p->f->n, h, p->A + s * ALL, s, p->K, p->x);
  return p->f->value(p->f->self, m * ALL + s, t[m] + p->c[s] * h, p->x, p->K + s * p->f->n);
}

/* S (steps + 1, n, columns): derivatives of y, the first row given; inner (steps, inner, n, columns): increments at the inner
   nodes; reached (steps, n): where the repeated steps end. */
API int explicit_along(const Path *p, I steps, const double *t, const double *y, double *reached, double *S, double *inner) {
  const I n = p->f->n, size = n * p->f->columns;
  for (I m = 0; m < steps; m++) {
    const double h = t[m + 1] - t[m];
    for (I s = 0; s < ALL; s++) {
      int code = stage_of(p, m, s, t, y);
      if (code) return code;
      combine(size, S + m * size, h, p->A + s * ALL, s, p->dK, p->dx);
      if (s == STAGES) {
        memcpy(reached + m * n, p->x, sizeof(double) * (size_t)n);
        memcpy(S + (m + 1) * size, p->dx, sizeof(double) * (size_t)size);
      }
      code = p->f->along(p->f->self, m * ALL + s, p->dx, p->dK + s * size);
      if (code) return code;
    }
    memset(p->dx, 0, sizeof(double) * (size_t)size);
    for (I j = 0; j < p->inner; j++)
      combine(size, p->dx, h, p->B + j * ALL, ALL, p->dK, inner + (m * p->inner + j) * size);
  }
  return DONE;
}

/* total (n): weights of y at the end, then at the beginning; ends (steps, n): those of y at the beginning of every step, added on
   the way; inner (steps, inner, n): those of the increments at the inner nodes. */
API int explicit_back(const Path *p, I steps, const double *t, const double *y, double *reached, const double *ends,
                      const double *inner, double *total) {
  const I n = p->f->n;
  for (I m = steps; m-- > 0;) {
    const double h = t[m + 1] - t[m], *own = inner + m * p->inner * n;
    I stages = STAGES;
    for (I k = 0; k < p->inner * n; k++)
      if (own[k] != 0) stages = ALL;
    for (I s = 0; s < stages; s++) {
      int code = stage_of(p, m, s, t, y);
      if (code) return code;
    }
    combine(n, y + m * n, h, p->A + STAGES * ALL, STAGES, p->K, reached + m * n);
    for (I s = 0; s < ALL; s++)
      for (I j = 0; j < n; j++) {
        double sum = p->A[STAGES * ALL + s] * total[j];
        for (I i = 0; i < p->inner; i++) sum += p->B[i * ALL + s] * own[i * n + j];
        p->dK[s * n + j] = h * sum;
      }
    for (I s = stages; s-- > 0;) {
      int code = p->f->back(p->f->self, m * ALL + s, p->dK + s * n, p->x);
      if (code) return code;
      for (I j = 0; j < n; j++) total[j] += p->x[j];
      for (I k = 0; k < s; k++)
        for (I j = 0; p->A[s * ALL + k] != 0 && j < n; j++) p->dK[k * n + j] += h * p->A[s * ALL + k] * p->x[j];
    }
    for (I j = 0; j < n; j++) total[j] += ends[m * n + j];
  }
  return DONE;
}
