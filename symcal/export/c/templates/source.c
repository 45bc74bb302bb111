/* Kinematics of @robot@. Written by symcal; see the header and README.md.
 * No allocation, no input or output, no variables outside functions; every loop has a fixed length.
 */
#include "@prefix@_kinematics.h"

@definitions@
/* The clamps of a step, without the calls that libm would make of them; a first argument that is not a number gives
 * the second. */
#undef real_fmin
#undef real_fmax
#define real_fmin(a, b) ((a) < (b) ? (a) : (b))
#define real_fmax(a, b) ((a) > (b) ? (a) : (b))
#ifndef real_sqrt
#ifdef SYMCAL_FLOAT
#define real_sqrt(a) sqrtf(a)
#else
#define real_sqrt(a) sqrt(a)
#endif
#endif

const real @prefix@_lower[@dof@] = @lower@;
const real @prefix@_upper[@dof@] = @upper@;
const real @prefix@_cap[@dof@] = @cap@;
const real @prefix@_errors[@space@] = @errors@;
const real @prefix@_identity[12] = @identity@;
const real @prefix@_tool[12] = @tool@;
const real @prefix@_tool_nominal[12] = @tool_nominal@;

@functions@
/* Where each joint may go: inside its limits and no further than its cap from q. 0 if q is outside by more than that,
 * or not a number. */
static int bounds(const real *q, real *lower, real *upper)
{
  int i;
  for (i = 0; i < @dof@; ++i) {
    const real low = q[i] - @prefix@_cap[i], high = q[i] + @prefix@_cap[i];
    if (!(high >= @prefix@_lower[i] && low <= @prefix@_upper[i]))
      return 0;
    lower[i] = low > @prefix@_lower[i] ? low : @prefix@_lower[i];
    upper[i] = high < @prefix@_upper[i] ? high : @prefix@_upper[i];
  }
  return 1;
}

static @prefix@_status judge(const real *q, const real *lower, const real *upper, real residual)
{
  int i, capped = 0;
  if (residual <= @PREFIX@_REACHED_MM)
    return @PREFIX@_REACHED;
  for (i = 0; i < @dof@; ++i) {
    if (q[i] <= @prefix@_lower[i] || q[i] >= @prefix@_upper[i])
      return @PREFIX@_LIMIT;
    if (q[i] <= lower[i] || q[i] >= upper[i])
      capped = 1;
  }
  return capped ? @PREFIX@_CAP : @PREFIX@_CLOSEST;
}

@compensations@
