@prefix@_status @prefix@_@name@(@signature@)
{
  real target[@target@], lower[@dof@], upper[@dof@], joints[2][@dof@], error[@errors@], size, best;
  int i, k;
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
    if (k < @PREFIX@_ITERATIONS)
      step_@kind@(joints[k & 1], target, lower, upper,@given@ joints[1 - (k & 1)], error);
    else
      miss_@kind@(joints[k & 1], target,@given@ error);
    size = @size@;
    if (k == 0 || size < best) {  /* never a result worse than the input */
      best = size;
      for (i = 0; i < @dof@; ++i)
        q_out[i] = joints[k & 1][i];
    }
  }
  *residual = real_sqrt(best);
  return judge(q_out, lower, upper, *residual);
}
