/* Eigenvectors of full matrices, row by row, to known eigenvalues: inverse iteration with their Hessenberg form (Golub and Van
   Loan, Matrix Computations, chapter 7). */
#ifndef MBDAE_EIGEN_H
#define MBDAE_EIGEN_H
#include "sparse.h"
#include <float.h>

static inline Pair times(Pair x, Pair y) { return (Pair){x.re * y.re - x.im * y.im, x.re * y.im + x.im * y.re}; }
static inline Pair minus(Pair x, Pair y) { return (Pair){x.re - y.re, x.im - y.im}; }
static inline Pair plus(Pair x, Pair y) { return (Pair){x.re + y.re, x.im + y.im}; }
static inline Pair scaled(double f, Pair x) { return (Pair){f * x.re, f * x.im}; }
static inline double size(Pair x) { return hypot(x.re, x.im); }
static inline double about(Pair x) { return fabs(x.re) + fabs(x.im); }
static inline Pair over(Pair x, Pair y) { /* without overflow of squares */
  const double s = 1 / about(y), a = y.re * s, b = y.im * s, q = s / (a * a + b * b);
  return times(x, (Pair){a * q, -b * q});
}

/* Hessenberg form of a (n, n) in place; below it the reflections 1 - beta v v^T, whose first number is 1. w (n): room */
WIDE static void hessenberg(I n, double *restrict a, double *restrict beta, double *restrict w) {
  for (I k = 0; k + 2 < n; k++) {
    double rest = 0;
    const double head = a[(k + 1) * n + k];
    beta[k] = 0;
    for (I i = k + 2; i < n; i++) rest += a[i * n + k] * a[i * n + k];
    if (!(rest > 0)) continue;
    const double length = sqrt(head * head + rest), to = head > 0 ? -length : length;
    const double b = (to - head) / to, inverse = 1 / (head - to);
    for (I i = k + 2; i < n; i++) a[i * n + k] *= inverse;
    a[(k + 1) * n + k] = to, beta[k] = b;
    memcpy(w + k + 1, a + (k + 1) * n + k + 1, sizeof(double) * (size_t)(n - k - 1));
    for (I i = k + 2; i < n; i++) {
      const double v = a[i * n + k], *row = a + i * n;
      if (v == 0) continue;
      for (I j = k + 1; j < n; j++) w[j] += v * row[j];
    }
    for (I i = k + 1; i < n; i++) {
      const double v = b * (i > k + 1 ? a[i * n + k] : 1);
      double *row = a + i * n;
      if (v == 0) continue;
      for (I j = k + 1; j < n; j++) row[j] -= v * w[j];
    }
    w[k + 1] = 1;
    for (I i = k + 2; i < n; i++) w[i] = a[i * n + k];
    for (I i = 0; i < n; i++) {
      double *row = a + i * n, sum = 0;
      for (I j = k + 1; j < n; j++) sum += row[j] * w[j];
      sum *= b;
      for (I j = k + 1; j < n; j++) row[j] -= sum * w[j];
    }
  }
}

/* U and multipliers of H - value for a Hessenberg matrix, with exchanges of neighbouring rows */
static void shifted(I n, const double *H, Pair value, Pair *U, Pair *l, I *swap) {
  double largest = 0;
  for (I i = 0; i < n; i++)
    for (I j = 0; j < n; j++) {
      U[i * n + j] = (Pair){j + 1 < i ? 0 : H[i * n + j], 0};
      largest = fmax(largest, fabs(U[i * n + j].re));
    }
  for (I i = 0; i < n; i++) U[i * n + i] = minus(U[i * n + i], value);
  for (I i = 0; i < n; i++) {
    Pair *a = U + i * n, *b = a + n;
    swap[i] = i + 1 < n && about(b[i]) > about(a[i]);
    if (swap[i])
      for (I j = i; j < n; j++) {
        const Pair x = a[j];
        a[j] = b[j], b[j] = x;
      }
    if (about(a[i]) <= DBL_EPSILON * 1e-3 * largest) a[i] = (Pair){DBL_EPSILON * 1e-3 * (largest > 0 ? largest : 1), 0};
    if (i + 1 == n) break;
    l[i] = over(b[i], a[i]);
    if (l[i].re != 0 || l[i].im != 0)
      for (I j = i + 1; j < n; j++) b[j] = minus(b[j], times(l[i], a[j]));
  }
}

/* x (n), solved with these, or with their transposed ones; then its largest number is about 1 */
static void solved_with(I n, const Pair *U, const Pair *l, const I *swap, I transposed, Pair *x) {
  for (I i = 0; i < n && transposed; i++) {
    x[i] = over(x[i], U[i * n + i]);
    for (I j = i + 1; j < n; j++) x[j] = minus(x[j], times(U[i * n + j], x[i]));
  }
  for (I k = 0; k + 1 < n; k++) {
    const I i = transposed ? n - 2 - k : k;
    if (transposed) x[i] = minus(x[i], times(l[i], x[i + 1]));
    if (swap[i]) {
      const Pair y = x[i];
      x[i] = x[i + 1], x[i + 1] = y;
    }
    if (!transposed) x[i + 1] = minus(x[i + 1], times(l[i], x[i]));
  }
  for (I i = n; i-- > 0 && !transposed;) {
    for (I j = i + 1; j < n; j++) x[i] = minus(x[i], times(U[i * n + j], x[j]));
    x[i] = over(x[i], U[i * n + i]);
  }
  double top = 0;
  for (I i = 0; i < n; i++) top = fmax(top, about(x[i]));
  for (I i = 0; i < n && top > 0; i++) x[i] = scaled(1 / top, x[i]);
}

/* x (n) becomes Q x: the reflections of a Hessenberg form */
static void reflected(I n, const double *H, const double *beta, Pair *x) {
  for (I k = n - 2; k-- > 0;) {
    Pair sum = x[k + 1];
    for (I i = k + 2; i < n; i++) sum = plus(sum, scaled(H[i * n + k], x[i]));
    sum = scaled(beta[k], sum);
    x[k + 1] = minus(x[k + 1], sum);
    for (I i = k + 2; i < n; i++) x[i] = minus(x[i], scaled(H[i * n + k], sum));
  }
}

/* The matrix a (n, n) with the right-hand side b (n) in its place: 0, or 1 where it is singular */
static int eliminated(I n, Pair *a, Pair *b) {
  for (I k = 0; k < n; k++) {
    I best = k;
    for (I i = k + 1; i < n; i++)
      if (about(a[i * n + k]) > about(a[best * n + k])) best = i;
    if (!(about(a[best * n + k]) > 0)) return 1;
    for (I j = k; j < n && best != k; j++) {
      const Pair x = a[k * n + j];
      a[k * n + j] = a[best * n + j], a[best * n + j] = x;
    }
    const Pair x = b[k];
    b[k] = b[best], b[best] = x;
    for (I i = k + 1; i < n; i++) {
      const Pair l = over(a[i * n + k], a[k * n + k]);
      for (I j = k + 1; j < n; j++) a[i * n + j] = minus(a[i * n + j], times(l, a[k * n + j]));
      b[i] = minus(b[i], times(l, b[k]));
    }
  }
  for (I k = n; k-- > 0;) {
    for (I j = k + 1; j < n; j++) b[k] = minus(b[k], times(a[k * n + j], b[j]));
    b[k] = over(b[k], a[k * n + k]);
  }
  return 0;
}
#endif
