/* Test vectors of @robot@: readings that single precision holds exactly, and poses and Jacobians computed with
 * products of numeric matrices, independently of the source that is tested.
 */
#ifndef VECTORS_H
#define VECTORS_H

#include <math.h>

#ifdef SYMCAL_FLOAT
#define real_c(x) x##f
#else
#define real_c(x) x
#endif

#define VECTORS @count@

static const @prefix@_real not_a_number = (@prefix@_real)NAN;

/* Largest motion of each joint per unit of its reading. */
static const @prefix@_real vector_scale[@dof@] = @scale@;

static const @prefix@_real vector_q[VECTORS][@dof@] = @q@;

static const @prefix@_real vector_nominal[VECTORS][12] = @nominal@;

static const @prefix@_real vector_calibrated[VECTORS][12] = @calibrated@;

static const @prefix@_real vector_jacobian[VECTORS][@jacobian_size@] = @jacobian@;

/* Whether compensation must reach its target: the exact solution is inside limits and caps, far from singularities. */
static const int vector_reached[VECTORS] = @reached@;
@reached_pose@
#endif
