"""Facts of an aircraft that decide which conditions of a flight test hold: weights, speeds,
controls.

They are the section ``[facts]`` of the aircraft file::

    [facts]
    reversible_controls = true
    mtow = "6600 lb"
    basic_operating_weight = "4300 lb"
    v1 = "95 kt"
    mean_chord = "5.47 ft"
    engines = 2
    without = ["spoiler"]

A fact that is not given is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, StrictBool, StrictInt, field_validator, model_validator

from flightmech.air import RHO_SEA
from flightmech.errors import UnitError
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import G0, from_si


@dataclass(frozen=True)
class AircraftFacts:
    """Facts of an aircraft, SI; None for an unknown one.

    Parameters
    ----------
    reversible_controls : bool, optional
        Whether air loads on the surfaces reach the pilot.
    mtow, basic_operating_weight : float, optional
        Largest take-off mass, and mass ready for flight without payload and usable fuel. [kg]
    v1 : float, optional
        Decision speed, calibrated. [m s-1]
    mean_chord : float, optional
        Mean aerodynamic chord. [m]
    engines : int, optional
        Number of engines.
    pusher : bool, optional
        Whether propellers stand behind the wing.
    without : tuple of str
        Equipment that the aircraft does not have, as parameters of tolerance rows.
    """

    reversible_controls: bool | None = None
    mtow: float | None = None
    basic_operating_weight: float | None = None
    v1: float | None = None
    mean_chord: float | None = None
    engines: int | None = None
    pusher: bool | None = None
    without: tuple[str, ...] = ()

    def known(self) -> dict[str, Any]:
        """Return the known facts by name. [SI]"""
        named = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in named.items() if value not in (None, ())}


class FactsTable(Strict):
    """Facts of the aircraft on which the conditions of tolerance rows depend."""

    reversible_controls: StrictBool | None = Field(
        default=None,
        examples=[True],
        description="Whether the air loads on the surfaces reach the pilot; decides on the rows of "
        "pilot forces.",
    )
    mtow: Annotated[float, InUnits("kg")] | None = Field(
        default=None, examples=["6600 lb"], description="Largest certificated take-off mass."
    )
    basic_operating_weight: Annotated[float, InUnits("kg")] | None = Field(
        default=None,
        examples=["4300 lb"],
        description="Mass ready for flight, without payload and usable fuel.",
    )
    v1: Annotated[float, InUnits("m s-1")] | None = Field(
        default=None,
        examples=["95 kt"],
        description="Decision speed, calibrated. A case may have its own.",
    )
    mean_chord: Annotated[float, InUnits("m")] | None = Field(
        default=None,
        examples=["5.47 ft"],
        description="Mean aerodynamic chord; without it the reference chord stands for it.",
    )
    engines: StrictInt | None = Field(
        default=None,
        ge=0,
        le=8,
        examples=[2],
        description="Number of engines; without it that of the engine tables.",
    )
    pusher: StrictBool | None = Field(
        default=None,
        examples=[True],
        description="Whether propellers stand behind the wing; without it such a place is "
        "remarked.",
    )
    without: tuple[str, ...] = Field(
        default=(),
        examples=[["spoiler", "epr"]],
        description="Equipment that the aircraft does not have, as parameters of tolerance rows.",
    )

    @field_validator("mtow", "basic_operating_weight", "v1", "mean_chord")
    @classmethod
    def _check_positive(cls, value: float | None) -> float | None:
        # a comparison with NaN is false
        if value is not None and not 0.0 < value < float("inf"):
            raise ValueError("expected a positive number")
        return value

    @model_validator(mode="after")
    def _check_weights(self) -> FactsTable:
        empty, most = self.basic_operating_weight, self.mtow
        if empty is not None and most is not None and not empty < most:
            raise ValueError(
                f"basic_operating_weight {empty:.5g} kg is not below mtow {most:.5g} kg"
            )
        return self

    def facts(self) -> AircraftFacts:
        """Return the facts."""
        return AircraftFacts(**dict(self))


# lift coefficient at the decision speed; that of take-offs is 0.7 to 2
_LEAST_LIFT = 0.42
MASS_ROUNDING = 2e-3  # relative: a mass is printed to three or four digits


def fact_problems(
    facts: AircraftFacts, mass: float, *, S: float, cbar: float, engines: int
) -> list[str]:
    """Return the contradictions between the facts and the other parts of an aircraft file.

    Parameters
    ----------
    facts : AircraftFacts
    mass : float
        Gross mass of the file. [kg]
    S, cbar : float
        Reference area and chord. [m2, m]
    engines : int
        Number of engine tables.
    """
    problems = []
    if facts.v1 is not None:
        # 2 m g / (rho V^2 S) at sea level
        CL = 2.0 * max(mass, facts.mtow or 0.0) * G0 / (RHO_SEA * facts.v1**2 * S)
        if CL < _LEAST_LIFT:
            problems.append(
                f"facts.v1: {facts.v1:.4g} m/s is {from_si(facts.v1, 'kt'):.4g} kt, at which the "
                f"wing of {S:.4g} m2 carries the aircraft with a lift coefficient of {CL:.2g}, far "
                f"from its take-off; write '{facts.v1:.4g} kt' if that is meant"
            )
    if facts.mtow is not None and mass > facts.mtow * (1.0 + MASS_ROUNDING):
        problems.append(
            f"facts.mtow: {facts.mtow:.5g} kg is below the gross mass {mass:.5g} kg of the file; "
            f"correct one of the two"
        )
    empty = facts.basic_operating_weight
    if empty is not None and mass < empty * (1.0 - MASS_ROUNDING):
        problems.append(
            f"facts.basic_operating_weight: {empty:.5g} kg is above the gross mass {mass:.5g} kg "
            f"of the file; correct one of the two"
        )
    if facts.engines is not None and engines and facts.engines != engines:
        problems.append(
            f"facts.engines: {facts.engines}, and the file has {engines} tables [[engine]]; "
            f"correct one of the two"
        )
    # a reference chord of another definition differs by some percent, a wrong unit by 3.28
    if facts.mean_chord is not None and not 0.5 < facts.mean_chord / cbar < 2.0:
        problems.append(
            f"facts.mean_chord: {facts.mean_chord:.4g} m, and the reference chord cbar is "
            f"{cbar:.4g} m; check the units"
        )
    return problems


@dataclass(frozen=True)
class FileFacts:
    """What an aircraft file states about a flight test, without its tables.

    Attributes
    ----------
    name : str
        Name of the aircraft; empty if the file has none.
    facts : AircraftFacts
        With the number of engine tables as the number of engines, if it is not given.
    limits : mapping of str to Any
        The section ``[limits]`` as written.
    runway : str
        State of the runway in ``[gear]``; empty if it is not given.
    cbar : float or None
        Reference chord; None if it is not a length. [m]
    x_ref_mac : float or None
        Moment reference point behind the leading edge of the mean chord, in chords; None if the
        file does not state it. [1]
    hinge_loaded : tuple of str
        Circuits without a centring spring: only the hinge moment of the surface loads them, so the
        pilot feels the air.
    """

    name: str
    facts: AircraftFacts
    limits: Mapping[str, Any]
    runway: str
    cbar: float | None = None
    x_ref_mac: float | None = None
    hinge_loaded: tuple[str, ...] = ()

    def chord_position(self, x_cg_b: float) -> float | None:
        """Return a centre of gravity in chords behind the leading edge; None if it is not known.

        Parameters
        ----------
        x_cg_b : float
            Forward of the moment reference point. [m]
        """
        if self.cbar is None or self.x_ref_mac is None:
            return None
        return self.x_ref_mac - x_cg_b / self.cbar


def read_facts(path: str | Path) -> FileFacts:
    """Read the facts of an aircraft file, without the tables of its engines.

    Many cases of a report name one file, so the facts of an unchanged file are read once.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        The section ``[facts]`` is wrong.
    """
    path = Path(path).resolve()
    state = path.stat()
    return _read_facts(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)
def _read_facts(path: Path, changed: int, size: int) -> FileFacts:
    content = read_toml(path)
    table = validate_content(FactsTable, content.get("facts", {}), f"{path}, [facts]")
    facts = table.facts()
    engines = content.get("engine", [])
    if facts.engines is None and isinstance(engines, list) and engines:
        facts = AircraftFacts(**{**facts.known(), "engines": len(engines)})
    gear = content.get("gear", {})
    runway = gear.get("condition", "") if isinstance(gear, dict) else ""
    limits = content.get("limits", {})
    return FileFacts(
        str(content.get("name", "")),
        facts,
        limits if isinstance(limits, dict) else {},
        str(runway),
        cbar=_stated_number(content, "cbar", "m"),
        x_ref_mac=_stated_number(content, "x_ref_mac", "1"),
        hinge_loaded=_hinge_loaded(content.get("circuit", {})),
    )


def _hinge_loaded(circuits: Any) -> tuple[str, ...]:
    """Return the names of circuits without a centring spring."""
    if not isinstance(circuits, dict):
        return ()
    tables = {name: table for name, table in circuits.items() if isinstance(table, dict)}
    return tuple(name for name, table in tables.items() if not table.get("stiffness"))


def _stated_number(content: Mapping[str, Any], key: str, unit: str) -> float | None:
    """Return a number of an aircraft file [SI]; None if it is missing or wrong there."""
    try:
        return parse_quantity(content[key], unit)
    except (KeyError, UnitError, TypeError):
        # the reader of the whole file reports a wrong one
        return None
