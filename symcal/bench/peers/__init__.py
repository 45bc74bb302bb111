"""What a user would write instead: the same robot, in the tools that are at hand.

Everything in this folder is a second forward kinematics, which the package has nowhere else: it is the measure and the
witness of `symcal bench`, and nothing outside it may import from here. All of it starts from `elements`, the list of
elementary motions that stands in a robot's data sheet, and shares no line with `symcal.kinematics`.
"""
