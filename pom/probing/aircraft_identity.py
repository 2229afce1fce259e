"""Whether the model, the evidence and the case are of one aeroplane.

A model of another aeroplane fails for no reason that a diagnosis shows, and evidence of another one
weighs every term wrongly.  The reference quantities name the aeroplane; mass and inertia show one
that has the same wing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchError, SchemaError
from flightmech.names import value_text
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER
from pom.cases.case import PomCase
from pom.status import OTHER_AIRCRAFT
from pom.tolerances.bands import RowRemark

QUANTITIES = {"S": "m2", "cbar": "m", "b": "m"}
SAME_QUANTITY = 0.02
"""Relative difference of a reference quantity of one aeroplane; two drawings round."""
MASSES = ("mass", "Ixx", "Iyy", "Izz")
SAME_MASS = 0.2
"""The same for masses: loadings of one aeroplane, and an identified inertia, differ less."""


def other_quantities(
    ours: Mapping[Any, Any], theirs: Mapping[Any, Any], words: tuple[str, str]
) -> list[str]:
    """Return the reference quantities that differ between two sources.

    Parameters
    ----------
    ours, theirs : mapping of str to float
        S, cbar, b; one that is missing is not compared. [m2, m, m]
    words : tuple of str
        The two sources in words.

    Examples
    --------
    >>> other_quantities({"S": 36.0}, {"S": 16.165}, ("the model", "the case"))
    ['S is 36 m2 in the model and 16.16 m2 in the case']
    """
    texts = []
    for name, unit in QUANTITIES.items():
        if name not in ours or name not in theirs:
            continue
        own, other = float(ours[name]), float(theirs[name])
        if abs(own - other) > SAME_QUANTITY * abs(other):
            texts.append(
                f"{name} is {own:.4g} {unit} in {words[0]} and {other:.4g} {unit} in {words[1]}"
            )
    return texts


def aircraft_remarks(case: PomCase, tables: SimModel | None) -> Iterator[RowRemark]:
    """Yield the departure of a model of another aeroplane than that of the case.

    Parameters
    ----------
    case : PomCase
        With its aircraft file; without one nothing is compared.
    tables : SimModel or None
        Inside the FMU; None for an FMU of another program.
    """
    aircraft = _aircraft_of(case)
    if tables is None or aircraft is None:
        return
    words = ("the FMU", "the case")
    texts = other_quantities(tables.meta["database"], _quantities(aircraft), words)
    masses = {entry.name: entry.value for entry in tables.entries(PARAMETER)}
    for name in MASSES:
        own, other = masses.get(f"mass.{name}"), float(getattr(aircraft, name))
        if own is not None and abs(own - other) > SAME_MASS * abs(other):
            shown = [value_text(name, value) for value in (own, other)]
            texts.append(f"{name} is {shown[0]} in {words[0]} and {shown[1]} in {words[1]}")
    if texts:
        text = (
            f"departure: the model may be of another aeroplane ({tables.title or 'no name'}; the "
            f"case has {aircraft.name or 'no name'}): {'; '.join(texts)}; give the FMU of this "
            f"aeroplane"
        )
        yield RowRemark("departure", text, OTHER_AIRCRAFT)


def demand_own_evidence(evidence: xr.DataTree | None, cases: Sequence[PomCase]) -> None:
    """Raise if evidence is of another aeroplane than one of the cases.

    Raises
    ------
    SchemaError
        With the reference quantities that differ.
    """
    if evidence is None:
        return
    problems: dict[str, None] = {}
    for case in cases:
        aircraft = _aircraft_of(case)
        if aircraft is not None:
            words = ("the evidence", f"the aircraft file of the case ({case.aircraft})")
            found = other_quantities(evidence.attrs, _quantities(aircraft), words)
            problems |= dict.fromkeys(found)
    refuse_other_aircraft(list(problems))


def refuse_other_aircraft(problems: list[str]) -> None:
    """Raise if the evidence has other reference quantities.

    Raises
    ------
    SchemaError
        With the problems; none without problems.
    """
    if problems:
        remedy = (
            "it is the database of another aeroplane, or of other reference quantities; give the "
            "database that was identified for this aeroplane (--evidence)"
        )
        raise SchemaError("evidence", [*problems, remedy])


def _quantities(aircraft: Aircraft) -> dict[str, float]:
    return {name: float(getattr(aircraft, name)) for name in QUANTITIES}


def _aircraft_of(case: PomCase) -> Aircraft | None:
    """Return the aircraft of a case; None without a file that can be read."""
    if not case.aircraft:
        return None
    try:
        return read_aircraft(case.aircraft)
    except (AeromatchError, OSError):
        # the reader of the aircraft reports a missing or damaged file
        return None
