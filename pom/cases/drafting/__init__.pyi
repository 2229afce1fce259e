"""Public names of `pom.cases.drafting`."""

from .draft import init_case as init_case
