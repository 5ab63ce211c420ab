/* LU factors of matrices whose entries lie in one pattern by columns, and the iteration matrices made of them: sparse.c. */
#ifndef MBDAE_SPARSE_H
#define MBDAE_SPARSE_H
#include "core.h"
typedef struct { double re, im; } Pair; /* a complex number */

/* L + U in the order of elimination, pivots on the diagonal: the rows of L from the first to the last, then those of U from the
   last to the first, as solutions read them. Row i of L is low[i] ... low[i + 1], row i of U, its pivot first, up[i + 1] ... up[i].
   Every entry has its column `col`, rising in each row; from `run` on those of a row of U follow each other without a gap. Row i
   begins with the entries from[first[i] ... first[i + 1]] of the matrix, in the columns `to`. Pivot i is in row rows[i] and column
   columns[i] of the matrix. */
typedef struct { I n; const I *low, *up, *run, *first, *rows, *columns; const int32_t *col, *from, *to; } Order;

typedef void Getrf(int *m, int *n, void *a, int *lda, int *swaps, int *info);
typedef void Getrs(char *trans, int *n, int *columns, void *a, int *lda, int *swaps, void *b, int *ldb, int *info);

/* The factors of one matrix: in an order, else (swaps) dense ones of LAPACK, else none yet. Numbers are real or complex. */
typedef struct {
  I n, nnz, complex;
  const I *row_of, *column_of;        /* (nnz) of the entries */
  const Order *order;
  I surely;                           /* no check of the factors: their order was found for these entries, with row exchanges */
  double least;                       /* pivots up to it count as 0: their unknowns are left out, and their inverse pivot is 0 */
  double accurate;                    /* factors that solve worse than this are those of a bad order */
  void *a, *lu, *w;                   /* (nnz) entries, the factors, (2, n) to work with */
  double *tops;                       /* (n) largest numbers of the rows of U */
  int *swaps; Getrf *getrf; Getrs *getrs;
} Factors;

/* dF/dy + (lambda / h) dF/dy' for several lambda: real ones first, then complex ones. Unknowns enter multiplied by `column`,
   equations by `row`. */
typedef struct {
  I n, nnz, reals, pairs, ready;        /* ready: the factors are those of the last step asked for */
  const I *row_of, *column_of;
  double *scale;                        /* (n): may be renewed before a matrix is factorised */
  const double *power, *lambda;         /* (n), (reals + 2 pairs): real and imaginary parts behind each other */
  double *fy, *fyp, *row, *column, *w;  /* (nnz), (nnz), (n), (n), (3, n) */
  Factors *const *factors;
} Matrix;

API I lu_fill(I n, const I *rows, const I *columns, I most, I *ptr, I *col, I *diag, I *next);
API I lu_choose(I n, I complex, double share, void *d, char *at, I *rows, I *columns, I *count, I *place, short *list, double *top);
API I lu_factor(Factors *f);
API void lu_solve(const Factors *f, void *b);
API void lu_solve_columns(const Factors *f, I columns, void *b, void *w);
API void lu_solve_each(const Factors *f, I times, double *b);
API void lu_correct(const Factors *f, const void *b, void *x);
API I matrix_factor(Matrix *m, double h, I first);
API void matrix_mass(const Matrix *m, const double *x, double *out);
API void matrix_correct(const Matrix *m, double *b);
API void matrix_noise(const Matrix *m, const double *y, const double *yp, double *out);
#endif
