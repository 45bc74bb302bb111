"""The one kinematic expression: robot -> symbolic pose and the screws of every joint and parameter.

Simulation, identification, planning, compensation and exported C all come from `chain`. The Jacobians are geometric:
each coordinate s (a joint reading or a parameter error) moves whatever is fixed to the tool with the velocity field

    dp/ds = v + omega x p        (p in world)

so a measurement needs only the screws (omega, v) and the derivative of its own last step. It is the derivative that
automatic differentiation gives, with about half the operations (the tests compare the two).

Joint terms (`symcal.joints`) move a joint by delta_i(q, x): whatever changes delta_i turns what is behind joint i about
its axis, so the screw of a coordinate s gains sum_i (d delta_i / ds) U_i, U_i the screw of joint i.
A remainder (`symcal.joints.remainder`) displaces the flange by f(q) along the axes of the base: the screw of joint i
gains the slide df/dq_i.
"""

from symcal.kinematics.chain import Chain as Chain
from symcal.kinematics.chain import chain as chain
from symcal.kinematics.chain import forward as forward
from symcal.kinematics.chain import frame_vector as frame_vector
from symcal.kinematics.chain import placed as placed
from symcal.kinematics.chain import station_names as station_names
from symcal.kinematics.functions import function as function
from symcal.kinematics.screws import Screw as Screw
from symcal.kinematics.screws import Station as Station
from symcal.kinematics.screws import omegas as omegas
from symcal.kinematics.screws import pose_of as pose_of
from symcal.kinematics.screws import stack as stack
from symcal.kinematics.terms import bases as bases
from symcal.kinematics.terms import motions as motions
