/* Self-test of the kinematics of @robot@: against vectors that an independent implementation computed, and
 * compensation against what it is for. Exit code 0 when all is well. Needs printf; the library does not.
 */
#include <stdio.h>

#include "@prefix@_kinematics.h"
#include "vectors.h"

typedef @prefix@_real real;

#ifdef SYMCAL_FLOAT
#define LENGTH_TOLERANCE ((real)@length_float@)  /* mm: 5e-7 of the reach */
#define ANGLE_TOLERANCE ((real)2e-6)
#define SLOPE_TOLERANCE ((real)@slope_float@)    /* mm per unit, with what fast waves lose to rounding */
#define SPIN_TOLERANCE ((real)@spin_float@)
#define KIND "float"
#else
#define LENGTH_TOLERANCE ((real)@length_double@)  /* mm: 1e-12 of the reach */
#define ANGLE_TOLERANCE ((real)2e-12)
#define SLOPE_TOLERANCE ((real)@slope_double@)
#define SPIN_TOLERANCE ((real)@spin_double@)
#define KIND "double"
#endif

static int failures = 0;

static void report(const char *what, real worst, real tolerance)
{
  const int bad = !(worst <= tolerance);
  printf("%-7s %-28s worst %.3g, allowed %.3g: %s\n", KIND, what, (double)worst, (double)tolerance, bad ? "FAILED" : "ok");
  failures += bad;
}

static real larger(real a, real b)
{
  const real size = b < 0 ? -b : b;
  return size <= a ? a : size; /* NaN goes through */
}

/* Largest difference of positions (last column) and of rotations. */
static void compare_poses(const real *a, const real *b, real *length, real *angle)
{
  int i;
  for (i = 0; i < 12; ++i) {
    if (i % 4 == 3)
      *length = larger(*length, a[i] - b[i]);
    else
      *angle = larger(*angle, a[i] - b[i]);
  }
}

/* Largest difference of Jacobians, each column relative to how far its joint moves per unit. */
static void compare_jacobians(const real *a, const real *b, real *length, real *angle)
{
  int i;
  for (i = 0; i < 6 * @dof@; ++i) {
    const real scale = vector_scale[i % @dof@];
    if (i < 3 * @dof@)
      *length = larger(*length, (a[i] - b[i]) / scale);
    else
      *angle = larger(*angle, (a[i] - b[i]) / scale);
  }
}

static void report_poses(const char *what, real length, real angle)
{
  char text[64];
  (void)sprintf(text, "%s (mm)", what);
  report(text, length, LENGTH_TOLERANCE);
  (void)sprintf(text, "%s (rotation)", what);
  report(text, angle, ANGLE_TOLERANCE);
}

/* Squared distance of two poses in mm^2; with orientations, 1 rad counts as @lever@ mm. */
static real distance2(const real *a, const real *b, int oriented)
{
  real position = 0, rotation = 0;
  int i;
  for (i = 0; i < 12; ++i) {
    const real d = a[i] - b[i];
    if (i % 4 == 3)
      position += d * d;
    else
      rotation += d * d;
  }
  return position + (oriented ? (real)@half_lever2@ * rotation : 0);
}

/* A compensated command: no farther from the target than before, inside limits and caps, and there if it can be. */
static void check_compensation(int k, const real *q_out, @prefix@_status status, real residual, int oriented, int must,
                               real *worst, int *wrong)
{
  real before[12], after[12], had, has;
  int i;
  @prefix@_forward(vector_q[k], before);
  @prefix@_forward(q_out, after);
  had = distance2(before, vector_nominal[k], oriented);
  has = distance2(after, vector_nominal[k], oriented);
  for (i = 0; i < @dof@; ++i) {
    if (!(q_out[i] >= @prefix@_lower[i] && q_out[i] <= @prefix@_upper[i]))
      ++*wrong;
    if (larger(0, q_out[i] - vector_q[k][i]) > @prefix@_cap[i] * (real)1.00001)
      ++*wrong;
  }
  if (must && status != @PREFIX@_REACHED)
    ++*wrong;
  if (status == @PREFIX@_OUTSIDE || !(residual >= 0))
    ++*wrong;
  if (status == @PREFIX@_REACHED)
    *worst = larger(*worst, has);
  else if (!(has <= had + LENGTH_TOLERANCE))
    ++*wrong;
}

static void report_compensation(const char *what, real worst2, int wrong)
{
  const real allowed = @PREFIX@_REACHED_MM + 4 * LENGTH_TOLERANCE;
  report(what, worst2, allowed * allowed);
  if (wrong) {
    printf("%-7s %-28s %d results that cannot be: FAILED\n", KIND, what, wrong);
    ++failures;
  }
}

int main(void)
{
  real length = 0, angle = 0, worst = 0, pose[12], jacobian[6 * @dof@], q[@dof@], residual;
  @prefix@_status status;
  int i, k, wrong = 0;

  for (k = 0; k < VECTORS; ++k) {
    @prefix@_forward_nominal(vector_q[k], pose);
    compare_poses(pose, vector_nominal[k], &length, &angle);
  }
  report_poses("nominal pose", length, angle);

  length = angle = 0;
  for (k = 0; k < VECTORS; ++k) {
    @prefix@_forward(vector_q[k], pose);
    compare_poses(pose, vector_calibrated[k], &length, &angle);
    @prefix@_forward_with(vector_q[k], @prefix@_errors, @prefix@_identity, @prefix@_tool, pose);
    compare_poses(pose, vector_calibrated[k], &length, &angle);
  }
  report_poses("calibrated pose", length, angle);

  length = angle = 0;
  for (k = 0; k < VECTORS; ++k) {
    @prefix@_jacobian(vector_q[k], jacobian);
    compare_jacobians(jacobian, vector_jacobian[k], &length, &angle);
    @prefix@_jacobian_with(vector_q[k], @prefix@_errors, @prefix@_identity, @prefix@_tool, jacobian);
    compare_jacobians(jacobian, vector_jacobian[k], &length, &angle);
  }
  report("Jacobian (mm)", length, SLOPE_TOLERANCE);
  report("Jacobian (rotation)", angle, SPIN_TOLERANCE);

  for (k = 0; k < VECTORS; ++k) {
    status = @prefix@_compensate(vector_q[k], q, &residual);
    check_compensation(k, q, status, residual, 0, vector_reached[k], &worst, &wrong);
    for (i = 0; i < @dof@; ++i)
      q[i] = vector_q[k][i];
    status = @prefix@_compensate_with(q, @prefix@_errors, @prefix@_tool, q, &residual);
    check_compensation(k, q, status, residual, 0, vector_reached[k], &worst, &wrong);
  }
  report_compensation("compensation (mm^2)", worst, wrong);
@pose_test@
  for (i = 0; i < @dof@; ++i)
    q[i] = vector_q[0][i];
  q[0] = not_a_number;
  status = @prefix@_compensate(q, q, &residual);
  wrong = status != @PREFIX@_OUTSIDE || residual >= 0 || q[0] == q[0];
  for (i = 1; i < @dof@; ++i)
    wrong += q[i] != vector_q[0][i];
  report("input that is not a number", (real)wrong, 0);

  printf("%s\n", failures ? "self-test FAILED" : "self-test passed");
  return failures ? 1 : 0;
}
