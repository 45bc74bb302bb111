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
#if defined(__AVX512F__)
#define KEEP(a) __asm__("" : "+v"(a))
#elif defined(__AVX__)
#define KEEP(a) __asm__("" : "+x"(a))
#else
#define KEEP(a) (void)(a)
#endif

/* COUNT columns from `c` on, under both reflectors. */
#define BEHIND(COUNT)                                                                                   \
  INLINE void behind##COUNT(V *restrict r1, V *restrict r2, const V *restrict v1, const V *restrict v2, \
                            V *restrict c, Reflector one, Reflector two, V v1v2, int rows) {            \
    V d1[COUNT], d2[COUNT];                                                                             \
    for (int k = 0; k < COUNT; k++) d1[k] = one.u * r1[k], d2[k] = two.u * r2[k];                       \
    for (int i = 0; i < rows; i++) {                                                                    \
      V a = v1[i], b = v2[i];                                                                           \
      KEEP(a);                                                                                          \
      KEEP(b);                                                                                          \
      for (int k = 0; k < COUNT; k++) {                                                                 \
        V e = c[k * K + i];                                                                             \
        KEEP(e);                                                                                        \
        d1[k] += a * e;                                                                                 \
        d2[k] += b * e;                                                                                 \
      }                                                                                                 \
    }                                                                                                   \
    for (int k = 0; k < COUNT; k++) {                                                                   \
      d1[k] = one.tau * d1[k];                                                                          \
      d2[k] = two.tau * (d2[k] - d1[k] * v1v2);                                                         \
      r1[k] -= d1[k] * one.u;                                                                           \
      r2[k] -= d2[k] * two.u;                                                                           \
    }                                                                                                   \
    for (int i = 0; i < rows; i++) {                                                                    \
      V a = v1[i], b = v2[i];                                                                           \
      KEEP(a);                                                                                          \
      KEEP(b);                                                                                          \
      for (int k = 0; k < COUNT; k++) c[k * K + i] = c[k * K + i] - d1[k] * a - d2[k] * b;              \
    }                                                                                                   \
  }
BEHIND(4)
BEHIND(2)
BEHIND(1)

INLINE void two_columns(V *restrict triangle, V *restrict block, int j, int rows) {
  V *const r1 = triangle + j * NC, *const r2 = r1 + NC;
  V *const v1 = block + j * K, *const v2 = v1 + K;
  const Reflector one = reflector(r1 + j, sum_of_products(v1, v1, rows));
  const V f = one.tau * (one.u * r1[j + 1] + sum_of_products(v1, v2, rows));
  r1[j + 1] -= f * one.u;
  V s0 = v_all(0.0), s1 = s0, p0 = s0, p1 = s0;
  int i = 0;
  for (; i + 1 < rows; i += 2) {
    const V a = v2[i] - f * v1[i], b = v2[i + 1] - f * v1[i + 1];
    v2[i] = a;
    v2[i + 1] = b;
    s0 += a * a;
    p0 += a * v1[i];
    s1 += b * b;
    p1 += b * v1[i + 1];
  }
  for (; i < rows; i++) {
    const V a = v2[i] - f * v1[i];
    v2[i] = a;
    s0 += a * a;
    p0 += a * v1[i];
  }
  const Reflector two = reflector(r2 + j + 1, s0 + s1);
  const V v1v2 = p0 + p1;
  int c = j + 2;
  for (; c + 3 < NC; c += 4) behind4(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
  if (c + 1 < NC) {
    behind2(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
    c += 2;
  }
  if (c < NC) behind1(r1 + c, r2 + c, v1, v2, block + c * K, one, two, v1v2, rows);
}

INLINE void last_column(V *restrict triangle, const V *restrict block, int j, int rows) {
  V *const r1 = triangle + j * NC;
  const V *const v1 = block + j * K;
  const Reflector one = reflector(r1 + j, sum_of_products(v1, v1, rows));
  r1[NF] -= one.tau * (one.u * r1[NF] + sum_of_products(v1, block + NF * K, rows)) * one.u;
}

INLINE void absorb_rows(V *restrict triangle, V *restrict block, int rows) {
  int j = 0;
  for (; j + 1 < NF; j += 2) two_columns(triangle, block, j, rows);
  if (j < NF) last_column(triangle, block, j, rows);
}

/* Twice the same text: with K known the compiler does better. The block is spoilt. */
static __attribute__((noinline)) void absorb(V *restrict triangle, V *restrict block, int rows) {
  if (rows == K)
    absorb_rows(triangle, block, K);
  else
    absorb_rows(triangle, block, rows);
}
