/* Roots of the linearised equations E x' + A x = 0 at states of a run (looks), with frozen coefficients, and which of the
   disturbances that belong to them are small in the motion. A = dF/dy, E = dF/dy', unknowns over their scales.

   With h = step / shift the matrix S = (E + h A)^-1 E has the eigenvalue 1 / (1 - h r) for a root r, 0 for an infinite one.
   Columns of S are 0 for algebraic unknowns; and an unknown on which no equation depends but those that such unknowns move (a
   place on which no force depends, then its velocity) has the root 0 and moves nothing else. The other ones, the core, have all
   other roots:

     S = [ core      0      ]     core (c, c), moved unknowns (d, d) with the eigenvalue 1 alone
         [ reached   moved  ]

   Python finds the eigenvalues of the core with LAPACK. */
#include "eigen.h"

enum { CORE, MOVED, ALGEBRAIC };
enum { COPIES = 2 };
/* A relative distance from an eigenvalue at which inverse iteration is well determined; relative distance of equal roots */
static const double BESIDE = 1e-11, ALIKE = 1e-5;

/* k looks at n unknowns, of which `most` at most have rates. h, motion (y' over scales, (k, n)), fy, fyp (k, nnz), in the
   pattern of the matrix, whose columns begin at `first`; place: the `places` unknowns that are positions. Results: core, moved
   (k): how many, in this order in unknowns (k, n); solved (k, n, most): S, columns of the core; H (k, most, most), beta (k,
   most): the core, later its Hessenberg form with its reflections; root (k, most), of eigenvalues value: 1/s, -inf where
   infinite; rate (k): the largest real part, or 0; rises (k): whether something grows. `many`: this is asked first, by
   `rising`; `dense`: then roots are sought, else the rate is 1 over the step. room: see `spectrum`, `rising` and
   `growth_unseen`. */
typedef struct {
  Matrix *matrix;
  I looks, n, most, places, many, dense, rounds;
  double shift, resolved, grows, faster;
  const I *first, *place;
  const double *h, *motion, *fy, *fyp;
  I *core, *moved, *unknowns, *kind, *taken;
  double *solved, *H, *beta;
  Pair *value, *root;
  double *rate, *room;
  I *rises;
} Looks;

/* Numbers without any pattern that equations could have */
static inline double spread(I i) { return cos((double)(i + 1) * (double)(i + 1) * 1.4142135623730951); }

/* Sorts the unknowns of look i; taken: of an equation the unknown whose rate is the only one that it alone takes, or -1. */
static void sort(const Looks *s, I i) {
  const Matrix *m = s->matrix;
  const double *fy = s->fy + i * m->nnz, *fyp = s->fyp + i * m->nnz;
  I *list = s->unknowns + i * s->n, moved = 0, core = 0, found = 1;
  for (I j = 0; j < s->n; j++) {
    s->taken[j] = -1, s->kind[j] = ALGEBRAIC;
    for (I k = s->first[j]; k < s->first[j + 1]; k++)
      if (fyp[k] != 0) s->kind[j] = CORE;
  }
  while (found) {
    found = 0;
    for (I j = 0; j < s->n; j++) {
      if (s->kind[j] != CORE) continue;
      I inside = 1, rates = 0, row = 0;
      for (I k = s->first[j]; k < s->first[j + 1]; k++) {
        if (fy[k] != 0 && s->taken[m->row_of[k]] < 0) inside = 0;
        if (fyp[k] != 0) rates++, row = m->row_of[k];
      }
      if (!inside) continue;
      s->kind[j] = MOVED, found = 1;
      list[s->n - 1 - moved++] = j; /* from the end for now */
      if (rates == 1 && s->taken[row] < 0) s->taken[row] = j;
    }
  }
  for (I j = 0; j < moved; j++) s->room[j] = (double)list[s->n - 1 - j];
  for (I j = 0; j < s->n; j++)
    if (s->kind[j] == CORE) list[core++] = j;
  for (I j = 0; j < moved; j++) list[core + j] = (I)s->room[j];
  s->core[i] = core, s->moved[i] = moved;
}

/* S of look i and its core, with the factors that the matrix has; room (n, most) */
static void spectrum(const Looks *s, I i) {
  const Matrix *m = s->matrix;
  sort(s, i);
  const I c = s->core[i], *list = s->unknowns + i * s->n;
  double *S = s->solved + i * s->n * s->most, largest = 0;
  const double *fyp = s->fyp + i * m->nnz, inverse = s->shift / s->h[i];
  if (c > s->most) {
    s->core[i] = 0;
    return;
  }
  memset(S, 0, sizeof(double) * (size_t)(s->n * c));
  for (I j = 0; j < c; j++)
    for (I k = s->first[list[j]]; k < s->first[list[j] + 1]; k++)
      S[m->row_of[k] * c + j] = m->row[m->row_of[k]] * fyp[k] * inverse * m->scale[list[j]];
  lu_solve_columns(m->factors[0], c, S, s->room);
  for (I p = 0; p < s->n; p++) {
    const double f = m->column[p] / m->scale[p];
    for (I j = 0; j < c; j++) S[p * c + j] *= f, largest += fabs(S[p * c + j]);
  }
  for (I p = 0; p < c; p++) memcpy(s->H + (i * s->most * s->most + p * c), S + list[p] * c, sizeof(double) * (size_t)c);
  if (!isfinite(largest)) s->core[i] = 0;
}

/* Whether a root has a positive real part: disturbances x (n, COPIES) are multiplied again and again by 2 S - 1, that is
   (1 + z) / (1 - z) with z = h r, whose magnitude is 1 for undamped vibrations. The first products, with S alone, remove what
   constraints do not allow. */
static I rising(const Looks *s, I i) {
  const Matrix *m = s->matrix;
  const I n = s->n;
  const double inverse = s->shift / s->h[i];
  double *x = s->room, *b = x + COPIES * n, *w = b + COPIES * n, total = 0, last = 0, before = 0, first = 0, second = 0;
  for (I k = 0; k < COPIES * n; k++) x[k] = spread(k);
  for (I round = -3; round < 2 * s->rounds; round++) {
    memset(b, 0, sizeof(double) * (size_t)(COPIES * n));
    for (I k = 0; k < m->nnz; k++) {
      const I p = m->row_of[k], q = m->column_of[k];
      const double e = m->fyp[k] * m->scale[q];
      if (e != 0)
        for (I c = 0; c < COPIES; c++) b[p * COPIES + c] += e * x[q * COPIES + c];
    }
    for (I p = 0; p < n; p++)
      for (I c = 0; c < COPIES; c++) b[p * COPIES + c] *= inverse * m->row[p];
    lu_solve_columns(m->factors[0], COPIES, b, w);
    double sum = 0;
    for (I p = 0; p < n; p++)
      for (I c = 0; c < COPIES; c++) {
        const I k = p * COPIES + c;
        const double found = b[k] * (m->column[p] / m->scale[p]);
        x[k] = round < 0 ? found : 2 * found - x[k];
        sum += x[k] * x[k];
      }
    if (round < 0) continue;
    const double now = sqrt(sum) + 1e-300;
    for (I k = 0; k < COPIES * n; k++) x[k] /= now;
    before = last, last = total += log(now);
    const double larger = fmax(before, last); /* of two that follow each other */
    if (round + 1 == s->rounds / 2) first = larger;
    if (round + 1 == s->rounds) {
      second = larger;
      if (!(second - first > log(s->grows))) return 0;
    }
    if (round + 1 == 2 * s->rounds) return larger - 2 * second + first > log(s->faster);
  }
  return 0;
}

/* All looks from number `from` on; ready: whether the factors are those of that one. The number of looks, or of the one whose
   matrix needs another order of elimination. */
API I growth_spectra(const Looks *s, I from, I ready) {
  Matrix *m = s->matrix;
  for (I i = from; i < s->looks; i++, ready = 0) {
    s->core[i] = s->rises[i] = 0, s->rate[i] = 0;
    if (s->dense) s->beta[i * s->most] = NAN; /* not reduced yet */
    if (!ready) {
      memcpy(m->fy, s->fy + i * m->nnz, sizeof(double) * (size_t)m->nnz);
      memcpy(m->fyp, s->fyp + i * m->nnz, sizeof(double) * (size_t)m->nnz);
      if (matrix_factor(m, s->h[i] / s->shift, 0) >= 0) return i;
    }
    s->rises[i] = s->many ? rising(s, i) : 1;
    if (s->rises[i] && s->dense) spectrum(s, i);
    else if (s->rises[i]) s->rate[i] = 1 / s->h[i];
  }
  return s->looks;
}

/* The eigenvalues of a matrix a (n, n), n = 1 or 2 */
static void closed(I n, const double *a, Pair *value) {
  value[0] = (Pair){a[0], 0};
  if (n == 1) return;
  const double half = (a[0] - a[3]) / 2, mean = (a[0] + a[3]) / 2, square = half * half + a[1] * a[2], root = sqrt(fabs(square));
  if (square < 0) value[0] = (Pair){mean, root}, value[1] = (Pair){mean, -root};
  else { /* the larger one, and the other without cancellation */
    const double far = mean + (mean < 0 ? -root : root);
    value[0] = (Pair){far, 0}, value[1] = (Pair){far != 0 ? (a[0] * a[3] - a[1] * a[2]) / far : 0, 0};
  }
}

/* Roots and rates from the eigenvalues of the cores, those of small ones are found here. */
API void growth_rates(const Looks *s) {
  for (I i = 0; i < s->looks; i++) {
    Pair *values = s->value + i * s->most;
    if (s->core[i] == 1 || s->core[i] == 2) closed(s->core[i], s->H + i * s->most * s->most, values);
    for (I j = 0; j < s->core[i]; j++) {
      const Pair value = values[j];
      Pair *root = s->root + i * s->most + j;
      *root = (Pair){-INFINITY, 0};
      if (!(size(value) * s->resolved > 1)) continue;
      const Pair one = over((Pair){1, 0}, value);
      *root = (Pair){s->shift / s->h[i] * (1 - one.re), -s->shift / s->h[i] * one.im};
      s->rate[i] = fmax(s->rate[i], root->re);
    }
  }
}

/* all (n): the disturbance of positions and moved unknowns to an eigenvalue, from its numbers x in the core; z (n): room */
static void all_of(const Looks *s, I i, Pair value, const Pair *x, Pair *all, Pair *z) {
  const Matrix *m = s->matrix;
  const I c = s->core[i], *list = s->unknowns + i * s->n;
  const double *S = s->solved + i * s->n * s->most, *fy = s->fy + i * m->nnz, *fyp = s->fyp + i * m->nnz, h = s->h[i] / s->shift;
  for (I k = 0; k < s->moved[i] + s->places; k++) {
    const I p = k < s->moved[i] ? list[c + k] : s->place[k - s->moved[i]];
    Pair sum = {0, 0};
    if (s->kind[p] == CORE) continue;
    for (I j = 0; j < c; j++) sum = plus(sum, scaled(S[p * c + j], x[j]));
    all[p] = over(sum, value), z[p] = (Pair){0, 0};
  }
  for (I j = 0; j < c; j++) all[list[j]] = x[j];
  /* moved unknowns, the last first: (value - 1) x = g - h (what those after it move of it), g what the core moves */
  for (I d = s->moved[i]; d-- > 0;) {
    const I j = list[c + d];
    const Pair g = times(all[j], value);
    all[j] = over(minus(g, scaled(h, z[j])), minus(value, (Pair){1, 0}));
    const Pair left = minus(times(value, all[j]), g);
    for (I k = s->first[j]; k < s->first[j + 1]; k++) {
      if (fy[k] == 0) continue;
      const I p = s->taken[m->row_of[k]];
      for (I e = s->first[p]; e < s->first[p + 1]; e++)
        if (fyp[e] != 0) z[p] = plus(z[p], scaled(fy[k] * m->scale[j] / (fyp[e] * m->scale[p]), left));
    }
  }
}

/* Of the roots that grow by more than `least` (natural logarithm) over `span` (s), or, with `idle`, that vibrate and neither
   grow nor decay, up to `excited` over the step, those whose disturbances in the motion are smaller than `seen`. Of every look
   their largest magnitude (k), 0: there are none; their number (k), roots (k, most) and disturbances at the places (k, most,
   places). room holds complex numbers: (4, n) + (2, most, n) + (2, most, most), and 2 most of whole ones. */
API void growth_unseen(const Looks *s, I idle, double span, double least, double excited, double seen, double *magnitude, I *count,
                       Pair *roots, Pair *parts) {
  const I n = s->n, most = s->most;
  Pair *x = (Pair *)s->room, *z = x + n, *l = z + n, *share = l + n, *right = share + n,
       *left = right + most * n, *U = left + most * n, *gram = U + most * most;
  I *swap = (I *)(gram + most * most), *wanted = swap + most;
  for (I i = 0; i < s->looks; i++) {
    const I c = s->core[i], *list = s->unknowns + i * n;
    double *H = s->H + i * most * most, *beta = s->beta + i * most;
    const Pair *value = s->value + i * most, *root = s->root + i * most;
    I w = 0;
    magnitude[i] = 0, count[i] = 0;
    for (I j = 0; j < c; j++) {
      const double re = root[j].re, im = fabs(root[j].im);
      if (!isfinite(re)) continue;
      if (idle ? fabs(re) * span < im && im * span > least && im * s->h[i] < excited : re * span > least) wanted[w++] = j;
    }
    if (!w) continue;
    sort(s, i); /* for what its unknowns take */
    if (!isfinite(beta[0])) hessenberg(c, H, beta, s->room);
    for (I a = 0; a < w; a++) {
      const I j = wanted[a];
      Pair *r = right + a * n, *e = left + a * n;
      shifted(c, H, scaled(1 + BESIDE, value[j]), U, l, swap);
      for (I k = 0; k < c; k++) r[k] = e[k] = (Pair){spread(a * c + k), 0};
      for (I k = 0; k < 2; k++) solved_with(c, U, l, swap, 0, r), solved_with(c, U, l, swap, 1, e);
      reflected(c, H, beta, r), reflected(c, H, beta, e);
    }
    for (I a = 0; a < w; a++) {
      share[a] = (Pair){0, 0};
      for (I k = 0; k < c; k++) share[a] = plus(share[a], scaled(s->motion[i * n + list[k]], left[a * n + k]));
      for (I b = 0; b < w; b++) {
        Pair sum = {0, 0};
        for (I k = 0; k < c; k++) sum = plus(sum, times(left[a * n + k], right[b * n + k]));
        gram[a * w + b] = sum;
      }
    }
    if (eliminated(w, gram, share))
      for (I a = 0; a < w; a++) share[a] = (Pair){0, 0};
    for (I a = 0; a < w; a++) { /* from now on `right` are the disturbances in the motion */
      all_of(s, i, value[wanted[a]], right + a * n, x, z);
      const Pair f = scaled(1 / size(root[wanted[a]]), share[a]);
      for (I p = 0; p < s->places; p++) right[a * n + p] = times(f, x[s->place[p]]);
    }
    for (I a = 0; a < w; a++) { /* equal roots share a plane of disturbances */
      const Pair own = root[wanted[a]];
      double top = 0;
      for (I p = 0; p < s->places; p++) {
        Pair sum = {0, 0};
        for (I b = 0; b < w; b++)
          if (size(minus(root[wanted[b]], own)) < ALIKE * size(own)) sum = plus(sum, right[b * n + p]);
        top = fmax(top, size(sum));
      }
      if (!(top < seen)) continue;
      magnitude[i] = fmax(magnitude[i], size(own));
      roots[i * most + count[i]] = own;
      memcpy(parts + (i * most + count[i]++) * s->places, right + a * n, sizeof(Pair) * (size_t)s->places);
    }
  }
}
