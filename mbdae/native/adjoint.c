/* Linear equations of all stages of an implicit step, and derivatives of a run along such steps.

   Stages Y_j of a collocation method satisfy F(t_j, Y_j, Y'_j) = 0 with Y' = A^-1 (Y - y0) / h. Their derivatives solve M x = r with

       (M x)_j = dF/dy'_j sum_k A^-1[j, k] x_k / h + dF/dy_j x_j,

   the weights of an adjoint M^T x = r. Both are solved by the matrices of Newton's method, with the derivatives of one stage in all,
   which the eigenvalues of A^-1 make equations of n unknowns; what is left is solved again until it is round-off. */
#include "sparse.h"

enum { MOST_CORRECTIONS = 40, SLOW = 3 };
/* A solution stands where further corrections, falling as they did, would be at most SETTLED times as large, or where corrections
   below ROUGH, which round-off leaves, do not fall any more. */
static const double SETTLED = 1e-11, ROUGH = 1e-9;

/* `order` (nnz): the entries of dF/dy in the order of those of the matrix, whose pattern is transposed where `transposed` is 1.
   T, T_inv (s, s): rows of T_inv give the real parts, then real and imaginary parts of every pair, whose sign is `sign`. stage: whose
   derivatives all have in the matrix. r, x, mixed (s, n): room. */
typedef struct {
  I s, n, nnz, transposed, stage;
  const I *row_of, *column_of, *order;
  const double *A_inv, *T, *T_inv;
  double sign;
  Matrix *matrix;
  double *r, *x, *mixed, *pair;
} Stages;

static inline void add(I P, double factor, const double *x, double *to) {
  for (I c = 0; c < P; c++) to[c] += factor * x[c];
}

/* out = M x, for x (s, n, columns) */
WIDE static void product(const Stages *a, I P, double h, const double *restrict fy, const double *restrict fyp, const double *x,
                         double *out, double *mixed) {
  const I s = a->s, size = a->n * P;
  memset(mixed, 0, sizeof(double) * (size_t)(s * size));
  memset(out, 0, sizeof(double) * (size_t)(s * size));
  for (I j = 0; j < s && !a->transposed; j++)
    for (I k = 0; k < s; k++)
      for (I i = 0; i < size; i++) mixed[j * size + i] += a->A_inv[j * s + k] / h * x[k * size + i];
  for (I j = 0; j < s; j++, fy += a->nnz, fyp += a->nnz)
    for (I e = 0; e < a->nnz; e++) {
      const I row = j * size + a->row_of[e] * P, column = j * size + a->column_of[e] * P;
      const double u = fy[e], v = fyp[e];
      if (u != 0) add(P, u, x + (a->transposed ? row : column), out + (a->transposed ? column : row));
      if (v != 0) add(P, v, a->transposed ? x + row : mixed + column, a->transposed ? mixed + column : out + row);
    }
  for (I j = 0; j < s && a->transposed; j++)
    for (I k = 0; k < s; k++)
      for (I i = 0; i < size; i++) out[k * size + i] += a->A_inv[j * s + k] / h * mixed[j * size + i];
}

/* to = B from for B (s, s), or its transpose */
WIDE static void mix(I s, I size, const double *B, I transposed, const double *restrict from, double *restrict to) {
  memset(to, 0, sizeof(double) * (size_t)(s * size));
  for (I j = 0; j < s; j++)
    for (I k = 0; k < s; k++) {
      const double b = transposed ? B[k * s + j] : B[j * s + k];
      for (I i = 0; i < size; i++) to[j * size + i] += b * from[k * size + i];
    }
}

/* x (n, columns): rows times factors */
static void scale(I n, I P, const double *factor, double *x) {
  for (I i = 0; i < n; i++)
    for (I c = 0; c < P; c++) x[i * P + c] *= factor[i];
}

/* r (s, n, columns) becomes what solves the equations approximately. */
static void approximately(const Stages *a, I P, double *r) {
  const Matrix *m = a->matrix;
  const I n = a->n, size = n * P;
  double *w = a->mixed, *one = w;
  Pair *z = (Pair *)a->pair;
  mix(a->s, size, a->transposed ? a->T : a->T_inv, a->transposed, r, w);
  for (I j = 0; j < m->reals; j++, one += size) {
    scale(n, P, m->row, one);
    if (P == 1) lu_solve(m->factors[j], one);
    else lu_solve_columns(m->factors[j], P, one, z);
    scale(n, P, m->column, one);
  }
  const double sign = a->transposed ? -a->sign : a->sign;
  for (I j = 0; j < m->pairs; j++, one += 2 * size) {
    scale(n, P, m->row, one);
    scale(n, P, m->row, one + size);
    for (I i = 0; i < size; i++) z[i] = (Pair){one[i], sign * one[size + i]};
    if (P == 1) lu_solve(m->factors[m->reals + j], z);
    else lu_solve_columns(m->factors[m->reals + j], P, z, z + size);
    for (I i = 0; i < size; i++) one[i] = z[i].re, one[size + i] = sign * z[i].im;
    scale(n, P, m->column, one);
    scale(n, P, m->column, one + size);
  }
  mix(a->s, size, a->transposed ? a->T_inv : a->T, a->transposed, w, r);
}

/* The largest ratio of a step to x among the columns, each measured by its largest unknown. */
static double share_of(const Stages *a, I P, const double *step, const double *x) {
  double worst = 0;
  for (I c = 0; c < P; c++) {
    double now = 0, whole = 0;
    for (I j = 0, at = c; j < a->s; j++)
      for (I i = 0; i < a->n; i++, at += P) {
        const double unit = 1 / a->matrix->column[i], part = fabs(step[at] * unit), all = fabs(x[at] * unit);
        if (!isfinite(part)) return NAN;
        if (part > now) now = part;
        if (all > whole) whole = all;
      }
    if (whole > 0 && now > worst * whole) worst = now / whole;
  }
  return worst;
}

/* The solution x (s, n, columns) for r; NOT_FINITE where corrections do not become small. */
static int solved(const Stages *a, I P, double h, const double *fy, const double *fyp, const double *r, double *x) {
  const I size = a->s * a->n * P;
  double *step = a->r, before = INFINITY;
  I slow = 0;
  memset(x, 0, sizeof(double) * (size_t)size);
  memcpy(step, r, sizeof(double) * (size_t)size);
  for (I k = 0; k < MOST_CORRECTIONS; k++) {
    approximately(a, P, step);
    for (I i = 0; i < size; i++) x[i] += step[i];
    const double now = share_of(a, P, step, x);
    if (!isfinite(now)) return NOT_FINITE;
    const double left = k && now < before ? now * now / (before - now) : now; /* the sum of all corrections that would follow */
    if (left <= SETTLED || (now > 0.3 * before && now <= ROUGH)) return DONE;
    if (now > 0.8 * before && ++slow > SLOW) return NOT_FINITE;
    before = now;
    product(a, P, h, fy, fyp, x, step, a->mixed);
    for (I i = 0; i < size; i++) step[i] = r[i] - step[i];
  }
  return NOT_FINITE;
}

/* Steps of a run: h and middles (steps), times (steps, s), unknowns and rates of F at their stages Y, Yp (steps, s, n), derivatives fy,
   fyp (steps, s, nnz). own: number of unknowns of the run, the first of those of F; of: derivatives of F by numbers; side: takes the
   time at which conditions of inputs are read, inside the step. */
typedef struct {
  const double *h, *middles, *times, *Y, *Yp, *fy, *fyp;
  I own;
  void *of;
  double *side;
} Path;

/* -1, or that the matrix has to be factorised in another order, by the caller, who then calls again with `ready`. Unknowns are
   scaled by every step: beside touches a step may be a million times shorter than the one before it. */
static I factored(const Stages *a, const Path *p, I m, I ready) {
  const I at = (m * a->s + a->stage) * a->nnz;
  Matrix *to = a->matrix;
  *p->side = p->middles[m];
  if (ready) return -1;
  memset(to->scale, 0, sizeof(double) * (size_t)a->n);
  for (I e = 0; e < a->nnz; e++) {
    to->fy[e] = p->fy[at + a->order[e]], to->fyp[e] = p->fyp[at + a->order[e]];
    double *largest = to->scale + to->column_of[e];
    *largest = fmax(*largest, fabs(to->fy[e]) + fabs(to->fyp[e]) / p->h[m]);
  }
  for (I i = 0; i < a->n; i++) to->scale[i] = to->scale[i] > 0 ? 1 / to->scale[i] : 1;
  return matrix_factor(to, p->h[m], 0);
}

static int at_stages(const Stages *a, const Path *p, I m, const double *weights, double *out) {
  const I at = m * a->s;
  return twins_states(p->of, at, a->s, p->times + at, p->Y + at * a->n, p->Yp + at * a->n, weights, out);
}

/* From the end of step *m - 1 to the beginning of the first: total (own) becomes the weights of y there; ends (steps, own), inner
   (steps, s - 1, own): those of y at the beginnings of steps, and of the increments. RAISED: see `factored`; *m: what is left. */
API int stages_back(const Stages *a, const Path *p, I *m, I ready, const double *ends, const double *inner, double *total) {
  const I n = a->n, s = a->s, own = p->own;
  double *weights = a->x, *v = a->x + s * n;
  for (; *m > 0; --*m, ready = 0) {
    const I k = *m - 1, at = k * s * a->nnz;
    if (factored(a, p, k, ready) >= 0) return RAISED;
    memset(weights, 0, sizeof(double) * (size_t)(s * n));
    for (I j = 0; j < s; j++)
      for (I i = 0; i < own; i++) weights[j * n + i] = -(j == s - 1 ? total[i] : inner[(k * (s - 1) + j) * own + i]);
    int code = solved(a, 1, p->h[k], p->fy + at, p->fyp + at, weights, v);
    if (!code) code = at_stages(a, p, k, v, weights);
    if (code) return code;
    for (I i = 0; i < own; i++) {
      total[i] += ends[k * own + i];
      for (I j = 0; j < s; j++) total[i] += weights[j * n + i];
    }
  }
  return DONE;
}

/* Steps from *m on: S (steps + 1, own, columns), the first row given, derivatives of y; inner (steps, s - 1, own, columns): of the
   increments; room (s, n, columns). RAISED: see `factored`; *m: the step that is not made. */
API int stages_along(const Stages *a, const Path *p, I *m, I steps, I ready, I columns, double *S, double *inner, double *room) {
  const I n = a->n, s = a->s, own = p->own;
  double *x = a->x;
  for (; *m < steps; ++*m, ready = 0) {
    const I k = *m, at = k * s * a->nnz;
    const double *before = S + k * own * columns;
    if (factored(a, p, k, ready) >= 0) return RAISED;
    int code = at_stages(a, p, k, NULL, room);
    for (I j = 0; j < s; j++)
      for (I e = 0; e < a->nnz; e++) {
        const double v = p->fy[at + j * a->nnz + e];
        const I column = a->column_of[e];
        double *to = room + (j * n + a->row_of[e]) * columns;
        for (I c = 0; v != 0 && column < own && c < columns; c++) to[c] += v * before[column * columns + c];
      }
    for (I i = 0; i < s * n * columns; i++) room[i] = -room[i];
    if (!code) code = solved(a, columns, p->h[k], p->fy + at, p->fyp + at, room, x);
    for (I j = 0; j < s - 1; j++)
      memcpy(inner + (k * (s - 1) + j) * own * columns, x + j * n * columns, sizeof(double) * (size_t)(own * columns));
    for (I i = 0; i < own * columns; i++) S[(k + 1) * own * columns + i] = before[i] + x[(s - 1) * n * columns + i];
    if (code) return code;
  }
  return DONE;
}

/* Small disturbances x (n, CARRIED) of a run, over the scales of the unknowns, carried along pieces of it by steps of a
   collocation method. nnz entries of dF/dy and dF/dy' at every state, the columns of a state beginning at `first`. Where
   `stages` is above 1, equations at all stages are solved together for the rates there, by the matrix (stages n, stages n); A,
   b: its table. Else those in the middle of a piece are solved for every eigenvalue of A^-1, and `weights` of these solutions,
   real ones and then complex ones, are added up. kind (n): 0 what moves slowly, 1 velocities, 2 what follows from the others,
   whose disturbance is 0. */
enum { CARRIED = 2 };
typedef struct {
  Matrix *matrix;
  I n, nnz, stages;
  const I *first, *row_of, *column_of, *kind;
  const double *scale, *A, *b, *weights;
  double *x, *r, *w;      /* (n, CARRIED), (stages, n, CARRIED), (2, stages, n, CARRIED) */
  double size, least;     /* natural logarithm of the factor by which they grew, and the least of it so far */
  double most, vanished;  /* it ends where size exceeds the least by `most`, or where less than `vanished` is left in a piece */
  I bad, ended;           /* results: which factors need another order of elimination; 1: grown enough, 2: nothing left */
} Carry;

/* The matrix for all stages of a piece of h */
static void together(const Carry *a, double h, const double *fy, const double *fyp) {
  const I s = a->stages;
  double *to = a->matrix->fy;
  for (I j = 0; j < s; j++)
    for (I c = 0; c < a->n; c++)
      for (I i = 0; i < s; i++)
        for (I e = a->first[c]; e < a->first[c + 1]; e++)
          *to++ = h * a->A[i * s + j] * fy[i * a->nnz + e] + (i == j ? fyp[i * a->nnz + e] : 0);
}

/* r (stages, n, CARRIED) = -dF/dy x, solved for the rates: x at the end of the piece */
static void by_stages(const Carry *a, double h, const double *fy) {
  const Matrix *m = a->matrix;
  const I s = a->stages, n = a->n;
  memset(a->r, 0, sizeof(double) * (size_t)(s * n * CARRIED));
  for (I i = 0; i < s; i++, fy += a->nnz)
    for (I e = 0; e < a->nnz; e++)
      add(CARRIED, -fy[e] * a->scale[a->column_of[e]], a->x + a->column_of[e] * CARRIED, a->r + (i * n + a->row_of[e]) * CARRIED);
  scale(s * n, CARRIED, m->row, a->r);
  lu_solve_columns(m->factors[0], CARRIED, a->r, a->w);
  scale(s * n, CARRIED, m->column, a->r);
  for (I j = 0; j < s; j++)
    for (I i = 0; i < n; i++) add(CARRIED, h * a->b[j] / a->scale[i], a->r + (j * n + i) * CARRIED, a->x + i * CARRIED);
}

/* The same with the equations in the middle of the piece */
static void by_middle(const Carry *a, double h, const double *fyp) {
  const Matrix *m = a->matrix;
  const I size = a->n * CARRIED;
  double *right = a->r, *one = a->w;
  Pair *z = (Pair *)a->w;
  memset(right, 0, sizeof(double) * (size_t)size);
  for (I e = 0; e < a->nnz; e++)
    add(CARRIED, fyp[e] * a->scale[a->column_of[e]] / h, a->x + a->column_of[e] * CARRIED, right + a->row_of[e] * CARRIED);
  scale(a->n, CARRIED, m->row, right);
  memset(a->x, 0, sizeof(double) * (size_t)size);
  for (I j = 0; j < m->reals; j++) {
    memcpy(one, right, sizeof(double) * (size_t)size);
    lu_solve_columns(m->factors[j], CARRIED, one, one + size);
    for (I i = 0; i < size; i++) a->x[i] += a->weights[j] * one[i];
  }
  for (I j = 0; j < m->pairs; j++) {
    const double *weight = a->weights + m->reals + 2 * j;
    for (I i = 0; i < size; i++) z[i] = (Pair){right[i], 0};
    lu_solve_columns(m->factors[m->reals + j], CARRIED, z, z + size);
    for (I i = 0; i < size; i++) a->x[i] += 2 * (weight[0] * z[i].re - weight[1] * z[i].im);
  }
  for (I i = 0; i < a->n; i++)
    for (I c = 0; c < CARRIED; c++) a->x[i * CARRIED + c] *= m->column[i] / a->scale[i];
}

/* Pieces of lengths h (s) from number `from` on, fy and fyp (pieces, stages, nnz): size (pieces, 2), the sizes of slow unknowns
   and of velocities at their ends, natural logarithms. The number of pieces, or of that at which it ended (`bad`, `ended`);
   ready: the factors are those of the first one. */
API I stages_carry(Carry *a, I pieces, I from, I ready, const double *h, const double *fy, const double *fyp, double *size) {
  Matrix *m = a->matrix;
  const I each = a->stages * a->nnz;
  for (I k = from; k < pieces; k++, ready = 0) {
    if (!ready) {
      if (a->stages > 1) together(a, h[k], fy + k * each, fyp + k * each);
      else {
        memcpy(m->fy, fy + k * each, sizeof(double) * (size_t)each);
        memcpy(m->fyp, fyp + k * each, sizeof(double) * (size_t)each);
      }
      a->bad = matrix_factor(m, h[k], 0);
      if (a->bad >= 0) return k;
    }
    if (a->stages > 1) by_stages(a, h[k], fy + k * each);
    else by_middle(a, h[k], fyp + k * each);
    double sums[3] = {0, 0, 0};
    for (I i = 0; i < a->n; i++)
      for (I c = 0; c < CARRIED; c++) {
        double *x = a->x + i * CARRIED + c;
        if (a->kind[i] == 2) *x = 0;
        sums[a->kind[i]] += *x * *x;
      }
    const double now = sqrt(sums[0] + sums[1]);
    if (!(isfinite(now) && now > a->vanished)) {
      a->ended = 2;
      return k;
    }
    for (I kind = 0; kind < 2; kind++) size[2 * k + kind] = log(fmax(sqrt(sums[kind]), 1e-300)) + a->size;
    for (I i = 0; i < a->n * CARRIED; i++) a->x[i] /= now;
    a->size += log(now);
    a->least = fmin(a->least, a->size);
    if (a->size - a->least > a->most) {
      a->ended = 1;
      return k + 1;
    }
  }
  return pieces;
}
