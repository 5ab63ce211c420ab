/* LU factors of numbers of type T, whose functions are called NAME(...); sparse.c takes it in once for real and once for
   complex numbers. */

/* Row by row: -1, or the pivot that is zero, not finite, or too small beside its column. `growth`: the largest product of a
   multiplier and a number of the row that it multiplies, over the largest number of its row of the matrix: what of the digits is
   lost. tops (n): the largest number of every row of U. */
WIDE static I NAME(factor)(const Order *p, const T *restrict a, T *restrict lu, T *restrict w, double *restrict tops, double least,
                           double *growth) {
  const int32_t *col = p->col;
  const I *low = p->low, *up = p->up;
  double top = 0;
  for (I i = 0; i < p->n; i++) {
    const I b = low[i], e = low[i + 1], d = up[i + 1], last = up[i];
    double own = 0, product = 0, row = 0;
    for (I k = b; k < e; k++) w[col[k]] = NAME(of)(0);
    for (I k = d; k < last; k++) w[col[k]] = NAME(of)(0);
    for (I k = p->first[i]; k < p->first[i + 1]; k++) {
      const T x = w[p->to[k]] = a[p->from[k]];
      const double size = NAME(size)(x);
      own = size > own ? size : own;
    }
    for (I k = b; k < e; k++) {
      const I j = col[k], pivot = up[j + 1], r = p->run[j], end = up[j];
      const T l = lu[k] = NAME(times)(w[j], lu[pivot]);
      const double size = NAME(size)(l);
      if (!(size < MOST)) return j;
      product = size * tops[j] > product ? size * tops[j] : product;
      if (size == 0 || pivot + 1 == end) continue;
      for (I m = pivot + 1; m < r; m++) NAME(less)(&w[col[m]], l, lu[m]);
      T *restrict x = w + col[r];
      const T *restrict u = lu + r;
      for (I m = 0; m < end - r; m++) NAME(less)(x + m, l, u[m]);
    }
    for (I k = d; k < last; k++) {
      const double size = NAME(size)(lu[k] = w[col[k]]);
      row = size > row ? size : row;
    }
    tops[i] = row;
    if (product > top * own) top = product / own;
    const double pivot = NAME(size)(lu[d]);
    if (pivot <= least && least > 0) {
      lu[d] = NAME(of)(0);
      continue;
    }
    if (!(pivot > 0 && isfinite(pivot))) return i;
    lu[d] = NAME(inverse)(lu[d]);
  }
  *growth = top;
  return -1;
}

/* The largest of `count` numbers of column j of d (n, n), in the rows of a list. */
static double NAME(largest)(I n, const T *d, const short *rows, I count, I j) {
  double found = 0;
  for (I m = 0; m < count; m++) {
    const double size = NAME(size)(d[rows[m] * n + j]);
    if (size > found) found = size;
  }
  return found;
}

/* Pivots one by one, each with the least product of other entries in its row and in its column, of those that are at least `share`
   of the largest in their column; of equal ones the first as rows and columns are ordered by then. d, at (n, n), row by row:
   numbers, and where entries are; to work with: count, place (2, n) of rows and columns, list (2, n, n) of what is in them, top
   (n). n, or after how many pivots nothing is left to choose from. */
static I NAME(choose)(I n, double share, T *restrict d, char *restrict at, I *restrict rows, I *restrict columns,
                      I *restrict count, I *restrict place, short *restrict list, double *restrict top) {
  I *const row_count = count, *const column_count = count + n, *const row_place = place, *const column_place = place + n;
  short *const in_row = list, *const in_column = list + n * n;
  memset(count, 0, sizeof(I) * 2 * n);
  for (I i = 0; i < n; i++) {
    row_place[rows[i]] = column_place[columns[i]] = i;
    for (I j = 0; j < n; j++)
      if (at[i * n + j]) in_row[i * n + row_count[i]++] = (short)j, in_column[j * n + column_count[j]++] = (short)i;
  }
  for (I j = 0; j < n; j++) top[j] = NAME(largest)(n, d, in_column + j * n, column_count[j], j);
  for (I k = 0; k < n; k++) {
    I r = -1, c = -1, least = 0;
    for (I a = k; a < n; a++) {
      const I i = rows[a];
      for (I m = 0; m < row_count[i]; m++) {
        const I j = in_row[i * n + m], cost = (row_count[i] - 1) * (column_count[j] - 1);
        if (r >= 0 && (cost > least || (cost == least && (a > r || column_place[j] >= c)))) continue;
        if (top[j] > 0 && NAME(size)(d[i * n + j]) >= share * top[j]) r = a, c = column_place[j], least = cost;
      }
    }
    if (r < 0) return k;
    const I i = rows[r], j = columns[c];
    rows[r] = rows[k], rows[k] = i, columns[c] = columns[k], columns[k] = j;
    row_place[rows[r]] = r, row_place[i] = k, column_place[columns[c]] = c, column_place[j] = k;
    take_out(in_row + i * n, &row_count[i], j);
    take_out(in_column + j * n, &column_count[j], i);
    const T inverse = NAME(inverse)(d[i * n + j]);
    for (I a = 0; a < column_count[j]; a++) {
      const I m = in_column[j * n + a];
      const T l = NAME(times)(d[m * n + j], inverse);
      take_out(in_row + m * n, &row_count[m], j);
      for (I b = 0; b < row_count[i]; b++) {
        const I o = in_row[i * n + b];
        if (!at[m * n + o]) {
          at[m * n + o] = 1;
          in_row[m * n + row_count[m]++] = (short)o, in_column[o * n + column_count[o]++] = (short)m;
        }
        NAME(less)(&d[m * n + o], l, d[i * n + o]);
      }
    }
    for (I b = 0; b < row_count[i]; b++) {
      const I o = in_row[i * n + b];
      take_out(in_column + o * n, &column_count[o], i);
      top[o] = NAME(largest)(n, d, in_column + o * n, column_count[o], o);
    }
  }
  return n;
}

/* The solution in place of b. */
WIDE static void NAME(solve)(const Order *p, const T *lu, T *b, T *w) {
  const int32_t *col = p->col;
  for (I i = 0; i < p->n; i++) {
    T v = b[p->rows[i]];
    for (I k = p->low[i]; k < p->low[i + 1]; k++) NAME(less)(&v, lu[k], w[col[k]]);
    w[i] = v;
  }
  for (I i = p->n; i-- > 0;) {
    const I d = p->up[i + 1];
    T v = w[i];
    for (I k = d + 1; k < p->up[i]; k++) NAME(less)(&v, lu[k], w[col[k]]);
    b[p->columns[i]] = w[i] = NAME(times)(v, lu[d]);
  }
}

/* The same for `columns` right-hand sides beside each other, b and w (n, columns). */
WIDE static void NAME(solve_columns)(const Order *p, const T *lu, I columns, T *restrict b, T *restrict w) {
  const int32_t *col = p->col;
  for (I i = 0; i < p->n; i++) {
    T *restrict v = w + i * columns;
    memcpy(v, b + p->rows[i] * columns, sizeof(T) * (size_t)columns);
    for (I k = p->low[i]; k < p->low[i + 1]; k++) {
      const T l = lu[k], *restrict u = w + col[k] * columns;
      for (I c = 0; c < columns; c++) NAME(less)(&v[c], l, u[c]);
    }
  }
  for (I i = p->n; i-- > 0;) {
    const I d = p->up[i + 1];
    T *restrict v = w + i * columns, *restrict to = b + p->columns[i] * columns;
    for (I k = d + 1; k < p->up[i]; k++) {
      const T l = lu[k], *restrict u = w + col[k] * columns;
      for (I c = 0; c < columns; c++) NAME(less)(&v[c], l, u[c]);
    }
    for (I c = 0; c < columns; c++) to[c] = v[c] = NAME(times)(v[c], lu[d]);
  }
}

/* The largest error of a solved system whose solution is known: how slowly Newton's method converges because of the factors. */
static double NAME(defect)(const Factors *f) {
  T *x = (T *)f->w + f->n;
  for (I i = 0; i < f->n; i++) x[i] = NAME(of)(0);
  for (I k = 0; k < f->nnz; k++) NAME(less)(&x[f->row_of[k]], ((T *)f->a)[k], NAME(of)(f->column_of[k] % 2 ? -1 : 1));
  lu_solve(f, x);
  double worst = 0;
  for (I i = 0; i < f->n; i++) {
    NAME(less)(&x[i], NAME(of)(1), NAME(of)(i % 2 ? 1 : -1));
    const double part = NAME(size)(x[i]);
    if (!(part <= worst)) worst = part;
  }
  return worst;
}

/* x, solved for b, with one correction by its residual */
static void NAME(correct)(const Factors *f, const T *b, T *x) {
  T *left = (T *)f->w + f->n;
  for (I i = 0; i < f->n; i++) left[i] = b[i];
  for (I k = 0; k < f->nnz; k++) NAME(less)(&left[f->row_of[k]], ((T *)f->a)[k], x[f->column_of[k]]);
  lu_solve(f, left);
  for (I i = 0; i < f->n; i++) NAME(less)(&x[i], NAME(of)(-1), left[i]);
}

static I NAME(begin)(Factors *f) {
  if (!all_finite(f->a, f->nnz * (I)(sizeof(T) / sizeof(double)))) return f->n;
  if (f->order) {
    double growth = 0;
    const I bad = NAME(factor)(f->order, f->a, f->lu, f->w, f->tops, f->least, &growth);
    if (bad >= 0) return f->order->columns[bad];
    return f->surely || growth < TAME || NAME(defect)(f) < f->accurate ? -1 : f->n;
  }
  int n = (int)f->n, info = 0;
  T *lu = f->lu;
  memset(lu, 0, sizeof(T) * f->n * f->n);
  for (I k = 0; k < f->nnz; k++) lu[f->column_of[k] * f->n + f->row_of[k]] = ((T *)f->a)[k];
  f->getrf(&n, &n, lu, &n, f->swaps, &info);
  if (info > 0) return info - 1;
  return isfinite(NAME(size)(lu[f->n * f->n - 1])) ? -1 : f->n;
}
#undef T
#undef NAME
