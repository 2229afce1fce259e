"""Public names of `pom.fmu` and where they are defined; ``__init__.py`` loads them from this list."""

from .process import close_all as close_all
from .simulate import Models as Models
from .simulate import fly as fly
