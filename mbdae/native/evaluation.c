/* Evaluation of a scene: a list of operations on one array of numbers W, whose places are called slots.

   Its first slots are y, y', the motion of bodies moved by recursive joints, values prescribed in time and constants; behind
   them stand the inputs and values of kernels, the rows of F and the entries of the Jacobian. Kernels are compiled by
   symengine; which slots they read and where their values belong comes from Python as tables. */
#include "core.h"

typedef void (*Kernel)(double *out, const double *in, void *data);

/* What an operation does, for each of `times` instances r:
   CALL      a kernel at one point: `inputs` numbers W[from[r * inputs + j]], values to W[first + r * outputs]
   LOAD      W[first ...] = weight[0 ... count)
   SET       W[to[k] + r to_step] = W[from[k] + r from_step]
   ADD       W[to[k] + r to_step] += weight[k + r weight_step] W[from[k] + r from_step]
   MULTIPLY  W[to[k] + r to_step] += weight[k] W[from[k] + r from_step] W[by[k] + r by_step]
   CHOLESKY  factors in place of the symmetric band matrix (count, inputs) at `first`, solves for W[outputs ...) in place
   SOLVE     solves with these factors for `times` further right-hand sides at W[outputs + r * count ...)
   LU        solves with the full matrix (count, count), row by row, at `first`, for `times` right-hand sides at
             W[outputs + r * count ...); the matrix is overwritten
   POSITIVE  ends with SINGULAR unless every W[from[k]] > 0
   PASS      CALL, and its first `count` values are added to W[to[r * count + k]] before the next instance, which may read them
   LOOKUP    a table of `count` points (weight) at x = a W[inputs] + b, on the side of a W[outputs] + b: its value and first two
             derivatives to W[first ...); behind them the segment last found, a and b */
enum { CALL, LOAD, SET, ADD, MULTIPLY, CHOLESKY, SOLVE, LU, POSITIVE, PASS, LOOKUP };

typedef struct {
  I kind, times, count, first, inputs, outputs, to_step, from_step, by_step, weight_step;
  const I *to, *from, *by;
  const double *weight;
  void *function, *data;
} Operation;

typedef struct { const Operation *first; I count; } Part;

#include "factors.inc"
#include "lookup.inc"

/* Run the operations; x: room for the inputs of the widest; bad: the row of a matrix that depends on the others. */
static int run(Part part, double *W, double *x, I *bad) {
  if (!part.first) return NOT_FINITE; /* not made: nothing is computed */
  for (const Operation *a = part.first; a < part.first + part.count; a++) {
    const I *to = a->to, *from = a->from, *by = a->by;
    const double *weight = a->weight;
    switch (a->kind) {
    case CALL:
      for (I r = 0; r < a->times; r++, from += a->inputs) {
        for (I j = 0; j < a->inputs; j++) x[j] = W[from[j]];
        ((Kernel)a->function)(W + a->first + r * a->outputs, x, a->data);
      }
      break;
    case PASS:
      for (I r = 0; r < a->times; r++, from += a->inputs, to += a->count) {
        double *values = W + a->first + r * a->outputs;
        for (I j = 0; j < a->inputs; j++) x[j] = W[from[j]];
        ((Kernel)a->function)(values, x, a->data);
        for (I k = 0; k < a->count; k++) W[to[k]] += values[k];
      }
      break;
    case LOAD:
      memcpy(W + a->first, weight, sizeof(double) * (size_t)a->count);
      break;
    case SET:
      for (I r = 0; r < a->times; r++)
        for (I k = 0; k < a->count; k++) W[to[k] + r * a->to_step] = W[from[k] + r * a->from_step];
      break;
    case ADD:
      for (I r = 0; r < a->times; r++, weight += a->weight_step)
        for (I k = 0; k < a->count; k++) W[to[k] + r * a->to_step] += weight[k] * W[from[k] + r * a->from_step];
      break;
    case MULTIPLY:
      for (I r = 0; r < a->times; r++)
        for (I k = 0; k < a->count; k++)
          W[to[k] + r * a->to_step] += weight[k] * W[from[k] + r * a->from_step] * W[by[k] + r * a->by_step];
      break;
    case CHOLESKY:
      *bad = band_factors(a->count, a->inputs, W + a->first);
      if (*bad >= 0) return SINGULAR;
      band_solve(a->count, a->inputs, W + a->first, W + a->outputs);
      break;
    case SOLVE:
      for (I r = 0; r < a->times; r++) band_solve(a->count, a->inputs, W + a->first, W + a->outputs + r * a->count);
      break;
    case LU:
      *bad = full_solve(a->count, a->times, W + a->first, W + a->outputs);
      if (*bad >= 0) return SINGULAR;
      break;
    case POSITIVE:
      for (*bad = 0; *bad < a->count; ++*bad)
        if (!(W[from[*bad]] > 0)) return SINGULAR;
      *bad = -1;
      break;
    case LOOKUP: {
      double *out = W + a->first;
      lookup(weight, a->count, out[4] * W[a->inputs] + out[5], out[4] * W[a->outputs] + out[5], out);
      break;
    }
    }
  }
  return DONE;
}

/* The equations of a scene with n unknowns, whose derivatives begin at slot `dotted`. at: slots of the time and of the time at
   which conditions of inputs are read. explicit: whether F = y' - f(t, y), without a list for the residual. changes: where they are
   given, the derivative along a direction of the residual, or of f, for a full Jacobian; the differential of slot k is in slot
   k + distance. read: that time, NaN where it follows from the time, and the end of the run, after which
   nothing is read. */
typedef struct {
  double *W, *x;
  I n, dotted, nnz, rows, fy, fyp, rates, at, bad, distance, explicit;
  const double *read;
  double t, side;
  Part clock, residual, jacobian, of_rates, changes;
} Scene;

static double next_after(double t) { return t + 4 * (nextafter(fabs(t), INFINITY) - fabs(t)); }

/* Copies n numbers, unless they are in place. */
static void copy(double *to, const double *from, I n) {
  if (n && to != from) memcpy(to, from, sizeof(double) * (size_t)n);
}

static int scene_fill(Scene *s, double t, const double *y, const double *yp) {
  copy(s->W, y, s->n);
  if (yp) copy(s->W + s->dotted, yp, s->n);
  else memset(s->W + s->dotted, 0, sizeof(double) * (size_t)s->n);
  if (!s->clock.count) return DONE;
  double side = s->read[0], end = s->read[1];
  if (isnan(side)) side = isinf(end) ? next_after(t) : fmin(next_after(t), 2 * end - next_after(end));
  if (t == s->t && side == s->side) return DONE; /* a Newton iteration asks at the same time again */
  s->W[s->at] = s->t = t;
  s->W[s->at + 1] = s->side = side;
  return run(s->clock, s->W, s->x, &s->bad);
}

API int scene_rates(void *self, double t, const double *y, double *out) {
  Scene *s = self;
  int code = scene_fill(s, t, y, NULL);
  if (!code) code = run(s->of_rates, s->W, s->x, &s->bad);
  copy(out, s->W + s->rates, s->n);
  return code;
}

API int scene_residual(void *self, double t, const double *y, const double *yp, double *out) {
  Scene *s = self;
  if (s->explicit) {
    copy(out, yp, s->n); /* first, because the slots of y', where yp may be, are set to 0 */
    int code = scene_rates(self, t, y, s->W + s->rates);
    for (I i = 0; i < s->n; i++) out[i] -= s->W[s->rates + i];
    return code;
  }
  int code = scene_fill(s, t, y, yp);
  if (!code) code = run(s->residual, s->W, s->x, &s->bad);
  copy(out, s->W + s->rows, s->n);
  return code;
}

/* The full Jacobian column by column, by the derivatives along unit directions, after the residual or f. */
static int columns(Scene *s, double *fy, double *fyp) {
  int code = DONE;
  for (I by = 0; by < 2; by++) {
    double *seed = s->W + s->distance + by * s->dotted, *out = by ? fyp : fy;
    const double *found = s->W + s->distance + (s->explicit ? s->rates : s->rows), sign = s->explicit ? -1 : 1;
    for (I j = 0; j < s->n && !code; j++, out += s->n) {
      if (by && s->explicit) {
        memset(out, 0, sizeof(double) * (size_t)s->n);
        out[j] = 1;
        continue;
      }
      seed[j] = 1;
      code = run(s->changes, s->W, s->x, &s->bad);
      seed[j] = 0;
      for (I i = 0; i < s->n; i++) out[i] = sign * found[i];
    }
  }
  return code;
}

API int scene_jacobian(void *self, double t, const double *y, const double *yp, double *fy, double *fyp) {
  Scene *s = self;
  int code = scene_fill(s, t, y, s->explicit ? NULL : yp);
  if (!code) code = run(s->explicit ? s->of_rates : s->changes.first ? s->residual : s->jacobian, s->W, s->x, &s->bad);
  if (s->changes.first) return code ? code : columns(s, fy, fyp);
  copy(fy, s->W + s->fy, s->nnz);
  copy(fyp, s->W + s->fyp, s->nnz);
  return code;
}

/* A part alone, for instance the guards of contacts, at a state that is filled in first. */
API int scene_part(Scene *s, const Part *part, double t, const double *y, const double *yp) {
  int code = scene_fill(s, t, y, yp);
  return code ? code : run(*part, s->W, s->x, &s->bad);
}

/* `count` numbers that the residual leaves, at k states, one row of y (k, stride) and y', or NULL, each. */
API int scene_values(Scene *s, I k, const double *t, const double *y, const double *yp, I stride, I count, double *out) {
  int code = DONE;
  for (I i = 0; i < k && !code; i++) {
    code = scene_part(s, &s->residual, t[i], y + i * stride, yp ? yp + i * stride : NULL);
    memcpy(out + i * count, s->W + s->rows, sizeof(double) * (size_t)count);
  }
  return code;
}

/* The residual at k points, one row of y (k, n), y' and out each. */
API int scene_residuals(Scene *s, I k, const double *t, const double *y, const double *yp, double *out) {
  int code = DONE;
  for (I i = 0; i < k && code >= 0; i++) code = scene_residual(s, t[i], y + i * s->n, yp + i * s->n, out + i * s->n);
  return code;
}

/* The Jacobian at k points, one row of y (k, n) and y' each; fy and fyp (k, nnz). */
API int scene_jacobians(Scene *s, I k, const double *t, const double *y, const double *yp, double *fy, double *fyp) {
  int code = DONE;
  for (I i = 0; i < k && !code; i++)
    code = scene_jacobian(s, t[i], y + i * s->n, yp + i * s->n, fy + i * s->nnz, fyp + i * s->nnz);
  return code;
}

/* Values (k, n) of piecewise polynomials: for each, in step i of y and `ends` (m, n) and increments `inner` (m, s - 1, n), the sum
 * of the increments with weights w (s), that to the end of the step last, and y where `from` is not 0. */
API void interpolated(I k, I n, I s, const I *steps, const double *w, I from, const double *y, const double *ends,
                      const double *inner, double *out) {
  for (I q = 0; q < k; q++, w += s, out += n) {
    const double *a = y + steps[q] * n, *b = ends + steps[q] * n, *z = inner + steps[q] * (s - 1) * n;
    for (I c = 0; c < n; c++) out[c] = (from ? a[c] : 0.0) + (b[c] - a[c]) * w[s - 1];
    for (I j = 0; j < s - 1; j++, z += n)
      for (I c = 0; c < n; c++) out[c] += w[j] * z[c];
  }
}

/* Derivatives of a list `value` with `count` results from slot `first` on, by its tangent `along` and its pullback `back`. The
   differential, or weight, of slot k is in slot k + width. Derivatives are by y, and by numbers, one a column: column c has the
   differentials seed[k] in the slots slot[k], column[c] <= k < column[c + 1], and prescribed (states, columns, clocks) in the slots
   of the clock. by_rows: changes along columns come from the pullbacks of all results, of those that are `fixed` once for all: J
   (count, n), G (count, columns). kept (room, width): slots of the last states, to which a pullback may go back, or NULL; of_clock
   (states, clocks): takes the weights of the clock, which the pullback does not add up. */
typedef struct {
  Scene *scene;
  Part value, along, back;
  I first, count, width, clock, clocks, columns, by_rows, known, room;
  const I *column, *slot;
  const double *seed, *prescribed;
  const char *fixed;
  double *J, *G, *kept, *of_clock;
} Twins;

/* Takes the weights of y and of the clock out of their slots. */
static void take_weights(Twins *x, double *of_y, double *of_clock) {
  const Scene *s = x->scene;
  double *d = s->W + x->width;
  copy(of_y, d, s->n);
  memset(d, 0, sizeof(double) * (size_t)s->n);
  memset(d + s->dotted, 0, sizeof(double) * (size_t)s->n);
  if (of_clock) copy(of_clock, d + x->clock, x->clocks);
  memset(d + x->clock, 0, sizeof(double) * (size_t)x->clocks);
}

API int twins_value(void *self, I at, double t, const double *y, double *out) {
  Twins *x = self;
  Scene *s = x->scene;
  int code = scene_part(s, &x->value, t, y, NULL);
  copy(out, s->W + x->first, x->count);
  if (x->kept) memcpy(x->kept + at % x->room * x->width, s->W, sizeof(double) * (size_t)x->width);
  return code ? code : !all_finite(out, x->count);
}

API int twins_back(void *self, I at, const double *weight, double *out) {
  Twins *x = self;
  Scene *s = x->scene;
  if (x->kept) {
    memcpy(s->W, x->kept + at % x->room * x->width, sizeof(double) * (size_t)x->width);
    s->t = NAN; /* the clock is another one */
  }
  copy(s->W + x->width + x->first, weight, x->count);
  int code = run(x->back, s->W, s->x, &s->bad);
  take_weights(x, out, x->of_clock ? x->of_clock + at * x->clocks : NULL);
  return code;
}

static int along_by_rows(Twins *x, const double *prescribed, const double *dy, double *out) {
  Scene *s = x->scene;
  const I n = s->n, P = x->columns;
  double *W = s->W, *d = W + x->width;
  int code = DONE;
  for (I i = 0; i < x->count && !code; i++) {
    double *G = x->G + i * P;
    const double *J = x->J + i * n;
    if (!(x->known && x->fixed[i])) {
      d[x->first + i] = 1;
      code = run(x->back, W, s->x, &s->bad);
      for (I c = 0; c < P; c++) {
        double sum = 0;
        for (I k = x->column[c]; k < x->column[c + 1]; k++) sum += x->seed[k] * W[x->slot[k]];
        for (I q = 0; q < x->clocks; q++) sum += prescribed[c * x->clocks + q] * d[x->clock + q];
        G[c] = sum;
      }
      for (I k = 0; k < x->column[P]; k++) W[x->slot[k]] = 0;
      take_weights(x, x->J + i * n, NULL);
    }
    copy(out + i * P, G, P);
    for (I j = 0; dy && j < n; j++)
      for (I c = 0; J[j] != 0 && c < P; c++) out[i * P + c] += J[j] * dy[j * P + c];
  }
  x->known = 1;
  return code;
}

/* dy: NULL where y does not change */
API int twins_along(void *self, I at, const double *dy, double *out) {
  Twins *x = self;
  Scene *s = x->scene;
  const I n = s->n, P = x->columns;
  const double *prescribed = x->clocks ? x->prescribed + at * P * x->clocks : NULL;
  double *W = s->W, *d = W + x->width;
  if (x->by_rows) return along_by_rows(x, prescribed, dy, out);
  int code = DONE;
  for (I c = 0; c < P && !code; c++) {
    for (I j = 0; dy && j < n; j++) d[j] = dy[j * P + c];
    for (I k = x->column[c]; k < x->column[c + 1]; k++) W[x->slot[k]] = x->seed[k];
    for (I q = 0; q < x->clocks; q++) d[x->clock + q] = prescribed[c * x->clocks + q];
    code = run(x->along, W, s->x, &s->bad);
    for (I i = 0; i < x->count; i++) out[i * P + c] = d[x->first + i];
    for (I k = x->column[c]; k < x->column[c + 1]; k++) W[x->slot[k]] = 0;
  }
  memset(d, 0, sizeof(double) * (size_t)n);
  memset(d + x->clock, 0, sizeof(double) * (size_t)x->clocks);
  return code;
}

API int twins_states(void *self, I first, I k, const double *t, const double *y, const double *yp, const double *weights,
                     double *out) {
  Twins *x = self;
  const I n = x->scene->n, width = weights ? n : x->count * x->columns;
  int code = DONE;
  for (I i = 0; i < k && !code; i++) {
    code = scene_part(x->scene, &x->value, t[i], y + i * n, yp + i * n);
    if (code) return code;
    code = weights ? twins_back(x, first + i, weights + i * x->count, out + i * width)
                   : twins_along(x, first + i, NULL, out + i * width);
  }
  return code;
}

/* A list alone, without filling in a state. */
API int twins_run(Twins *x, const Part *part) { return run(*part, x->scene->W, x->scene->x, &x->scene->bad); }
