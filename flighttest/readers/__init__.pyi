"""Public names of `flighttest.readers` and where they are defined; ``__init__.py`` loads them from this list."""

from .map_schema import name_map_schema as name_map_schema
from .name_map import Channel as Channel
from .name_map import NameMap as NameMap
from .name_map import read_names as read_names
from .name_map import shipped_maps as shipped_maps
