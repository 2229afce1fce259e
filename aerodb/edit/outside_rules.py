"""Rules of tables of one term beyond their breakpoints, compared before a blend."""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr


def compare_outside_rules(name: str, leaves: Mapping[str, xr.Dataset]) -> str:
    """Return a sentence on tables of one term that continue otherwise beyond their breakpoints.

    A blend has the rule of the first table.  The text is empty if all rules are equal.

    Parameters
    ----------
    name : str
        Term.
    leaves : mapping of str to Dataset
        Table by the place or the label of its database.
    """
    rules = {label: str(leaf.attrs.get("outside", "hold")) for label, leaf in leaves.items()}
    # a number without a table goes on in the same way by both rules
    has_axes = any(leaf["value"].ndim for leaf in leaves.values())
    if len(set(rules.values())) < 2 or not has_axes:
        return ""
    texts = [f"{rule!r} {label}" for label, rule in rules.items()]
    first = next(iter(rules.values()))
    return (
        f"{name}: the rule outside is {', '.join(texts)}; the blend has {first!r}, so that it "
        f"continues beyond the tables as the first database alone"
    )
