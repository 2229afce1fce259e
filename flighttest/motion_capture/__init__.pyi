"""Public names of `flighttest.motion_capture` and where they are defined; ``__init__.py`` loads them from this list."""

from .body_motion import motion as motion
from .body_motion import motion_record as motion_record
from .marker_files import MarkerSetup as MarkerSetup
from .marker_files import read_marker_setup as read_marker_setup
from .marker_files import read_markers as read_markers
from .pose import poses as poses
