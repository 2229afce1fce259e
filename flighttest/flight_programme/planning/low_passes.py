"""Low passes of a catalogue: one manoeuvre, and one fit, per height."""

from __future__ import annotations

from math import inf
from typing import Any


def split_heights(content: Any) -> Any:
    """Return the content of a catalogue with one manoeuvre, and one fit, per height of low passes.

    A pass at 0.2 spans of a manoeuvre ``low pass`` is named ``low pass, 0.2 span``.  So the choice
    of the manoeuvres is also one of the heights, and no local model extends over several heights.
    """
    if not isinstance(content, dict) or not isinstance(content.get("manoeuvre"), list):
        return content
    passes: dict[str, dict[float, str]] = {}
    manoeuvres = []
    for item in content["manoeuvre"]:
        if not isinstance(item, dict) or item.get("kind") != "low_pass":
            manoeuvres.append(item)
            continue
        heights: Any = item.get("heights")
        if not _are_heights(heights):
            raise ValueError(
                f"manoeuvre {item.get('name')!r}: heights {heights!r}; a low_pass needs different "
                "heights in spans, such as [0.2, 0.4, 0.8]"
            )
        name = str(item.get("name"))
        passes[name] = {float(height): f"{name}, {height:g} span" for height in heights}
        rest = {key: value for key, value in item.items() if key != "heights"}
        for height, own_name in passes[name].items():
            manoeuvres.append({**rest, "name": own_name, "height": height})
    fits = content.get("fit")
    if isinstance(fits, list):
        split: list[Any] = []
        for fit in fits:
            split += _split_fit(fit, passes)
        fits = split
    return {**content, "manoeuvre": manoeuvres, "fit": fits}


def _are_heights(heights: Any) -> bool:
    """Return whether heights of a low pass are different positive finite numbers."""
    if not isinstance(heights, list) or not heights:
        return False
    # TOML has inf, and True is the integer 1 of Python.
    numbers = [height for height in heights if type(height) in (int, float) and 0.0 < height < inf]
    return len(set(numbers)) == len(heights)


def _split_fit(fit: Any, passes: dict[str, dict[float, str]]) -> list[Any]:
    """Return a fit once for every height of the low passes among its manoeuvres."""
    if not isinstance(fit, dict) or not isinstance(fit.get("manoeuvres"), list):
        return [fit]
    heights: dict[float, None] = {}
    for name in fit["manoeuvres"]:
        heights |= dict.fromkeys(passes.get(name, ()))
    if not heights:
        return [fit]
    split = []
    for height in heights:
        names = []
        for name in fit["manoeuvres"]:
            if name not in passes:
                names.append(name)
            elif height in passes[name]:
                names.append(passes[name][height])
        split.append({**fit, "name": f"{fit.get('name')}, {height:g} span", "manoeuvres": names})
    return split
