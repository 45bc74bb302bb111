
/* The same for position and orientation; residual is sqrt(d^2 + (@lever@ mm * angle)^2) with the distance d and the
 * angle (rad) that are left. */
@prefix@_status @prefix@_@name@(@signature@);
