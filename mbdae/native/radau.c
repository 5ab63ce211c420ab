/* Collocation: Newton's iteration on the stages of a step (Hairer and Wanner, IV.8), its starting values, its error, and the
   control of the step. */
#include "contacts.h"
#include "sparse.h"
#include <float.h>

/* Stages of F(t0 + c_i h, y0 + Z_i, sum_j A_inv[i, j] Z_j / h) = 0; the letters are those of `CollocationTable`. */
typedef struct {
  const Equations *equations;
  const Matrix *matrix;
  I s, n, reals, pairs;                             /* stages, unknowns; eigenvalues: the first factors of the matrix */
  const double *c, *A_inv, *T, *T_inv, *V_inv, *end, *e;
  double gamma0;
  double *Z, *Y, *Yp, *R, *D, *correction, *w;      /* (s, n) each, w (2, n) */
  double *error, *scaled;                           /* (n): estimate of the error, the same in tolerances */
  double rate;                                      /* theta / (1 - theta) of earlier steps with these factors; infinite: none */
  I iterations;                                     /* results of `radau_solve` */
  double theta, norm;
  double estimate;                                  /* result of `radau_error`: norm */
  I residuals;                                      /* and residuals it took */
} Radau;

/* After one correction no contraction is known but that of an earlier step: it is trusted only where the correction is below
   UNSEEN of the tolerance, because what remains adds up over steps (9e-6 instead of 3e-7 after 100 steps asked for 1e-7).
   Corrections that stopped shrinking are round-off: below STAGNATION of the tolerance they do no harm, and so do those within
   MARGIN times the measured round-off. */
static const double UNSEEN = 0.1, STAGNATION = 0.03, MARGIN = 30.0;

/* out (s, n) = factor A x, A (s, s), x (s, n) */
WIDE static void product(const double *A, const double *x, double *out, I s, I n, double factor) {
  for (I i = 0; i < s; i++) {
    double *o = out + i * n;
    const double first = A[i * s] * factor;
    for (I k = 0; k < n; k++) o[k] = first * x[k];
    for (I j = 1; j < s; j++) {
      const double f = A[i * s + j] * factor;
      for (I k = 0; k < n; k++) o[k] += f * x[j * n + k];
    }
  }
}

/* Weighted root mean square of x (rows, n) */
static double weighted(const double *x, const double *weights, I rows, I n) {
  double sum = 0;
  for (I i = 0; i < rows; i++)
    for (I k = 0; k < n; k++) {
      const double v = x[i * n + k] * weights[k];
      sum += v * v;
    }
  return sqrt(sum / (double)(rows * n));
}

API void radau_slopes(const Radau *a, double h) { product(a->A_inv, a->Z, a->Yp, a->s, a->n, 1 / h); }

/* Starting increments Z: the polynomial of the last step continued from its increments, a straight line where last_h is 0. */
API void radau_predict(const Radau *a, const double *yp, double h, double last_h, const double *last) {
  const I s = a->s, n = a->n;
  if (last_h == 0) {
    for (I i = 0; i < s; i++)
      for (I k = 0; k < n; k++) a->Z[i * n + k] = a->c[i] * h * yp[k];
    return;
  }
  for (I i = 0; i < s; i++) {
    const double theta = 1 + h / last_h * a->c[i];
    memset(a->Z + i * n, 0, sizeof(double) * n);
    for (I j = 0; j < s; j++) {
      double weight = -a->end[j], power = theta;
      for (I k = 0; k < s; k++, power *= theta) weight += power * a->V_inv[k * s + j];
      for (I k = 0; k < n; k++) a->Z[i * n + k] += weight * last[j * n + k];
    }
  }
}

/* Residuals R of all stages: the worst that one of them reports. */
static int evaluate(const Radau *a, double t0, const double *y0, double h) {
  const I n = a->n;
  int worst = DONE;
  radau_slopes(a, h);
  for (I i = 0; i < a->s; i++) {
    double *Y = a->Y + i * n;
    for (I k = 0; k < n; k++) Y[k] = y0[k] + a->Z[i * n + k];
    const int code = a->equations->residual(a->equations->self, t0 + a->c[i] * h, Y, a->Yp + i * n, a->R + i * n);
    if (code < 0) return code;
    if (code > worst) worst = code;
  }
  return worst;
}

/* correction = -(iteration matrix)^-1 R by real and complex solutions; Z += correction */
static void correct(const Radau *a) {
  const Matrix *m = a->matrix;
  const I s = a->s, n = a->n;
  Pair *b = (Pair *)a->w;
  for (I i = 0; i < s; i++)
    for (I k = 0; k < n; k++) a->R[i * n + k] *= m->row[k];
  product(a->T_inv, a->R, a->D, s, n, 1);
  for (I j = 0; j < a->reals; j++) lu_solve(m->factors[j], a->D + j * n);
  for (I j = 0; j < a->pairs; j++) {
    double *re = a->D + (a->reals + 2 * j) * n, *im = re + n;
    for (I k = 0; k < n; k++) b[k] = (Pair){re[k], im[k]};
    lu_solve(m->factors[m->reals + j], b);
    for (I k = 0; k < n; k++) re[k] = b[k].re, im[k] = b[k].im;
  }
  product(a->T, a->D, a->correction, s, n, -1);
  for (I i = 0; i < s; i++)
    for (I k = 0; k < n; k++) a->Z[i * n + k] += a->correction[i * n + k] *= m->column[k];
}

/* Norm that a correction can have from round-off alone, at the last stage. */
API double radau_noise(const Radau *a, const double *weights) {
  const I last = (a->s - 1) * a->n;
  matrix_noise(a->matrix, a->Y + last, a->Yp + last, a->w);
  return MARGIN * weighted(a->w, weights, 1, a->n);
}

/* Diverging, or too slow for the iterations left. */
static int hopeless(double theta, double smooth, double norm, double target, I left) {
  if (theta >= 0.99 || smooth >= 0.99) return 1;
  return pow(smooth, (double)left) / (1 - smooth) * norm > fmax(target, STAGNATION);
}

static int iterate(Radau *a, double t0, const double *y0, double h, const double *weights, double target, I limit) {
  double previous = INFINITY, theta = 0, smooth = 0, factor = isfinite(a->rate) ? pow(fmax(a->rate, 1e-10), 0.8) : INFINITY;
  a->iterations = 0;
  if (!a->matrix->ready) return 0;
  for (I k = 1; k <= limit; k++) {
    const int code = evaluate(a, t0, y0, h);
    a->iterations = k;
    a->theta = a->norm = INFINITY;
    if (code < 0) return code;
    correct(a);
    const double norm = code == DONE ? weighted(a->correction, weights, a->s, a->n) : INFINITY;
    if (!isfinite(norm)) return 0;
    if (k > 1) {
      theta = previous > 0 ? norm / previous : 0;
      smooth = k == 2 ? theta : sqrt(theta * smooth);
      factor = smooth < 1 ? smooth / (1 - smooth) : INFINITY;
    }
    a->theta = smooth, a->norm = norm;
    if (norm == 0 || factor * norm <= (k > 1 ? target : fmin(target, UNSEEN))) {
      a->rate = factor;
      return 1;
    }
    if (k > 1 && norm > STAGNATION && hopeless(theta, smooth, norm, target, limit - k))
      return theta > 0.3 && norm <= radau_noise(a, weights);
    if (theta > 0.9 && norm <= STAGNATION) return 1;
    previous = norm;
  }
  return a->norm <= STAGNATION;
}

/* Iterate from the increments Z with the present factors until what is expected to remain is below `target` (one tolerance is
   one unit of the norm): 1 where it is, Yp then being the slopes of Z; 0 where not; negative: Python raised. */
API int radau_solve(Radau *a, double t0, const double *y0, double h, const double *weights, double target, I limit) {
  const int converged = iterate(a, t0, y0, h, weights, target, limit);
  if (converged > 0) radau_slopes(a, h);
  return converged;
}

/* `error` becomes the equations in it, solved; returns its norm. */
static double filtered(const Radau *a, const double *weights) {
  matrix_correct(a->matrix, a->error);
  for (I k = 0; k < a->n; k++) a->scaled[k] = a->error[k] * weights[k];
  return weighted(a->error, weights, 1, a->n);
}

/* Filtered embedded error of the step from (t, y, yp), in units of the tolerance; filtered once more where it matters. */
API int radau_error(Radau *a, double t, const double *y, const double *yp, double h, const double *weights, I careful) {
  const I n = a->n;
  double *x = a->w, *rhs = x + n;
  for (I k = 0; k < n; k++) {
    x[k] = a->gamma0 * h * yp[k];
    for (I i = 0; i < a->s; i++) x[k] += a->e[i] * a->Z[i * n + k];
  }
  matrix_mass(a->matrix, x, rhs);
  for (I k = 0; k < n; k++) a->error[k] = rhs[k] /= h * a->gamma0;
  a->estimate = filtered(a, weights);
  a->residuals = careful && a->estimate >= 1;
  if (!a->residuals) return DONE;
  for (I k = 0; k < n; k++) x[k] = y[k] + a->error[k];
  const int code = a->equations->residual(a->equations->self, t, x, yp, a->error);
  if (code < 0) return code;
  for (I k = 0; k < n; k++) a->error[k] = rhs[k] - a->error[k];
  a->estimate = code == DONE ? filtered(a, weights) : INFINITY;
  return DONE;
}

/* -- runs */

/* Further results of a call: Newton's method does not converge with a fresh Jacobian; the order of some factors is bad, and Python
   looks for another; the step has no width beside the time; it became too small while the error test failed; there are no rates
   at its end; Python has to look at the contacts of the last step made. */
enum { DIVERGED = 3, ORDER = 4, NO_WIDTH = 5, VANISHED = 6, NO_RATES = 7, LOOK = 8 };

/* A contraction better than REUSE lets the Jacobian serve the next step too; a new one is evaluated at the predicted stage AMID:
   amid the steps it serves it serves more of them. Steps longer than the last one by more than FAR do not continue its polynomial;
   a step grows by 8 at most, but one that ends at a contact may be short. A change of the step from KEEP[0] to KEEP[1] does not pay
   for new factors; those of a step KEEP_FACTORS times as long as a watched bound allows are used again. An estimate above SUSPECT
   is compared with round-off; if it is round-off, the step grows as after an estimate of ESCAPE, because shorter steps only make
   it worse (eps |q| / h in velocities). HELD steps after one that failed are at most UNDER times as long, unless one may grow by
   more than OVER. */
static const double REUSE = 1e-2, FAR = 50, KEEP[2] = {0.9, 1.2}, KEEP_FACTORS = 0.6, SHRINK = 0.2, GROW = 8, SUSPECT = 0.8,
                    ESCAPE = 0.05, UNDER = 0.9, OVER = 2;
enum { AMID = 1, FIRST = 1, AGAIN = 2, HELD = 10 }; /* `rejected` of the first step, and of those after a rejection */

/* A run at the state (y, y'). One unit of every norm is rtol |y| + atol, over (h / time)^order in unknowns of index order + 1. */
typedef struct {
  Radau *a;
  Matrix *matrix;
  const Equations *rates;                /* y' = f(t, y) of methods whose last stage is not the end of the step; NULL: it is */
  const double *atol, *order;            /* (n) each */
  double rtol, time, target;             /* part of the tolerance that Newton's method leaves */
  I limit;                               /* most iterations */
  double *y, *yp, *last, *weights, *power; /* (n); last (s, n): increments of the last step */
  double last_h, factored, power_h;      /* steps of these increments, of the factors, of `power`; 0: there are none */
  I stale, fresh, at_start, here;        /* the Jacobian: to be replaced, of this very step, next one at its start, always there */
  double h, exponent, accepted, accepted_error; /* next step; of the controller: 1 / (s + 1), last step and its error */
  Stretches stretches;
  Contacts *contacts;                    /* NULL: Python looks at them, or there are none */
  double bound, landing, smallest;       /* steps (s): allowed by what is watched, to where one has to end, and the least */
  double width, error;                   /* of the present step */
  double noise, noise_t, noise_h;        /* round-off that passed for an error first, 0: none did */
  double tried;                          /* h and `rejected` before the last step that was accepted */
  double failed;                         /* width that failed the error test last, not to be tried in `held` more steps */
  I careful, rejected, held;             /* rejected: the next step is the first, or one after a rejection */
  I rejections, jacobians, factorisations, iterations, residuals;
} Run;

static void weigh(Run *r, double h, const double *increment) {
  const I n = r->a->n;
  if (h != r->power_h)
    for (I k = 0; k < n; k++) r->power[k] = r->order[k] == 0 ? 1 : pow(h / r->time, r->order[k]);
  r->power_h = h;
  for (I k = 0; k < n; k++) {
    double size = fabs(r->y[k]);
    if (increment) size = fmax(size, fabs(r->y[k] + increment[k]));
    r->weights[k] = r->power[k] / (r->rtol * size + r->atol[k]);
  }
}

API void run_predict(Run *r, double h) { radau_predict(r->a, r->yp, h, h <= FAR * r->last_h ? r->last_h : 0, r->last); }

static int refresh(Run *r, double t, double h) {
  const Radau *a = r->a;
  const Equations *e = a->equations;
  const I n = a->n, i = a->s > AMID ? AMID : a->s - 1;
  const double *y = r->y, *yp = r->yp;
  r->fresh = r->last_h == 0 || r->at_start || r->here;
  if (!r->fresh) {
    run_predict(r, h);
    radau_slopes(a, h);
    for (I k = 0; k < n; k++) a->Y[k] = r->y[k] + a->Z[i * n + k];
    t += a->c[i] * h, y = a->Y, yp = a->Yp + i * n;
  }
  const int code = e->jacobian(e->self, t, y, yp, r->matrix->fy, r->matrix->fyp);
  if (code > 0) r->matrix->fy[0] = NAN;
  r->stale = r->at_start = 0, r->factored = 0, r->jacobians++;
  return code < 0 ? code : DONE;
}

/* The factors are those of the step h. */
API void run_factored(Run *r, double h) { r->factored = h, r->a->rate = INFINITY, r->factorisations++; }

static int prepare(Run *r, double t, double h) {
  const int code = r->stale ? refresh(r, t, h) : DONE;
  if (code || h == r->factored) return code;
  r->factored = 0;
  if (matrix_factor(r->matrix, h, 0) >= 0) return ORDER;
  run_factored(r, h);
  return DONE;
}

/* Solve the stages of a step of h from t: with the present factors, else with those of a fresh Jacobian. */
API int run_solve(Run *r, double t, double h) {
  for (r->width = h;; r->stale = r->at_start = 1) {
    int code = prepare(r, t, h);
    if (code) return code;
    weigh(r, h, NULL);
    run_predict(r, h);
    code = radau_solve(r->a, t, r->y, h, r->weights, r->target, r->limit);
    r->iterations += r->a->iterations, r->residuals += r->a->s * r->a->iterations;
    if (code < 0) return code;
    if (code) {
      if (r->a->theta > REUSE) r->stale = 1;
      return DONE;
    }
    if (r->fresh) return DIVERGED;
  }
}

/* Move to t + h, the end of the step just solved. */
API int run_advance(Run *r, double t, double h) {
  const Radau *a = r->a;
  const I s = a->s, n = a->n;
  const size_t row = sizeof(double) * (size_t)n;
  memcpy(r->last, a->Z, row * (size_t)s);
  r->last_h = h, r->fresh = 0;
  for (I j = 0; j < s; j++)
    for (I k = 0; k < n; k++) r->y[k] += a->end[j] * a->Z[j * n + k];
  if (!r->rates) {
    memcpy(r->yp, a->Yp + (s - 1) * n, row);
    return DONE;
  }
  r->residuals++;
  const int code = r->rates->rates(r->rates->self, t + h, r->y, r->yp);
  return code > 0 ? NO_RATES : code;
}

/* The error of the step just solved, in units of the tolerance. */
static int estimate(Run *r, double t) {
  Radau *a = r->a;
  double *increment = a->w; /* of the whole step; `radau_error` writes there only after the weights are made */
  memset(increment, 0, sizeof(double) * (size_t)a->n);
  for (I j = 0; j < a->s; j++)
    for (I k = 0; k < a->n; k++) increment[k] += a->end[j] * a->Z[j * a->n + k];
  weigh(r, r->width, increment);
  const int code = radau_error(a, t, r->y, r->yp, r->width, r->weights, r->rejected != 0);
  r->residuals += a->residuals;
  r->error = a->estimate;
  if (code < 0 || !(r->error > SUSPECT)) return code;
  weigh(r, r->width, NULL);
  const double noise = radau_noise(a, r->weights);
  if (!(r->error <= noise)) return DONE;
  if (r->noise == 0) r->noise = noise, r->noise_t = t, r->noise_h = r->width;
  r->error = ESCAPE;
  return DONE;
}

/* The next step after one that is accepted (Gustafsson), kept where a change would not pay. While the error rises and falls with
   vibrations, a width that failed would be tried again at once, and fail again; where it may grow much, what made it fail is over. */
static double proposed(Run *r) {
  const double limit = (double)(2 * r->limit), h = r->width, error = fmax(r->error, 1e-10);
  const double safety = 0.9 * (limit + 1) / (limit + (double)r->a->iterations);
  double factor = safety * pow(error, -r->exponent);
  if (r->accepted != 0)
    factor = fmin(factor, safety * (h / r->accepted) * pow(r->accepted_error / (error * error), r->exponent));
  r->accepted = h, r->accepted_error = fmax(error, 1e-2);
  factor = fmin(fmax(factor, SHRINK), r->rejected == AGAIN ? 1 : GROW);
  if (factor > OVER) r->held = 0;
  if (r->held > 0) r->held--, factor = fmin(factor, fmax(UNDER * r->failed / h, 1));
  return KEEP[0] <= factor && factor <= KEEP[1] ? h : h * factor;
}

/* The width of the next step: cut or slightly stretched to end with what is left; two equal ones rather than a long and a tiny one.
   One that has to land somewhere is as long as that asks. */
static double fitted(const Run *r, double t, double left) {
  double h = fmin(r->h, longest_step(&r->stretches, t)), bound = r->bound;
  if (r->contacts) bound = fmin(bound, contacts_bound(r->contacts, t));
  if (bound < h) h = KEEP_FACTORS * bound <= r->factored && r->factored <= bound ? r->factored : bound;
  if (r->landing <= h) return fmin(r->landing, left);
  if (h * 1.01 >= left) return left;
  return 2 * h > left && h > 0.6 * left ? left / 2 : h;
}

/* One attempt at a step from t, its error in `error`. solved: its stages are solved already. */
static int attempt(Run *r, double t, double end, I solved) {
  if (!solved) {
    const double h = fitted(r, t, end - t);
    if (!(t + h > t)) return r->width = h, NO_WIDTH;
    const int code = run_solve(r, t, h);
    if (code) return code;
  }
  return estimate(r, t);
}

/* After an error above 1, or one that is not a number. */
static int reject(Run *r, double t) {
  r->rejections++, r->rejected = AGAIN, r->failed = r->width, r->held = HELD;
  if (r->width < fmax(r->smallest, 10 * DBL_EPSILON * fabs(t))) return VANISHED;
  r->h = r->width * fmax(SHRINK, isfinite(r->error) ? 0.9 * pow(r->error, -r->exponent) : 0);
  return DONE;
}

static int accept(Run *r, double t) {
  const double next = proposed(r);
  r->tried = r->h, r->careful = r->rejected;
  r->h = isfinite(r->landing) ? fmax(next, r->h) : next; /* a step that ended at a contact or kink was not cut for its error */
  r->landing = INFINITY, r->rejected = 0;
  return run_advance(r, t, r->width);
}

/* Steps from t to `end`, until there is no room for more, more than `most` residuals were evaluated, or `seconds` are over.
   solved: the stages of the first one are. Row m of T, Y, Yp, inner (s - 1, n) and errors belongs to step m; *made: how many. */
API int run_steps(Run *r, double t, double end, I solved, double most, double seconds, I room, double *T, double *Y, double *Yp,
                  double *inner, double *errors, I *made) {
  const I n = r->a->n, inside = (r->a->s - 1) * n;
  const size_t row = sizeof(double) * (size_t)n;
  const double begin = clock_s();
  for (*made = 0; *made < room && t < end; solved = 0) {
    int code = attempt(r, t, end, solved);
    if (code) return code;
    const I accepted = r->error < 1, m = *made;
    code = accepted ? accept(r, t) : reject(r, t);
    if (code) return code;
    if (accepted) {
      T[m] = t = t + r->width * (1 + 1e-9) >= end ? end : t + r->width;
      errors[m] = r->accepted_error;
      memcpy(Y + m * n, r->y, row);
      memcpy(Yp + m * n, r->yp, row);
      memcpy(inner + m * inside, r->last, sizeof(double) * (size_t)inside);
      ++*made;
      code = r->contacts ? contacts_calm(r->contacts, t, r->width, r->y) : 1;
      if (code <= 0) return code < 0 ? code : LOOK;
      if (r->contacts && contacts_keep(r->contacts)) r->stale = 1;
    }
    if ((double)r->residuals > most || clock_s() - begin > seconds) break;
  }
  return DONE;
}
