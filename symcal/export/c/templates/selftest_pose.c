
  worst = 0;
  wrong = 0;
  for (k = 0; k < VECTORS; ++k) {
    status = @prefix@_compensate_pose(vector_q[k], q, &residual);
    check_compensation(k, q, status, residual, 1, vector_reached_pose[k], &worst, &wrong);
    status = @prefix@_compensate_pose_with(vector_q[k], @prefix@_errors, @prefix@_tool, q, &residual);
    check_compensation(k, q, status, residual, 1, vector_reached_pose[k], &worst, &wrong);
  }
  report_compensation("pose compensation (mm^2)", worst, wrong);
