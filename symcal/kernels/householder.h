/* A triangle takes in rows by Householder reflections, in every lane a system of its own ([GolubVanLoan2013] sec. 5.1).

   R is NC x NC, row-major, upper triangular: NF unknowns and the right-hand side as its last column. A block has up to
   K rows, column by column, `block[column * K + row]`. Two reflections at once go over the columns behind them,

       H2 H1 c = c - f1 v1 - f2 v2,   f1 = t1 v1.c,   f2 = t2 (v2.c - f1 v1.v2)

   so that each number is fetched and stored half as often. A reflector is [u, column]: u belongs to the row of R. */

typedef struct {
  V u, tau;
} Reflector;

/* From the diagonal element and the sum of squares of the column under it; the new diagonal element goes to *diagonal. */
INLINE Reflector reflector(V *diagonal, V squares) {
  const V alpha = *diagonal;
  const V norm = v_root(alpha * alpha + squares);
  const V signed_norm = v_copysign(norm, alpha);
  const V u = alpha + signed_norm;
  *diagonal = -signed_norm;
  return (Reflector){u, v_if((M)(norm > v_all(0.0)), v_all(1.0) / (signed_norm * u), v_all(0.0))};
}

INLINE V sum_of_products(const V *a, const V *b, int rows) {
  V s0 = v_all(0.0), s1 = s0, s2 = s0, s3 = s0;
  int i = 0;
  for (; i + 3 < rows; i += 4) {
    s0 += a[i] * b[i];
    s1 += a[i + 1] * b[i + 1];
    s2 += a[i + 2] * b[i + 2];
    s3 += a[i + 3] * b[i + 3];
  }
  for (; i < rows; i++) s0 += a[i] * b[i];
  return (s0 + s1) + (s2 + s3);
}

/* Into a register now: GCC would rather fetch a number once for each use, and fetching is what limits these loops. */
INLINE V kept(V a) {
#if defined(__AVX512F__)
  __asm__("" : "+v"(a));
#elif defined(__AVX__)
  __asm__("" : "+x"(a));
#endif
  return a;
}

#define EACH_COLUMN _Pragma("GCC unroll 4")

/* v_i . c_k of COUNT columns from `c` on, then what the reflections take off: d1, d2 become f1, f2. */
#define FACTORS(COUNT)                                                                                    \
  INLINE void factors##COUNT(V *restrict r1, V *restrict r2, const V *v1, const V *v2, const V *c,        \
                             Reflector one, Reflector two, V v1v2, int rows, V *restrict d1,              \
                             V *restrict d2) {                                                            \
    for (int k = 0; k < COUNT; k++) d1[k] = one.u * r1[k], d2[k] = two.u * r2[k];                         \
    V e1[COUNT], e2[COUNT]; /* of odd rows, so that few columns are not waited for one by one */          \
    for (int k = 0; k < COUNT; k++) e1[k] = e2[k] = v_all(0.0);                                           \
    int i = 0;                                                                                            \
    if (COUNT < 4)                                                                                        \
      for (; i + 1 < rows; i += 2) {                                                                      \
        const V a = kept(v1[i]), b = kept(v2[i]), g = kept(v1[i + 1]), h = kept(v2[i + 1]);               \
        EACH_COLUMN for (int k = 0; k < COUNT; k++) {                                                     \
          const V x = kept(c[k * K + i]), y = kept(c[k * K + i + 1]);                                     \
          d1[k] += a * x, d2[k] += b * x, e1[k] += g * y, e2[k] += h * y;                                 \
        }                                                                                                 \
      }                                                                                                   \
    for (; i < rows; i++) {                                                                               \
      const V a = kept(v1[i]), b = kept(v2[i]);                                                           \
      EACH_COLUMN for (int k = 0; k < COUNT; k++) {                                                       \
        const V x = kept(c[k * K + i]);                                                                   \
        d1[k] += a * x, d2[k] += b * x;                                                                   \
      }                                                                                                   \
    }                                                                                                     \
    for (int k = 0; k < COUNT; k++) {                                                                     \
      if (COUNT < 4) d1[k] += e1[k], d2[k] += e2[k];                                                      \
      d1[k] = one.tau * d1[k];                                                                            \
      d2[k] = two.tau * (d2[k] - d1[k] * v1v2);                                                           \
      r1[k] -= d1[k] * one.u;                                                                             \
      r2[k] -= d2[k] * two.u;                                                                             \
    }                                                                                                     \
  }
FACTORS(4)
FACTORS(2)
FACTORS(1)

#define BEHIND(COUNT)                                                                                     \
  INLINE void behind##COUNT(V *restrict r1, V *restrict r2, const V *restrict v1, const V *restrict v2,   \
                            V *restrict c, Reflector one, Reflector two, V v1v2, int rows) {              \
    V d1[COUNT], d2[COUNT];                                                                               \
    factors##COUNT(r1, r2, v1, v2, c, one, two, v1v2, rows, d1, d2);                                      \
    for (int i = 0; i < rows; i++) {                                                                      \
      const V a = kept(v1[i]), b = kept(v2[i]);                                                           \
      EACH_COLUMN for (int k = 0; k < COUNT; k++) c[k * K + i] = c[k * K + i] - d1[k] * a - d2[k] * b;    \
    }                                                                                                     \
  }
BEHIND(4)
BEHIND(2)
BEHIND(1)

/* What the next reflection needs: squares of its column, and its product with the next one. */
typedef struct {
  V squares, product;
} Ahead;

/* Two columns as behind2; they are the next to be reflected. */
INLINE Ahead behind_and_ahead(V *restrict r1, V *restrict r2, const V *restrict v1, const V *restrict v2,
                              V *restrict c, Reflector one, Reflector two, V v1v2, int rows) {
  V d1[2], d2[2], s0 = v_all(0.0), s1 = s0, p0 = s0, p1 = s0;
  factors2(r1, r2, v1, v2, c, one, two, v1v2, rows, d1, d2);
  int i = 0;
  for (; i + 1 < rows; i += 2) {
    const V x = c[i] - d1[0] * v1[i] - d2[0] * v2[i], y = c[K + i] - d1[1] * v1[i] - d2[1] * v2[i];
    const V z = c[i + 1] - d1[0] * v1[i + 1] - d2[0] * v2[i + 1];
    const V w = c[K + i + 1] - d1[1] * v1[i + 1] - d2[1] * v2[i + 1];
    c[i] = x, c[K + i] = y, c[i + 1] = z, c[K + i + 1] = w;
    s0 += x * x, p0 += x * y, s1 += z * z, p1 += z * w;
  }
  for (; i < rows; i++) {
    const V x = c[i] - d1[0] * v1[i] - d2[0] * v2[i], y = c[K + i] - d1[1] * v1[i] - d2[1] * v2[i];
    c[i] = x, c[K + i] = y;
    s0 += x * x, p0 += x * y;
  }
  return (Ahead){s0 + s1, p0 + p1};
}

/* Reflections j and j + 1. */
INLINE Ahead two_columns(V *restrict triangle, V *restrict block, int j, Ahead here, int rows) {
  V *const r1 = triangle + j * NC, *const r2 = r1 + NC;
  V *const v1 = block + j * K, *const v2 = v1 + K;
  const Reflector one = reflector(r1 + j, here.squares);
  const V f = one.tau * (one.u * r1[j + 1] + here.product);
  r1[j + 1] -= f * one.u;
  V s0 = v_all(0.0), s1 = s0, p0 = s0, p1 = s0;
  int i = 0;
  for (; i + 1 < rows; i += 2) {
    const V a = v2[i] - f * v1[i], b = v2[i + 1] - f * v1[i + 1];
    v2[i] = a, v2[i + 1] = b;
    s0 += a * a, p0 += a * v1[i], s1 += b * b, p1 += b * v1[i + 1];
  }
  for (; i < rows; i++) {
    const V a = v2[i] - f * v1[i];
    v2[i] = a;
    s0 += a * a, p0 += a * v1[i];
  }
  const Reflector two = reflector(r2 + j + 1, s0 + s1);
  const V v1v2 = p0 + p1;
  Ahead next = {v_all(0.0), v_all(0.0)};
  int c = j + 2;
  if (c < NF) {
    next = behind_and_ahead(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
    c += 2;
  }
  for (; c + 3 < NC; c += 4) behind4(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
  if (c + 1 < NC) {
    behind2(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
    c += 2;
  }
  if (c < NC) behind1(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
  return next;
}

/* `rows` rows of the block, which is spoilt. */
static __attribute__((noinline)) void absorb(V *restrict triangle, V *restrict block, int rows) {
  Ahead here = {sum_of_products(block, block, rows), sum_of_products(block, block + K, rows)};
  int j = 0;
  for (; j + 1 < NF; j += 2) here = two_columns(triangle, block, j, here, rows);
  if (j == NF) return;
  V *const last = triangle + j * NC; /* only the right-hand side is behind it */
  const Reflector one = reflector(last + j, here.squares);
  last[NF] -= one.tau * (one.u * last[NF] + here.product) * one.u;
}
