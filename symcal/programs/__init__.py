"""Programs that drive a robot to the poses of a plan, in the languages of controllers."""
