"""Public names of `aerodb.prior`."""

from .build import from_datcom as from_datcom
from .roles import CaseRole as Assignment
from .roles import CaseRole as CaseRole
from .roles import assign_roles as assign_roles
from .roles import by_role as by_role
