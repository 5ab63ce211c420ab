/* Newton's iteration on the stages of one collocation step (Hairer and Wanner, IV.8), its starting values and its error. */
#include "sparse.h"

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
static void product(const double *A, const double *x, double *out, I s, I n, double factor) {
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
