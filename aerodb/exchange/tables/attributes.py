"""The attributes of a leaf and of its variables as one flat mapping, for formats that know no attributes of variables."""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from flightmech import terms as _terms
from flightmech.names import VOCABULARY, attrs

Facts = Mapping[str, str | int | float]
_WITHOUT = "_without"  # words: usual attributes that a variable lacks


def flat(leaf: xr.Dataset) -> dict[str, str | int | float]:
    """Return the attributes of a leaf, and as ``variable.key`` those of its variables that the vocabulary does not give."""
    found = {str(key): item for key, item in leaf.attrs.items()}
    missing = []
    for name, variable in leaf.variables.items():
        usual = _usual(str(name))
        found |= {f"{name}.{key}": item for key, item in variable.attrs.items() if usual.get(str(key)) != item}
        missing += [f"{name}.{key}" for key in usual if key not in variable.attrs]
    return {**found, _WITHOUT: " ".join(missing)} if missing else found


def dressed(leaf: xr.Dataset, facts: Facts) -> xr.Dataset:
    """Return a leaf with the attributes that `flat` gave."""
    found = leaf.copy()
    missing = str(facts.get(_WITHOUT, "")).split()
    found.attrs = {key: item for key, item in facts.items() if "." not in key and key != _WITHOUT}
    for name in map(str, leaf.variables):
        own = {key.removeprefix(f"{name}."): item for key, item in facts.items() if key.startswith(f"{name}.")}
        usual = {key: item for key, item in _usual(name).items() if f"{name}.{key}" not in missing}
        found[name].attrs = {**usual, **own}
    return found


def _usual(name: str) -> dict[str, str]:
    if name == "source":
        return _terms.SOURCE_ATTRS
    return attrs(name) if name in VOCABULARY else {}
