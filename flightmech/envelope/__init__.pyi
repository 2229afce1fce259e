"""Public names of `flightmech.envelope`."""

from .envelope import Envelope as Envelope
from .envelope import make_envelope as make_envelope
from .maps import RegionMap as RegionMap
from .maps import draw_maps as draw_maps
from .maps import region_maps as region_maps
