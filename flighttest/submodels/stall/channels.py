"""Whether records of stalls hold what the identification needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.names import REDUCED_RATES, SEPARATION
from flighttest.regression.expressions import parse_terms
from flighttest.submodels.stall.flow import LOSSES

_FLOW = {*SEPARATION, *LOSSES}
_STATES = ("alpha", "p", "r", "V")  # from which the flow at the wing halves follows


def record_labels(names: Sequence[str], count: int) -> list[str]:
    """Return the label of each of `count` records: its number from 1, and its name if known."""
    labels = []
    for number in range(1, count + 1):
        known = number <= len(names)
        labels.append(f"record {number} ({names[number - 1]})" if known else f"record {number}")
    return labels


def demand_channels(
    data: Sequence[xr.Dataset], terms: Mapping[str, Sequence[str]], labels: Sequence[str]
) -> None:
    """Raise if a record lacks a quantity that the separation or a coefficient needs.

    Parameters
    ----------
    data : sequence of Dataset (time,)
    terms : mapping of str to sequence of str
        Texts of all terms, by coefficient.
    labels : sequence of str
        From `record_labels`.

    Raises
    ------
    IdentificationError
        Names the first record with a gap, all that it lacks and what needs it.
    """
    for label, record in zip(labels, data, strict=True):
        missing = {name: ["the separation"] for name in _STATES if name not in record}
        for coefficient, texts in terms.items():
            for name in (coefficient, *_variables(texts)):
                if name not in record:
                    missing.setdefault(name, []).append(coefficient)
        if not missing:
            continue
        parts = []
        for name, users in missing.items():
            rate = REDUCED_RATES.get(name, ("", ""))[0]
            origin = f", which follows from {rate} and V" if rate else ""
            parts.append(f"{name} (for {', '.join(users)}{origin})")
        needed: dict[str, None] = {}
        for users in missing.values():
            needed.update(dict.fromkeys(users))
        spare = [name for name in needed if name in terms and name != "CL"]
        remedy = f", or leave {', '.join(spare)} out of the coefficients" if spare else ""
        raise IdentificationError(
            f"{label} lacks {'; '.join(parts)}; give a record with it, as `coefficients` returns "
            f"it from a path with all states and controls{remedy}"
        )


def _variables(texts: Sequence[str]) -> list[str]:
    """Return the quantities of terms that a record holds, each once.

    Differences of the halves are left out: with Cl or Cn they are candidates of all coefficients,
    and what they multiply is a term of Cl and Cn anyway.
    """
    names: dict[str, None] = {}
    for text in texts:
        if "_diff" in text:
            continue
        for expression in parse_terms(text):
            names.update(dict.fromkeys(expression.names()))
    return [name for name in names if name not in _FLOW]


def configuration_nodes(
    records: Sequence[xr.Dataset], axis: str, labels: Sequence[str]
) -> tuple[float, ...]:
    """Return the values of the configuration: the median of every record, rounded to 1e-3."""
    if not axis:
        return (0.0,)
    for label, record in zip(labels, records, strict=True):
        if axis not in record:
            raise IdentificationError(f"{label} has no {axis}; add it or leave the axis out")
    medians = {round(float(np.median(record[axis].values)), 3) for record in records}
    return tuple(sorted(medians))
