/* LU in a fixed pattern, and iteration matrices: scaled, factorised, solved with. Python finds the order of the pivots. */
#include "sparse.h"
#include <float.h>

enum { TAME = 1000 };                /* growth up to it loses few digits: such factors are not checked */
static const double MOST = 1e12;     /* multipliers above it: an order is given up unchecked */

static inline double real_of(double x) { return x; }
static inline double real_size(double x) { return fabs(x); }
static inline double real_times(double x, double y) { return x * y; }
static inline void real_less(double *w, double x, double y) { *w -= x * y; }
static inline double real_inverse(double x) { return 1 / x; }

static inline Pair pair_of(double x) { return (Pair){x, 0}; }
static inline double pair_size(Pair z) { return fabs(z.re) + fabs(z.im); }
static inline Pair pair_times(Pair x, Pair y) { return (Pair){x.re * y.re - x.im * y.im, x.re * y.im + x.im * y.re}; }
static inline void pair_less(Pair *w, Pair x, Pair y) {
  w->re -= x.re * y.re - x.im * y.im;
  w->im -= x.re * y.im + x.im * y.re;
}
static inline Pair pair_inverse(Pair z) { /* without overflow of squares */
  const double s = 1 / pair_size(z), a = z.re * s, b = z.im * s, q = s / (a * a + b * b);
  return (Pair){a * q, -b * q};
}

/* Take a number out of a list in which it is once. */
static inline void take_out(short *list, I *count, I what) {
  I at = 0;
  while (list[at] != what) at++;
  list[at] = list[--*count];
}

#define T double
#define NAME(what) real_##what
#include "lu.h"
#define T Pair
#define NAME(what) pair_##what
#include "lu.h"

/* Rows of L + U of a matrix (n, n) whose row i has the entries `columns`, rising, its diagonal among them, from rows[i] on: where
   they begin (`ptr`), their columns and their diagonals; next (n + 2) to work with. The number of entries, or -1 where `most` are
   too few. */
API I lu_fill(I n, const I *rows, const I *columns, I most, I *ptr, I *col, I *diag, I *next) {
  const I head = n + 1;
  ptr[0] = 0;
  for (I i = 0; i < n; i++) {
    I at = head, end = ptr[i]; /* the row as a list of rising columns that ends with n */
    for (I k = rows[i]; k < rows[i + 1]; k++) at = next[at] = columns[k];
    next[at] = n;
    for (I j = next[head]; j < i; j = next[j]) {
      I to = j;
      for (I k = diag[j] + 1; k < ptr[j + 1]; k++) {
        while (next[to] < col[k]) to = next[to];
        if (next[to] != col[k]) {
          next[col[k]] = next[to];
          next[to] = col[k];
        }
        to = col[k];
      }
    }
    for (I j = next[head]; j < n; j = next[j]) {
      if (end == most) return -1;
      if (j == i) diag[i] = end;
      col[end++] = j;
    }
    ptr[i + 1] = end;
  }
  return ptr[n];
}

/* See `choose` of lu.h; rows, columns (n): all numbers in any order, then those of the pivots in theirs. */
API I lu_choose(I n, I complex, double share, void *d, char *at, I *rows, I *columns, I *count, I *place, short *list, double *top) {
  return (complex ? pair_choose(n, share, d, at, rows, columns, count, place, list, top)
                  : real_choose(n, share, d, at, rows, columns, count, place, list, top));
}

/* -1; the unknown whose pivot is bad; n where the factors are inaccurate or there are none yet */
API I lu_factor(Factors *f) {
  if (!f->lu) return f->n;
  return f->complex ? pair_begin(f) : real_begin(f);
}

API void lu_solve(const Factors *f, void *b) {
  if (f->order) {
    if (f->complex) pair_solve(f->order, f->lu, b, f->w);
    else real_solve(f->order, f->lu, b, f->w);
    return;
  }
  int n = (int)f->n, one = 1, info = 0;
  f->getrs("N", &n, &one, f->lu, &n, f->swaps, b, &n, &info);
}

/* Right-hand sides b (n, columns) beside each other; w (n, columns): room */
API void lu_solve_columns(const Factors *f, I columns, void *b, void *w) {
  if (f->order) {
    if (f->complex) pair_solve_columns(f->order, f->lu, columns, b, w);
    else real_solve_columns(f->order, f->lu, columns, b, w);
    return;
  }
  const I n = f->n, parts = f->complex ? 2 : 1;
  double *from = b, *one = w;
  for (I c = 0; c < columns; c++) { /* LAPACK takes them one behind the other */
    for (I i = 0; i < n; i++) memcpy(one + i * parts, from + (i * columns + c) * parts, sizeof(double) * (size_t)parts);
    lu_solve(f, one);
    for (I i = 0; i < n; i++) memcpy(from + (i * columns + c) * parts, one + i * parts, sizeof(double) * (size_t)parts);
  }
}

/* `times` right-hand sides behind each other */
API void lu_solve_each(const Factors *f, I times, double *b) {
  for (I i = 0; i < times; i++) lu_solve(f, b + i * f->n * (f->complex ? 2 : 1));
}

/* x, the result of lu_solve for b, with one correction; dense factors need none */
API void lu_correct(const Factors *f, const void *b, void *x) {
  if (!f->order) return;
  if (f->complex) pair_correct(f, b, x);
  else real_correct(f, b, x);
}

static void scale(const Matrix *m, double h) {
  for (I i = 0; i < m->n; i++) { /* most unknowns have the power 0 or 1 */
    const double p = m->power[i];
    m->column[i] = p == 0 ? m->scale[i] : p == 1 ? m->scale[i] / h : m->scale[i] * pow(h, -p);
    m->row[i] = 0;
  }
  for (I k = 0; k < m->nnz; k++) {
    const double c = m->column[m->column_of[k]], size = fabs(m->fy[k] * c) + fabs(m->fyp[k] * (c / h));
    double *r = &m->row[m->row_of[k]];
    if (!(size <= *r)) *r = size;
  }
  for (I i = 0; i < m->n; i++) m->row[i] = m->row[i] > 0 && isfinite(m->row[i]) ? 1 / m->row[i] : 1;
  for (I k = 0; k < m->nnz; k++) {
    const double r = m->row[m->row_of[k]], c = m->column[m->column_of[k]], a = m->fy[k] * c * r, b = m->fyp[k] * (c / h) * r;
    for (I j = 0; j < m->reals; j++) ((double *)m->factors[j]->a)[k] = a + m->lambda[j] * b;
    for (I j = 0; j < m->pairs; j++) {
      const double *z = m->lambda + m->reals + 2 * j;
      ((Pair *)m->factors[m->reals + j]->a)[k] = (Pair){a + z[0] * b, z[1] * b};
    }
  }
}

/* Factors for the step h from number `first` on, scaled anew where that is 0: -1, or the number whose order is bad. */
API I matrix_factor(Matrix *m, double h, I first) {
  m->ready = 0;
  if (first == 0) scale(m, h);
  for (I j = first; j < m->reals + m->pairs; j++)
    if (lu_factor(m->factors[j]) >= 0) return j;
  m->ready = 1;
  return -1;
}

/* out (n) = dF/dy' x */
API void matrix_mass(const Matrix *m, const double *x, double *out) {
  memset(out, 0, sizeof(double) * m->n);
  for (I k = 0; k < m->nnz; k++) out[m->row_of[k]] += m->fyp[k] * x[m->column_of[k]];
}

/* b (n), equations, becomes unknowns: solved with the first factors; 0 without factors. */
API void matrix_correct(const Matrix *m, double *b) {
  const I n = m->n;
  Pair *z = (Pair *)m->w;
  if (!m->ready) {
    memset(b, 0, sizeof(double) * n);
    return;
  }
  for (I i = 0; i < n; i++) b[i] *= m->row[i];
  if (m->reals) lu_solve(m->factors[0], b);
  else {
    for (I i = 0; i < n; i++) z[i] = (Pair){b[i], 0};
    lu_solve(m->factors[0], z);
    for (I i = 0; i < n; i++) b[i] = sqrt(z[i].re * z[i].re + z[i].im * z[i].im);
  }
  for (I i = 0; i < n; i++) b[i] *= m->column[i];
}

/* out (n): the increments that round-off of the residual alone can produce at (y, y'). It is of the size of the terms that a row
   cancels; their signs are not known: once all equal, once alternating. */
API void matrix_noise(const Matrix *m, const double *y, const double *yp, double *out) {
  const I n = m->n;
  double *other = m->w + 2 * n;
  memset(out, 0, sizeof(double) * n);
  for (I k = 0; k < m->nnz; k++)
    out[m->row_of[k]] += DBL_EPSILON * (fabs(m->fy[k] * y[m->column_of[k]]) + fabs(m->fyp[k] * yp[m->column_of[k]]));
  for (I i = 0; i < n; i++) other[i] = i % 2 ? -out[i] : out[i];
  matrix_correct(m, out);
  matrix_correct(m, other);
  for (I i = 0; i < n; i++) out[i] = fmax(fabs(out[i]), fabs(other[i]));
}
