/* What IDA and CVODE of SUNDIALS call over `Equations`, and the loop over their internal steps.
   SUNDIALS comes as addresses of its functions, which sundials.py fills in; its objects stay closed. */
#include "core.h"

typedef void *Closed; /* vector, matrix or memory of SUNDIALS: only its own functions look inside */

enum { INNER = 4, ONE_STEP = 2 }; /* nodes of Radau IIA with 5 stages inside a step; IDA_ONE_STEP and CV_ONE_STEP */
enum { STUCK = 1000 };            /* result of `sundials_steps`: the step fell below the round-off of the time */
enum { CONTINUE = 901, DIVERGES = 902 };      /* SUN_NLS_CONTINUE and SUN_NLS_CONV_RECVR */
static const double NEWTON = 0.1, UNCHANGED = 1e-4, SLOWEST = 0.9; /* see `ida_converged` */
static const double ROUND = 1e3 * 2.220446049250313e-16; /* a step is not made shorter than this part of the time */
enum { STEPS = 7, MANY = 3, LOW = 3, HELD = 24, HIGH = 5 };  /* see `raise_order` */
static const double LEADING = 0.03, WIDER = 1000;
static const double HELD_BY_BOUND = 0.85, AIMED = 0.3, NARROWS = 0.1, LEAST = 1e-30, NARROWEST = 1e-13; /* see `choose_order` */

/* One run; `Run` of sundials.py has the same members. */
typedef struct {
  const Equations *e;
  double *(*array)(Closed vector);
  double *(*data)(Closed matrix);
  void *(*columns)(Closed matrix), *(*rows)(Closed matrix);                    /* of a sparse matrix, else NULL */
  int (*ida)(Closed, double toward, double *t, Closed y, Closed yp, int task); /* IDASolve, NULL with CVODE */
  int (*cvode)(Closed, double toward, Closed y, double *t, int task);          /* CVode, NULL with IDA */
  int (*until)(Closed, double stop);                                           /* IDASetStopTime or CVodeSetStopTime */
  int (*interpolant)(Closed, double t, int derivative, Closed y);              /* CVodeGetDky, NULL with IDA */
  Closed memory, y_vector, yp_vector, inner_vector;
  const char *own_columns, *own_rows; I columns_bytes, rows_bytes; /* pattern; SUNDIALS wipes that of its matrix */
  const I *place;                                 /* (nnz,) where entries of a pattern belong in a dense matrix, or NULL */
  double *fy, *fyp;                               /* (nnz,) */
  const double *nodes, *atol; double rtol;        /* (INNER,), (n,) */
  double tame; I smooth;                          /* see `piece` */
  double most, toward;                            /* evaluations after which the loop ends; end of the run, s */
  I evaluations, rejected, jacobians;
  I choosing, renew, renewing, begun, fresh;             /* fresh: jacobian_t and jacobian_y are of a new Jacobian */
  double t, cj, *y, *yp, *values;                 /* the last point, and what was computed there */
  double jacobian_t, *jacobian_y;                 /* where the newest Jacobian was evaluated */
  double from_t, last_step; const double *from_y, *from_yp; /* the last accepted point and the step that led to it */
  double *inner; I pieces;                        /* pieces (INNER, n) one behind the other, and how many there are */
  int (*iteration)(Closed, int *);     /* SUNNonlinSolGetCurIter */
  double correction;                   /* size of the first correction of Newton's iteration, over the tolerance */
  int (*longest)(Closed, double), (*planned)(Closed, double *); /* SetMaxStep, GetCurrentStep */
  int (*errors)(Closed, Closed out), (*order)(Closed, int *);   /* GetEstLocalErrors; GetLastOrder of IDA, NULL: no `raise_order` */
  double *wider, unseen, narrow;       /* factors of the tolerances, (n,), of all: see `choose_order` */
  I low, before, held; double cap;     /* see `raise_order`; before: steps rejected before the first one of low order; cap: the
                                          longest step meanwhile, 0: there is none */
  Stretches stretches;                 /* longest steps by the inputs of time */
} Run;

/* An evaluation nearer than the last one: that attempt was rejected. Those that choose the first step are no attempts. */
static void counted(Run *r, double t) {
  if (t < r->t && !r->choosing) r->rejected++;
  r->t = t;
  r->evaluations++;
}

static int outcome(int code, const double *out, I n) { return code < 0 ? RAISED : code > 0 || !all_finite(out, n); }

API int ida_residual(double t, Closed y, Closed yp, Closed out, void *user) {
  Run *r = user;
  const Equations *e = r->e;
  const double *at = r->array(y), *slope = r->array(yp);
  double *F = r->array(out);
  size_t size = sizeof(double) * (size_t)e->n;
  counted(r, t);
  int code = e->residual(e->self, t, at, slope, F);
  memcpy(r->y, at, size);
  memcpy(r->yp, slope, size);
  memcpy(r->values, F, size);
  return outcome(code, F, e->n);
}

/* Convergence test of Newton's iteration in IDA: at least two iterations, until the error left is below NEWTON of the tolerance.
   IDA's own test ends after one iteration where the rate of convergence that an earlier step showed lets it, and lets a third
   of the tolerance pass; with a Jacobian that has grown old since, its noise fails error tests at high order, and three failures
   throw IDA back to order 1. Measured: transistor amplifier, rtol 1e-5 to 1e-9, 60 runs: 4 000 evaluations where IDA by itself
   takes 4 400 to 690 000; 9 mechanisms, rtol 1e-4 to 1e-8: 0.9 times the evaluations, 0.4 times the error (medians). */
API int ida_converged(Closed newton, Closed y, Closed change, double tolerance, Closed weights, void *user) {
  Run *r = user;
  int iteration = 0;
  const double *d = r->array(change), *w = r->array(weights);
  double size = 0;
  (void)y;
  for (I i = 0; i < r->e->n; i++) size += pow(d[i] * w[i] * r->wider[i], 2); /* of the tolerances that are not widened */
  size = sqrt(size / (double)r->e->n);
  r->iteration(newton, &iteration);
  if (!iteration) {
    r->correction = size;
    return size <= UNCHANGED * NEWTON ? DONE : CONTINUE;
  }
  double rate = pow(size / r->correction, 1.0 / iteration);
  if (!(rate <= SLOWEST)) return size <= tolerance ? DONE : DIVERGES; /* round-off, which IDA's own test lets pass too */
  return rate / (1 - rate) * size <= NEWTON ? DONE : CONTINUE;
}

API int ida_jacobian(double t, double cj, Closed y, Closed yp, Closed F, Closed J, void *user, Closed a, Closed b, Closed c) {
  Run *r = user;
  const Equations *e = r->e;
  double *out = r->data(J);
  (void)F, (void)a, (void)b, (void)c;
  r->jacobians++;
  r->cj = cj;
  int code = e->jacobian(e->self, t, r->array(y), r->array(yp), r->fy, r->fyp);
  if (code) return code;
  if (r->columns) {
    memcpy(r->columns(J), r->own_columns, (size_t)r->columns_bytes);
    memcpy(r->rows(J), r->own_rows, (size_t)r->rows_bytes);
  } else
    memset(out, 0, sizeof(double) * (size_t)(e->n * e->n));
  for (I k = 0; k < e->nnz; k++) out[r->place ? r->place[k] : k] = r->fy[k] + cj * r->fyp[k];
  return DONE;
}

/* The same by differences: column by column along (y_j, cj y'_j), so that what nearly cancels between dF/dy and cj dF/dy' does so
   in F itself, with the increments of IDA's own differences (1 / cj for the step). Those cannot be used: they grow with `wider`. */
API int ida_differences(double t, double cj, Closed Y, Closed Yp, Closed F, Closed J, void *user, Closed a, Closed b, Closed c) {
  Run *r = user;
  I n = r->e->n;
  double *out = r->data(J), *y = r->array(Y), *yp = r->array(Yp), *moved = r->array(a);
  const double *base = r->array(F);
  (void)b, (void)c;
  r->jacobians++;
  r->cj = cj;
  for (I j = 0; j < n; j++) {
    double kept = y[j], rate = yp[j], far = rate / cj, tolerance = r->rtol * fabs(kept) + r->atol[j];
    volatile double next = kept + copysign(fmax(0x1p-26 * fmax(fabs(kept), fabs(far)), tolerance), far);
    double step = next - kept;
    y[j] = next;
    yp[j] = rate + cj * step;
    int code = r->e->residual(r->e->self, t, y, yp, moved);
    y[j] = kept;
    yp[j] = rate;
    r->evaluations++;
    if ((code = outcome(code, moved, n))) return code;
    for (I i = 0; i < n; i++) out[j * n + i] = (moved[i] - base[i]) / step;
  }
  return DONE;
}

/* With `renew` the rate is not a number once, and wherever CVODE then asks for it at what is not a number: the only way to make
   CVODE ask for a new Jacobian before its Newton iteration fails; it then repeats the same step. A code > 0 would shorten it. */
API int cvode_rates(double t, Closed y, Closed out, void *user) {
  Run *r = user;
  const Equations *e = r->e;
  const double *at = r->array(y);
  double *rate = r->array(out);
  if (r->renew || (r->renewing && isnan(at[0]))) {
    r->renew = 0;
    r->renewing = 1;
    for (I i = 0; i < e->n; i++) rate[i] = NAN;
    return DONE;
  }
  r->renewing = 0;
  counted(r, t);
  int code = e->rates(e->self, t, at, rate);
  memcpy(r->y, at, sizeof(double) * (size_t)e->n);
  memcpy(r->values, rate, sizeof(double) * (size_t)e->n);
  return outcome(code, rate, e->n);
}

API int cvode_jacobian(double t, Closed y, Closed rate, Closed J, void *user, Closed a, Closed b, Closed c) {
  Run *r = user;
  const double *at = r->array(y);
  (void)a, (void)b, (void)c;
  r->jacobians++;
  r->choosing = 0;
  r->fresh = 1;
  r->jacobian_t = t;
  memcpy(r->jacobian_y, at, sizeof(double) * (size_t)r->e->n);
  return r->e->rate_jacobian(r->e->self, t, at, r->array(rate), r->data(J));
}

/* Increment at part c of a step of h, of the cubic with y and y' at both its ends. */
static double cubic(double c, double h, double y0, double rate0, double y1, double rate1) {
  return c * c * (3 - 2 * c) * (y1 - y0) + h * c * (1 - c) * ((1 - c) * rate0 - c * rate1);
}

/* Store the increments at the inner nodes of a step that ends at t: those of the cubic where CVODE's own interpolant agrees with
   it to the tolerance, else of the latter. Where steps of a smooth run grow by no more than `tame` nothing is stored.
   1: stored, 0: not needed, or the negative code of CVODE. */
static int piece(Run *r, double t, const double *y, const double *yp) {
  I n = r->e->n;
  double h = t - r->from_t, *out = r->inner + r->pieces * INNER * n;
  if (r->smooth && h <= r->tame * r->last_step) return 0;
  int agree = 1;
  for (I k = 0; k < INNER; k++) {
    double c = r->nodes[k];
    int code = r->interpolant(r->memory, r->from_t + c * h, 0, r->inner_vector);
    if (code < 0) return code;
    const double *own = r->array(r->inner_vector);
    for (I i = 0; i < n; i++) {
      double by_ends = cubic(c, h, r->from_y[i], r->from_yp[i], y[i], yp[i]);
      out[k * n + i] = own[i] - r->from_y[i];
      agree &= fabs(out[k * n + i] - by_ends) <= r->rtol * fabs(y[i]) + r->atol[i];
    }
  }
  for (I k = 0; agree && k < INNER; k++)
    for (I i = 0; i < n; i++) out[k * n + i] = cubic(r->nodes[k], h, r->from_y[i], r->from_yp[i], y[i], yp[i]);
  r->pieces++;
  return 1;
}

/* Tolerance of an unknown that is y; narrowed ones are not below round-off. */
static double tolerance_of(const Run *r, I i, double y) {
  const double own = r->rtol * fabs(y) + r->atol[i];
  return fmin(own, fmax(r->narrow * own, NARROWEST * fabs(y)));
}

/* Weights of the error test: 1 / tolerance of every unknown. */
API int sundials_weights(Closed y, Closed weights, void *user) {
  const Run *r = user;
  const double *at = r->array(y);
  double *w = r->array(weights);
  for (I i = 0; i < r->e->n; i++) w[i] = 1 / (r->wider[i] * tolerance_of(r, i, at[i]));
  return 0;
}

/* Make the tolerances of the unknowns that lead the error test `wider` times as large, or those of all what the user gave. */
static void widen(Run *r, const double *y, double wider) {
  I n = r->e->n;
  double *e = r->array(r->inner_vector), most = 0;
  for (I i = 0; i < n; i++) r->wider[i] = 1;
  if (wider <= 1 || r->errors(r->memory, r->inner_vector) < 0) return;
  for (I i = 0; i < n; i++) most = fmax(most, e[i] = fabs(e[i]) / (r->rtol * fabs(y[i]) + r->atol[i]));
  for (I i = 0; i < n; i++)
    if (e[i] > LEADING * most) r->wider[i] = wider;
}

/* Leave states in which IDA stays at a low order while it rejects every longer step. Where unknowns follow others with a large
   gain, as currents of a diode follow voltages, a step of another length or order than the last moves them by as much as the
   error of that order in those others lets it, which steps of equal length do not show: IDA doubles the step, rejects it, and
   never makes the equal steps after which it would try a higher order. Measured: 1e-7 s for 1e-4 s until the run ends. STEPS of
   order LOW or less among which MANY were rejected tell. Then the step is held (at a power of 2: the cap leaves no round-off
   that would make it another length) and the unknowns that lead the error test have wider tolerances, so that the others choose
   the order, until order HIGH or for HELD steps. Since the step does not grow meanwhile, errors do not either: 63 runs of the
   amplifier to 0.2 s, rtol 1e-4 to 1e-10, have errors of 0.08 to 30 rtol. With LOW 1 three of them rejected 4 000 steps of
   order 2. */
static void raise_order(Run *r, const double *y, double h) {
  int order = 0;
  if (r->order(r->memory, &order) < 0) return;
  if (r->held) {
    if (--r->held && order < HIGH) return;
    r->held = 0;
    r->longest(r->memory, r->cap = 0);
    widen(r, y, 1);
  }
  if (order > LOW || !r->low) r->before = r->rejected;
  r->low = order > LOW ? 0 : r->low + 1;
  if (r->low < STEPS) return;
  r->low = 0;
  if (r->rejected - r->before < MANY) return;
  r->held = HELD;
  r->longest(r->memory, r->cap = exp2(floor(log2(h))));
  widen(r, y, WIDER);
}

/* Let the error test of CVODE choose the order where a bound, and not the error, holds the step, while something grows that the
   test does not see (until the time `unseen`). CVODE takes the order with which the step may grow most; where errors are far below
   the tolerance that is the lowest. Therefore the tolerances are narrowed until the error is AIMED of them, and widened with it,
   up to those of the user; they are not narrower than round-off of the unknowns lets them be. Measured on y' = y (1 - y) from 1e-10
   to 1e-5, steps .1, rtol 1e-9: errors of 9e-3 (Adams) and 4e-1 (BDF) of y without it, 7e-9 and 4e-5 with it. */
static int choose_order(Run *r, const double *y, double h) {
  const double longest = longest_of_stretches(&r->stretches, r->from_t);
  I n = r->e->n;
  double size = 0;
  const int rejected = r->rejected > r->before;
  r->before = r->rejected;
  if (rejected || r->from_t >= r->unseen || h < HELD_BY_BOUND * longest) {
    r->narrow = r->from_t >= r->unseen ? 1 : fmin(1, r->narrow / (rejected ? NARROWS * NARROWS : NARROWS));
    return 0;
  }
  int code = r->errors(r->memory, r->inner_vector);
  const double *e = r->array(r->inner_vector);
  for (I i = 0; code >= 0 && i < n; i++) size += pow(e[i] / tolerance_of(r, i, y[i]), 2);
  if (code >= 0) r->narrow = fmin(1, fmax(r->narrow * fmax(sqrt(size / (double)n) / AIMED, NARROWS), LEAST));
  return code;
}

/* Bound the next step by `stretches`: where it is planned longer, or nothing is planned yet, it ends at a time, and those after it
   are at most a number of 4 bits, with which steps of equal length are equal to the last digit. IDA takes a higher order after
   steps of equal length alone. Measured where each step ended at a time: a disturbance of 4e-8 that grows by 1.1 in a step was
   followed with order 2, and steps of .6 and .4 of the bound took turns. Returns what SUNDIALS does. */
static int bound_step(Run *r, double stop) {
  const double longest = longest_of_stretches(&r->stretches, r->from_t);
  stop = fmin(stop, r->from_t + fmax(to_kink(&r->stretches, r->from_t), ROUND * fabs(r->from_t)));
  if (isfinite(longest)) {
    double planned = INFINITY, even;
    int power, code = r->begun ? r->planned(r->memory, &planned) : DONE;
    if (code >= 0 && planned > longest) stop = fmin(stop, r->from_t + fmax(longest, ROUND * fabs(r->from_t)));
    even = floor(16 * frexp(longest, &power)) / 16;
    even = ldexp(even, power);
    if (code >= 0 && longest > 0) code = r->longest(r->memory, r->cap > 0 ? fmin(even, r->cap) : even);
    if (code < 0) return code;
  }
  return r->until(r->memory, stop);
}

/* Internal steps until `stop`, or until there is no room for more, the evaluations are used up, or `seconds` are over.
   Row m of t, Y, Yp and stored (whether there is a piece, with CVODE) belongs to step m; *made: how many there are.
   Returns 0, the negative code of SUNDIALS, or STUCK. */
API int sundials_steps(Run *r, double stop, double seconds, I room, double *t, double *Y, double *Yp, I *stored, I *made) {
  I n = r->e->n;
  size_t size = sizeof(double) * (size_t)n;
  double begin = clock_s();
  int code = r->until(r->memory, stop);
  for (*made = 0; code >= 0 && *made < room;) {
    if ((r->stretches.count || r->stretches.kink_count) && (code = bound_step(r, stop)) < 0) break;
    double now = r->from_t, *y = Y + *made * n, *yp = Yp + *made * n;
    code = r->ida ? r->ida(r->memory, r->toward, &now, r->y_vector, r->yp_vector, ONE_STEP)
                  : r->cvode(r->memory, r->toward, r->y_vector, &now, ONE_STEP);
    if (code < 0) break;
    if (!(now > r->from_t)) return STUCK;
    memcpy(y, r->array(r->y_vector), size);
    memcpy(yp, r->ida ? r->array(r->yp_vector) : r->values, size); /* CVODE: f at the last iterate */
    if (r->cvode) {
      code = piece(r, now, y, yp);
      if (code < 0) break;
      stored[*made] = code;
    }
    t[(*made)++] = now;
    r->last_step = now - r->from_t;
    r->from_t = now;
    r->begun = 1;
    r->from_y = y;
    r->from_yp = yp;
    if (r->order) raise_order(r, y, r->last_step);
    if (r->cvode && r->unseen > -INFINITY && (code = choose_order(r, y, r->last_step)) < 0) break;
    double passed = clock_s() - begin;
    if (now >= stop || (double)r->evaluations > r->most || passed > seconds || passed < 0) break;
  }
  return code < 0 ? code : DONE;
}
