"""Public names of `flighttest.records` and where they are defined; ``__init__.py`` loads them from this list."""

from .file_contents import contents as contents
from .files import save_record as save_record
from .joining import merge as merge
from .record import faults as faults
from .record import manoeuvres as manoeuvres
from .record import overview as overview
from .record import read as read
