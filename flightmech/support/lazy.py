"""Public names that are loaded when they are first used, so that importing a package stays inexpensive."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any


def load(package: str, home: Mapping[str, str], name: str) -> Any:
    """Return a public name of a package.

    Parameters
    ----------
    package : str
        Name of the package.
    home : mapping of str to str
        Public name to the module that holds it; a path that ends in the public name is a public module.
    name : str
        The name requested.
    """
    if name not in home:
        raise AttributeError(f"module {package!r} has no attribute {name!r}; public are {', '.join(sorted(home))}")
    module = importlib.import_module(f"{package}.{home[name]}")
    return module if home[name].rpartition(".")[2] == name else getattr(module, name)
