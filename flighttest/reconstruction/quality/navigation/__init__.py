"""Checks of air data, ground track and heading against inertial motion: delays, scales, offsets."""
