@prefix@_status @prefix@_@name@(@signature@)
{
  real target[@target@], lower[@dof@], upper[@dof@], joints[@PREFIX@_ITERATIONS + 1][@dof@], error[@errors@], best;
  int i, k, chosen = 0;
  if (!bounds(q, lower, upper)) {
    for (i = 0; i < @dof@; ++i)
      q_out[i] = q[i];
    *residual = real_c(-1.0);
    return @PREFIX@_OUTSIDE;
  }
  @goal@(q, target);
  for (i = 0; i < @dof@; ++i)
    joints[0][i] = q[i];
  best = real_c(0.0);
  for (k = 0; k <= @PREFIX@_ITERATIONS; ++k) {
    real size;
    if (k < @PREFIX@_ITERATIONS)
      step_@kind@(joints[k], target, lower, upper,@given@ joints[k + 1], error);
    else
      miss_@kind@(joints[k], target,@given@ error);
    size = @size@;
    if (k == 0 || size < best) { /* never a result worse than the input */
      best = size;
      chosen = k;
    }
  }
  for (i = 0; i < @dof@; ++i)
    q_out[i] = joints[chosen][i];
  *residual = real_sqrt(best);
  return judge(q_out, lower, upper, *residual);
}
