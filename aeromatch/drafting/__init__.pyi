"""Public names of `aeromatch.drafting`."""

from .folder import Known as Known
from .folder import draft_project as draft_project
