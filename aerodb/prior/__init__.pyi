"""Public names of `aerodb.prior` and where they are defined; ``__init__.py`` loads them from this list."""

from .build import from_datcom as from_datcom
from .roles import Assignment as Assignment
from .roles import assign_roles as assign_roles
from .roles import by_role as by_role
