"""Public names of `flighttest.special_tests`."""

from .marker_poses import poses as poses
from .motion_capture import MarkerSetup as MarkerSetup
from .motion_capture import motion_record as motion_record
from .motion_capture import read_marker_setup as read_marker_setup
from .motion_capture import read_markers as read_markers
from .motion_capture import smooth_motion as motion
from .motion_capture import smooth_motion as smooth_motion
