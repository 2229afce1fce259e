"""Public names of `aeromatch.drafting` and where they are defined; ``__init__.py`` loads them from this list."""

from .folder import Known as Known
from .folder import draft_project as draft_project
