/* Kinematics of @robot@ (@state@). Written by symcal.
 *
 * Units: mm and rad. Joint values are readings, as the robot file defines them (sign, ratio and offset are built in):
@joints@@terms@
 * Frames: everything is in the base frame of the robot. Matrices are row-major:
 *   pose      T_base_tool without its last row, 3 x 4: p[0..3] = R00 R01 R02 x, p[4..7] = R10 R11 R12 y, ...
 *   jacobian  6 x @dof@, column i per unit of reading i; rows 0 to 2 are the velocity of the tool's origin (mm),
 *             rows 3 to 5 the angular velocity (rad).
 * Outputs must not overlap inputs, except q_out, which may be q itself.
 *
 * Compile with SYMCAL_FLOAT defined, here and wherever this header is included, for single precision; then no double
 * is used anywhere, and all names end in _f, so that the two kinds cannot be mixed up by the linker.
 */
#ifndef @PREFIX@_KINEMATICS_H
#define @PREFIX@_KINEMATICS_H

#ifdef SYMCAL_FLOAT
typedef float @prefix@_real;
@renames@
#else
typedef double @prefix@_real;
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* SHA-256 of the model: convention, joints, and the numbers before and after calibration. */
#define @PREFIX@_MODEL_HASH "@hash@"

#define @PREFIX@_DOF @dof@
#define @PREFIX@_PARAMETERS @parameters@
#define @PREFIX@_ITERATIONS @iterations@

/* A residual below this counts as none, mm. */
#ifdef SYMCAL_FLOAT
#define @PREFIX@_REACHED_MM @reached_float@f
#else
#define @PREFIX@_REACHED_MM @reached_double@
#endif

/* Index of each joint. */
enum {
@enumeration@
};

/* How a compensation ended. Unless it is OUTSIDE, q_out may be commanded: it is inside the limits where q was, and never
 * worse than q. */
typedef enum {
  @PREFIX@_REACHED = 0, /* the residual is at most @PREFIX@_REACHED_MM */
  @PREFIX@_LIMIT = 1,   /* not reached, and a joint is at its limit */
  @PREFIX@_CAP = 2,     /* not reached, and a correction is as large as its cap */
  @PREFIX@_CLOSEST = 3, /* not reached: near a singularity, or too few joints for the target */
  @PREFIX@_OUTSIDE = 4  /* q is outside the limits by more than its cap, or not a number: q_out is q, residual is -1 */
} @prefix@_status;

/* Limits of the readings (a huge number where the robot has none), and the largest correction of each. */
extern const @prefix@_real @prefix@_lower[@dof@];
extern const @prefix@_real @prefix@_upper[@dof@];
extern const @prefix@_real @prefix@_cap[@dof@];

/* Pose of the tool, calibrated and nominal. */
void @prefix@_forward(const @prefix@_real q[@dof@], @prefix@_real pose[12]);
void @prefix@_forward_nominal(const @prefix@_real q[@dof@], @prefix@_real pose[12]);

/* Jacobian of the calibrated robot, by readings. */
void @prefix@_jacobian(const @prefix@_real q[@dof@], @prefix@_real jacobian[@jacobian@]);

/* Readings with which the calibrated robot's tool is where the nominal one's would be with q: its position@only@.
 * residual (mm) is the distance that the calibrated model keeps from there. @iterations@ damped Newton steps, always. */
@prefix@_status @prefix@_compensate(@compensate@);
@compensate_pose@
/* ---- The same with numbers given at run time, for a robot that is calibrated again in the field.
 *
 * x: errors of the link parameters@of_terms@, identified minus nominal (mm, rad), in this order:
@parameter_list@
 * base, tool: poses of the robot's base in the frame wanted, and of the tool on the flange; 3 x 4, row-major.
 */
extern const @prefix@_real @prefix@_errors[@space@];    /* x of this calibration */
extern const @prefix@_real @prefix@_identity[12];      /* base, for poses in the base frame */
extern const @prefix@_real @prefix@_tool[12];          /* tool of this calibration */
extern const @prefix@_real @prefix@_tool_nominal[12];  /* tool before it */

void @prefix@_forward_with(@forward_with@);
void @prefix@_jacobian_with(@jacobian_with@);
@prefix@_status @prefix@_compensate_with(@compensate_with@);
@compensate_pose_with@
#ifdef __cplusplus
}
#endif

#endif
