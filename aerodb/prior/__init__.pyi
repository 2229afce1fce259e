"""Public names of `aerodb.prior` and where they are defined; ``__init__.py`` loads them from this list."""

from .build import from_datcom as from_datcom
