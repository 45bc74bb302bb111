/* Levenberg-Marquardt for many problems of one kind, one in each lane; `fit_source` writes what it is about.

   |prior x|^2 + |w (h(q, x) - z)|^2 -> min, by damped steps from triangles that all rows were taken into (householder.h).
   The first trial of a step is undamped; one that does not lower the cost is tried again with 1e-3, 1e-2, ... on the
   scaled unknowns. A lane has converged when what the linear model promises can be wrong by no more than a share `small`
   of the cost: the promised step is then made without looking. Or when an accepted step gained no more than that share.
   Undamped steps shrink at least in the ratio of this one to the last: that much of the promise is taken to be wrong,
   and a hundred times more to be safe from curvature that no step shows.
   What a lane has found no longer changes, whatever its neighbours still do. */

enum { CONVERGED = 0, TOO_MANY = 1, NOT_FINITE = 2 };

typedef struct {
  ptrdiff_t problems, poses, x_stride;
  const double *q, *x, *setup, *z, *w, *prior, *width;
  double unit, small, nothing, evaluations;
  double *found, *cost, *factor;
  long long *counts; /* accepted steps, evaluations, how it ended */
} Job;

/* An element of the array of pose i, of the problem in each lane. */
INLINE V lane_by_lane(const double *element, const ptrdiff_t *who, ptrdiff_t stride) {
#define OF(lane) element[who[lane] * stride]
  return (V)EACH(OF);
}
#define LANE_BY_LANE(array, size, k) lane_by_lane((array) + i * (size) + (k), who, job->poses * (size))

/* Written for the measurement. Tables hold what depends on nothing else than poses, readings or errors. */
static void shared_values(const Job *job, double *shared);
static void pose_values(const Job *job, ptrdiff_t i, const double *shared, double *by_pose);
static void reading_values(const Job *job, const ptrdiff_t *who, ptrdiff_t i, const double *shared,
                           const double *by_pose, V *by_reading);
static void error_values(const V *x, const double *shared, V *by_error);
static void pose_rows(const double *restrict shared, const double *restrict by_pose, const V *restrict by_reading,
                      const V *restrict by_error, V *restrict block);
static int has_missing(const double *by_pose, const V *by_reading);
static void without_missing(const double *by_pose, const V *by_reading, V *block);
static void known_rows(const Job *job, const V *x, V *triangle, V *block, V *squares);

#define FIRST_DAMPING 1e-3
#define CAUTION 100.0
#define LEAST_DAMPING 1e-7 /* below that of a step it is none */

INLINE M m_finite(V a) { return (M)((a - a) == v_all(0.0)); }

/* s with R s = -g, g the last column, over the upper triangle of `rows`. */
INLINE void back_substituted(const V *restrict triangle, V *restrict step) {
  for (int j = NF - 1; j >= 0; j--) {
    V sum = triangle[j * NC + NF];
    for (int c = j + 1; c < NF; c++) sum += triangle[j * NC + c] * step[c];
    step[j] = -sum / triangle[j * NC + j];
  }
}

/* The damped step, and the fall of the cost that the linear model promises for it: damping |s / width|^2 + |R s|^2 / 2. */
static __attribute__((noinline)) V damped_step(const V *restrict triangle, V damping, const Job *job,
                                               V *restrict step) {
  V own[NC * NC], rows[NC * K];
  for (int i = 0; i < NC * NC; i++) own[i] = triangle[i];
  const V root = v_root(damping);
  for (int first = 0; first < NF; first += K) {
    const int count = NF - first < K ? NF - first : K;
    for (int c = 0; c < NC; c++)
      for (int i = 0; i < count; i++) rows[c * K + i] = c == first + i ? root / v_all(job->width[c] / job->unit) : v_all(0.0);
    absorb(own, rows, count);
  }
  back_substituted(own, step);
  V gain = v_all(0.0);
  for (int j = 0; j < NF; j++) {
    V moved = v_all(0.0);
    for (int c = j; c < NF; c++) moved += triangle[j * NC + c] * step[c];
    const V scaled = step[j] / v_all(job->width[j] / job->unit);
    gain += v_all(0.5) * moved * moved + damping * scaled * scaled;
  }
  return gain;
}

/* All rows at x taken into `triangle`; returns the cost. */
INLINE V evaluated(const Job *job, const V *x, const double *shared, const double *by_pose, const V *by_reading,
                   const unsigned char *missing, V *restrict triangle) {
  const double *prior = job->prior;
  V block[NC * K], by_error[BY_ERROR + 1], squares = v_all(0.0);
  for (int j = 0; j < NF; j++) {
    V sum = v_all(0.0);
    for (int c = 0; c < NC; c++) triangle[j * NC + c] = c < j || c == NF ? v_all(0.0) : v_all(prior[j * NF + c] * job->unit);
    for (int c = j; c < NF; c++) sum += triangle[j * NC + c] * x[FREE[c]];
    triangle[j * NC + NF] = sum;
    squares += sum * sum;
  }
  known_rows(job, x, triangle, block, &squares);
  error_values(x, shared, by_error);
  for (ptrdiff_t i = 0; i < job->poses;) {
    int rows = 0;
    for (; rows + ROWS <= K && i < job->poses; rows += ROWS, i++) {
      pose_rows(shared, by_pose + i * BY_POSE, by_reading + i * BY_READING, by_error, block + rows);
      if (missing[i]) without_missing(by_pose + i * BY_POSE, by_reading + i * BY_READING, block + rows);
    }
    squares += sum_of_products(block + NF * K, block + NF * K, rows);
    absorb(triangle, block, rows);
  }
  return v_all(0.5) * squares;
}

static void fit_lanes(const Job *job, const ptrdiff_t *who, int real, const double *shared, const double *by_pose,
                      V *by_reading, unsigned char *missing) {
  const ptrdiff_t n = job->poses;
  const V half = v_all(0.5), none = v_all(0.0);
  V x[NX], trial[NX], step[NF], damped[NF], held[NC * NC], fresh[NC * NC];
  V cost = v_inf, damping = none, promise = none, steps = v_all(-1.0), tried = none, end = v_all(TOO_MANY);
  M active = m_all(-1);
  for (ptrdiff_t i = 0; i < n; i++) {
    reading_values(job, who, i, shared, by_pose + i * BY_POSE, by_reading + i * BY_READING);
    missing[i] = has_missing(by_pose + i * BY_POSE, by_reading + i * BY_READING) != 0;
  }
  for (int k = 0; k < NX; k++) {
    for (int lane = 0; lane < LANES; lane++) x[k][lane] = job->x[who[lane] * job->x_stride + k];
    trial[k] = x[k];
  }
  for (int i = 0; i < NC * NC; i++) held[i] = none;
  for (double count = 0; count < job->evaluations && m_any(active); count++) {
    const V now = evaluated(job, trial, shared, by_pose, by_reading, missing, fresh);
    V whole = now, gain = none;
    for (int j = 0; j < NF; j++)
      for (int c = j; c < NC; c++) whole += fresh[j * NC + c];
    const M better = active & (M)(now < cost) & m_finite(whole);
    const M first = active & (M)(cost == v_inf) & ~better;
    end = v_if(first, v_all(NOT_FINITE), end);
    active &= ~first;
    const M settled = better & (M)(cost < v_inf) & (M)(cost - now <= v_all(job->small) * cost);
    tried = v_if(active | first, tried + v_all(1.0), tried);
    steps = v_if(better, steps + v_all(1.0), steps);
    cost = v_if(better, now, cost);
    for (int k = 0; k < NX; k++) x[k] = v_if(better, trial[k], x[k]);
    for (int j = 0; j < NF; j++)
      for (int c = j; c < NC; c++) held[j * NC + c] = v_if(better, fresh[j * NC + c], held[j * NC + c]);
    const M plain = (M)(damping == none);
    const V less = damping * v_all(0.1), more = damping * v_all(10.0);
    const V failed = v_if((M)(more > v_all(FIRST_DAMPING)), more, v_all(FIRST_DAMPING));
    damping = v_if(better, v_if((M)(less > v_all(LEAST_DAMPING)), less, none), failed);
    back_substituted(held, step);
    for (int j = 0; j < NF; j++) gain += held[j * NC + NF] * held[j * NC + NF];
    gain = half * gain;
    const V enough = v_all(job->small) * cost + v_all(job->nothing);
    const M known = better & plain & (M)(promise > none);
    const V wrong = v_all(CAUTION) * gain * v_root(gain / promise);
    const M last = better & (M)(v_if(known, v_fmin(wrong, gain), gain) <= enough);
    promise = v_if(better, gain, promise);
    cost = v_if(last, cost - gain, cost);
    M stop = last | settled;
    const M slow = active & ~stop & (M)(damping > none);
    if (m_any(slow)) {
      const V promised = damped_step(held, damping, job, damped);
      for (int j = 0; j < NF; j++) step[j] = v_if(slow, damped[j], step[j]);
      stop |= slow & ~better & (M)(promised <= enough);
    }
    const M moving = active & ~stop;
    for (int k = 0; k < NX; k++) trial[k] = x[k];
    for (int j = 0; j < NF; j++) {
      trial[FREE[j]] = v_if(moving, x[FREE[j]] + step[j], x[FREE[j]]);
      x[FREE[j]] = v_if(last, x[FREE[j]] + step[j], x[FREE[j]]);
    }
    end = v_if(stop, v_all(CONVERGED), end);
    active = moving;
  }
  for (int lane = 0; lane < real; lane++) {
    const ptrdiff_t p = who[lane];
    double *factor = job->factor + p * (NF * (NF + 1) / 2);
    for (int k = 0; k < NX; k++) job->found[p * NX + k] = x[k][lane];
    for (int j = 0; j < NF; j++)
      for (int c = j; c < NF; c++) *factor++ = held[j * NC + c][lane];
    job->cost[p] = cost[lane];
    job->counts[3 * p] = (long long)steps[lane];
    job->counts[3 * p + 1] = (long long)tried[lane];
    job->counts[3 * p + 2] = (long long)end[lane];
  }
}

/* Returns 0, or 1 when there is no memory. */
int SYMCAL_FIT(const Job *job) {
  const size_t n = (size_t)job->poses, line = 64;
  const size_t readings = n * BY_READING * sizeof(V), poses = n * BY_POSE * sizeof(double);
  char *memory = malloc(readings + poses + n + 2 * line);
  if (memory == NULL) return 1;
  V *by_reading = (V *)(void *)(memory + (line - (size_t)memory % line));
  double *by_pose = (double *)(void *)((char *)by_reading + readings);
  unsigned char *missing = (unsigned char *)(by_pose + n * BY_POSE);
  double shared[SHARED + 1];
  shared_values(job, shared);
  for (ptrdiff_t i = 0; i < job->poses; i++) pose_values(job, i, shared, by_pose + i * BY_POSE);
  for (ptrdiff_t first = 0; first < job->problems; first += LANES) {
    ptrdiff_t who[LANES];
    const ptrdiff_t left = job->problems - first;
    for (int lane = 0; lane < LANES; lane++) who[lane] = first + (lane < left ? lane : left - 1);
    fit_lanes(job, who, left < LANES ? (int)left : LANES, shared, by_pose, by_reading, missing);
  }
  free(memory);
  return 0;
}
