"""State reconstruction by batch output error: the inertial unit drives exact kinematics, start and
constants are the unknowns.
"""
