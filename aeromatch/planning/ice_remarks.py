"""Remarks on ice: differences that no flight shows, and flights with ice that no term knows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
from aeromatch.planning.record_look import RecordLook
from flightmech.aircraft.controls import ICE
from flightmech.terms import list_model_variables
from pom.cases.case import PomCase


def ice_remarks(
    database: xr.DataTree, cases: Iterable[PomCase], looks: Mapping[str, RecordLook]
) -> list[str]:
    """Return the remarks on the setting of the ice, one line each.

    Parameters
    ----------
    database : DataTree
        Before the flights.
    cases : iterable of PomCase
    looks : mapping of str to RecordLook
        Of the records that fits or cases use, by name.

    Returns
    -------
    list of str
        Empty if the terms have ice and a flight has, or neither.
    """
    fitted = dict(_iced_fits(looks))
    variables: set[str] = set()
    for leaf in aerodb.terms(database).values():
        variables.update(list_model_variables(leaf))
    if ICE not in variables:
        remarks = []
        for name, largest in fitted.items():
            remarks.append(
                f"record {name}: {ICE} reaches {largest:.3g} in a fit, and no term depends on it: "
                f"the effect of the ice enters the clean tables; give the key ice, or leave the "
                f"record out of the fits"
            )
        return remarks
    if fitted or any(_is_iced(case, looks) for case in cases):
        return []
    return [
        f"ice: no fit and no case has {ICE} above 0, so every flight counts as clean; map the "
        f"column of the records with ice, or state it in [conditions] of the cases"
    ]


def _iced_fits(looks: Mapping[str, RecordLook]) -> Iterator[tuple[str, float]]:
    """Yield each record that a fit uses with ice, and its largest setting."""
    for name, look in looks.items():
        settings = [ranges[ICE][1] for ranges in look.ranges.values() if ICE in ranges]
        if settings and max(settings) > 0.0:
            yield name, max(settings)


def _is_iced(case: PomCase, looks: Mapping[str, RecordLook]) -> bool:
    """Return whether a case is flown with ice, by its conditions or its record."""
    if ICE in case.conditions:
        return case.conditions[ICE] > 0.0
    look = looks.get(Path(case.record).stem)
    states = look.windows.get(case.name) if look else None
    if states is None or ICE not in states:
        return False
    return bool(np.nanmax(states[ICE].values, initial=0.0) > 0.0)
