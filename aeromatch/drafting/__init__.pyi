"""Public names of `aeromatch.drafting`."""

from .folder import StatedFacts as Known
from .folder import StatedFacts as StatedFacts
from .folder import draft_project as draft_project
