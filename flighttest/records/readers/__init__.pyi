"""Public names of `flighttest.records.readers`."""

from .name_map import Channel as Channel
from .name_map import NameMap as NameMap
from .name_map_file import name_map_schema as name_map_schema
from .name_map_reading import read_names as read_names
from .name_map_reading import shipped_maps as shipped_maps
