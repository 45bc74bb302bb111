/* Numbers that are vectors of LANES doubles: arithmetic by GCC's vector extensions (GCC and Clang), functions below.

   Each lane computes what it would compute alone, so the result for a pose does not depend on its neighbours.
   sin and cos are our own, because compilers do not vectorise libm's: three-part Cody-Waite reduction by pi/2 and the minimax
   polynomials of fdlibm (k_sin.c, k_cos.c: Sun Microsystems 1993, freely redistributable); no more than 2.3e-16 from libm.
   Beyond +-SINCOS_RANGE, and for NaN and infinities, the lane asks libm. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#if defined(__AVX512F__)
#define LANES 8
#define EACH(f) {f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7)}
#else
#define LANES 4
#define EACH(f) {f(0), f(1), f(2), f(3)}
#endif

typedef double V __attribute__((vector_size(8 * LANES)));
typedef long long M __attribute__((vector_size(8 * LANES)));
#define INLINE static inline __attribute__((always_inline, unused))
#define COLD static __attribute__((noinline, cold, unused))

/* Initialisers, not loops: hundreds of little loops are what a compiler spends its time on. */
INLINE V v_all(double x) {
#define SAME(i) x
  return (V)EACH(SAME);
}

INLINE M m_all(long long x) { return (M)EACH(SAME); }

INLINE int m_any(M m) {
  long long any = 0;
  for (int i = 0; i < LANES; i++) any |= m[i];
  return any != 0;
}

#define v_c(x) v_all(x)
#define v_inf v_all(INFINITY)
#define v_nan v_all(NAN)

#define SIGN (~0x7fffffffffffffffLL)

INLINE V v_fabs(V a) { return (V)((M)a & m_all(~SIGN)); }
INLINE V v_copysign(V a, V b) { return (V)(((M)a & m_all(~SIGN)) | ((M)b & m_all(SIGN))); }

/* ---- sine and cosine ---- */

#define SINCOS_RANGE 1e5

COLD V v_libm_sin(V x, M where, V y) {
  for (int i = 0; i < LANES; i++)
    if (where[i]) y[i] = sin(x[i]);
  return y;
}

COLD V v_libm_cos(V x, M where, V y) {
  for (int i = 0; i < LANES; i++)
    if (where[i]) y[i] = cos(x[i]);
  return y;
}

INLINE void v_sincos(V x, V *sine, V *cosine) {
  /* Adding 1.5 * 2^52 rounds to an integer, whose low bits are then those of the sum. pi/2 is split so that k times the
     first two parts is exact up to k = 2^20, with or without fused multiply-add. */
  const V shift = v_all(6755399441055744.0);
  const V t = x * v_all(6.36619772367581382433e-01) + shift;
  const V k = t - shift;
  const M quadrant = (M)t;
  V r = x - k * v_all(1.57079632673412561417e+00);
  r = r - k * v_all(6.07710050630396597660e-11);
  r = r - k * v_all(2.02226624879595063154e-21);
  const V z = r * r;
  V p = v_all(-2.50507602534068634195e-08) + z * v_all(1.58969099521155010221e-10);
  p = v_all(2.75573137070700676789e-06) + z * p;
  p = v_all(-1.98412698298579493134e-04) + z * p;
  p = v_all(8.33333333332248946124e-03) + z * p;
  p = v_all(-1.66666666666666324348e-01) + z * p;
  const V s = v_copysign(r + (r * z) * p, r); /* which matters at -0 only */
  V c = v_all(2.08757232129817482790e-09) + z * v_all(-1.13596475577881948265e-11);
  c = v_all(-2.75573143513906633035e-07) + z * c;
  c = v_all(2.48015872894767294178e-05) + z * c;
  c = v_all(-1.38888888888741095749e-03) + z * c;
  c = v_all(4.16666666666666019037e-02) + z * c;
  const V half = v_all(0.5) * z;
  const V w = v_all(1.0) - half;
  c = w + ((v_all(1.0) - w - half) + (z * z) * c);
  const M odd = -(quadrant & m_all(1));
  const M flip = odd & ((M)s ^ (M)c);
  *sine = (V)(((M)s ^ flip) ^ ((quadrant & m_all(2)) << 62));
  *cosine = (V)(((M)c ^ flip) ^ (((quadrant + m_all(1)) & m_all(2)) << 62));
  const M beyond = ~(M)(v_fabs(x) < v_all(SINCOS_RANGE));
  if (__builtin_expect(m_any(beyond), 0)) {
    *sine = v_libm_sin(x, beyond, *sine);
    *cosine = v_libm_cos(x, beyond, *cosine);
  }
}

/* The same for one number, where libm is not to be asked: its last bit differs between versions and processors. */
COLD double scalar_sin(double x) {
  V s, c;
  v_sincos(v_all(x), &s, &c);
  return s[0];
}

COLD double scalar_cos(double x) {
  V s, c;
  v_sincos(v_all(x), &s, &c);
  return c[0];
}

/* ---- comparisons, logic: truth is the number 1, and anything but 0 is true ---- */

INLINE V v_if(M where, V yes, V no) { return (V)(((M)yes & where) | ((M)no & ~where)); }
INLINE V v_true(M m) { return (V)(m & (M)v_all(1.0)); }
INLINE V v_lt(V a, V b) { return v_true((M)(a < b)); }
INLINE V v_le(V a, V b) { return v_true((M)(a <= b)); }
INLINE V v_eq(V a, V b) { return v_true((M)(a == b)); }
INLINE V v_ne(V a, V b) { return v_true((M)(a != b)); }
INLINE V v_not(V a) { return v_true((M)(a == v_all(0.0))); }
INLINE V v_and(V a, V b) { return v_true((M)(a != v_all(0.0)) & (M)(b != v_all(0.0))); }
INLINE V v_or(V a, V b) { return v_true((M)(a != v_all(0.0)) | (M)(b != v_all(0.0))); }
INLINE V v_if_else_zero(V a, V b) { return (V)((M)(a != v_all(0.0)) & (M)b); }
INLINE V v_sign(V a) { return v_if((M)(a == a) & (M)(a != v_all(0.0)), v_copysign(v_all(1.0), a), a); }
INLINE V v_fmin(V a, V b) { return v_if((M)(a < b) | (M)(b != b), a, b); }
INLINE V v_fmax(V a, V b) { return v_if((M)(a > b) | (M)(b != b), a, b); }

/* ---- libm, lane by lane ---- */

#define LIBM(kind, f)                              \
  kind V v_##f(V a) {                              \
    V y;                                           \
    for (int i = 0; i < LANES; i++) y[i] = f(a[i]); \
    return y;                                      \
  }
#define LIBM2(f)                                         \
  COLD V v_##f(V a, V b) {                               \
    V y;                                                 \
    for (int i = 0; i < LANES; i++) y[i] = f(a[i], b[i]); \
    return y;                                            \
  }
LIBM(INLINE, sqrt)
LIBM(INLINE, floor)
LIBM(INLINE, ceil)
LIBM(COLD, tan)
LIBM(COLD, asin)
LIBM(COLD, acos)
LIBM(COLD, atan)
LIBM(COLD, sinh)
LIBM(COLD, cosh)
LIBM(COLD, tanh)
LIBM(COLD, asinh)
LIBM(COLD, acosh)
LIBM(COLD, atanh)
LIBM(COLD, exp)
LIBM(COLD, expm1)
LIBM(COLD, log)
LIBM(COLD, log1p)
LIBM(COLD, erf)
LIBM2(atan2)
LIBM2(pow)
LIBM2(fmod)
LIBM2(hypot)

/* A square root that the compiler sees as one instruction. */
INLINE V v_root(V a) {
#if defined(__AVX512F__) && !defined(__clang__)
  return __builtin_ia32_sqrtpd512_mask(a, a, -1, 4);
#elif defined(__AVX__) && !defined(__clang__)
  return __builtin_ia32_sqrtpd256(a);
#else
  return v_sqrt(a);
#endif
}

/* ---- rows: element k of LANES consecutive rows of `width` numbers ---- */

INLINE V v_load(const double *row, ptrdiff_t width) {
#define ROW(i) row[(i) * width]
  return (V)EACH(ROW);
}

INLINE void v_store(double *row, ptrdiff_t width, V a) {
  for (int i = 0; i < LANES; i++) row[i * width] = a[i];
}

/* Ask for memory that is written soon: in results that no cache holds, storing costs twice as much without it. Beyond the
   end of an array nothing happens. */
#define AHEAD 8 /* blocks, some 10 kB of a Jacobian */

INLINE void v_expect(const double *at, ptrdiff_t count) {
  for (ptrdiff_t k = 0; k < count; k += 8) __builtin_prefetch(at + k, 1, 3);
}

/* Four neighbouring elements at once: a transposition in registers, then whole quarters of a cache line. */
#if defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector) && defined(__AVX__)
#define SHUFFLES 1
#endif
#endif

INLINE void v_store4(double *row, ptrdiff_t width, V a, V b, V c, V d) {
#if defined(SHUFFLES)
  typedef double Q __attribute__((vector_size(32), aligned(8)));
#define QUAD(lane) (*(Q *)(void *)(row + (lane) * width))
#if LANES == 8
  const V ab0 = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14);
  const V ab1 = __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
  const V cd0 = __builtin_shufflevector(c, d, 0, 8, 2, 10, 4, 12, 6, 14);
  const V cd1 = __builtin_shufflevector(c, d, 1, 9, 3, 11, 5, 13, 7, 15);
  const V r04 = __builtin_shufflevector(ab0, cd0, 0, 1, 8, 9, 4, 5, 12, 13);
  const V r26 = __builtin_shufflevector(ab0, cd0, 2, 3, 10, 11, 6, 7, 14, 15);
  const V r15 = __builtin_shufflevector(ab1, cd1, 0, 1, 8, 9, 4, 5, 12, 13);
  const V r37 = __builtin_shufflevector(ab1, cd1, 2, 3, 10, 11, 6, 7, 14, 15);
  QUAD(0) = __builtin_shufflevector(r04, r04, 0, 1, 2, 3);
  QUAD(1) = __builtin_shufflevector(r15, r15, 0, 1, 2, 3);
  QUAD(2) = __builtin_shufflevector(r26, r26, 0, 1, 2, 3);
  QUAD(3) = __builtin_shufflevector(r37, r37, 0, 1, 2, 3);
  QUAD(4) = __builtin_shufflevector(r04, r04, 4, 5, 6, 7);
  QUAD(5) = __builtin_shufflevector(r15, r15, 4, 5, 6, 7);
  QUAD(6) = __builtin_shufflevector(r26, r26, 4, 5, 6, 7);
  QUAD(7) = __builtin_shufflevector(r37, r37, 4, 5, 6, 7);
#else
  const V ab0 = __builtin_shufflevector(a, b, 0, 4, 2, 6);
  const V ab1 = __builtin_shufflevector(a, b, 1, 5, 3, 7);
  const V cd0 = __builtin_shufflevector(c, d, 0, 4, 2, 6);
  const V cd1 = __builtin_shufflevector(c, d, 1, 5, 3, 7);
  QUAD(0) = __builtin_shufflevector(ab0, cd0, 0, 1, 4, 5);
  QUAD(1) = __builtin_shufflevector(ab1, cd1, 0, 1, 4, 5);
  QUAD(2) = __builtin_shufflevector(ab0, cd0, 2, 3, 6, 7);
  QUAD(3) = __builtin_shufflevector(ab1, cd1, 2, 3, 6, 7);
#endif
#undef QUAD
#else
  v_store(row, width, a);
  v_store(row + 1, width, b);
  v_store(row + 2, width, c);
  v_store(row + 3, width, d);
#endif
}
