"""Check that the packages of this distribution are the ones that Python would import.

Some import names are generic (``docs/design/import-names.md``): another distribution, or a file next to the user's script,
may hide one of them.
"""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path

from ..errors import AeromatchWarning

PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
_FOLDER = Path(__file__).resolve().parents[2]


def hidden_packages() -> dict[str, str]:
    """Return the packages that another one of the same name hides.

    Returns
    -------
    dict of str to str
        Name, and where Python would import it from.
    """
    found = {}
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = spec.origin if spec else None
        if origin is None or Path(origin).resolve().parents[1] != _FOLDER:
            found[name] = origin or "a folder without __init__.py"
    return found


def describe(hidden: dict[str, str]) -> str:
    """Return what `hidden_packages` found as a sentence with the remedy."""
    places = ", ".join(f"{name!r} from {origin}" for name, origin in hidden.items())
    remedy = "rename or remove what hides it, or install aeromatch in an environment of its own"
    return f"Python would import {places}, not from {_FOLDER}; {remedy}"


def warn_if_hidden() -> None:
    """Warn when a package of this distribution is hidden.

    Warns
    -----
    AeromatchWarning
        Names the package and where Python would import it from.
    """
    if hidden := hidden_packages():
        warnings.warn(describe(hidden), AeromatchWarning, stacklevel=3)
