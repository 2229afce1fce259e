"""Kinematics of the flight path, channels that follow from others, forces and moments as coefficients."""
