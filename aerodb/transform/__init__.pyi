"""Public names of `aerodb.transform` and where they are defined; ``__init__.py`` loads them from this list."""

from .ground_effect import bank_in_ground_effect as bank_in_ground_effect
from .ground_effect import in_ground_effect as in_ground_effect
from .ground_effect import with_height_table as with_height_table
from .ground_factor import factored as factored
from .reference_point import move_reference as move_reference
from .rescaling import rescale as rescale
