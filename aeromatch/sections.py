"""Sections of a project file that identify a submodel: ``[engine]``, ``[controls.*]``, ``[gear]``, ``[ground_effect]``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.support.configuration import Strict, si
from flighttest import Model
from flighttest.control_loading.loading import COEFFICIENT, FORCES
from flighttest.landing_gear.reconstructed_loads import ERRORS

GEAR_ERRORS = (*ERRORS, "wind")
Names = tuple[str, ...]
Positive = Annotated[float, Field(gt=0.0)]


class Flown(Strict):
    """Records, and what is taken of each: manoeuvres that it marks, and windows from start to end; without both the whole record."""

    records: Annotated[Names, Field(min_length=1)]
    manoeuvres: Names = ()
    window: tuple[tuple[si("s"), si("s")], ...] = ()  # type: ignore[valid-type]

    @field_validator("window", mode="before")
    @classmethod
    def _several(cls, item: Any) -> Any:
        """One window may stand alone."""
        return (item,) if isinstance(item, list | tuple) and len(item) == 2 and not isinstance(item[0], list | tuple) else item

    @field_validator("window")
    @classmethod
    def _forward(cls, item: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        """A window ends after its start."""
        for start, end in item:
            if not start < end:
                raise ValueError(f"a window from {start:g} to {end:g} s; give start and end in seconds of the record, the end later")
        return item


class GroundEffect(Strict):
    """``[ground_effect]``: landings and low passes, and records in free air of the same flap setting, for `identify_ground_effect`."""

    flown: Annotated[tuple[Flown, ...], Field(min_length=1)]
    models: Annotated[Names, Field(min_length=1)]
    ground: Names = ()
    free_air: Literal["estimated", "held"] = "estimated"
    tables: bool = False

    def problems(self) -> Iterator[str]:
        """Yield what is wrong with the models."""
        for key in ("models", "ground"):
            for text in getattr(self, key):
                yield from _faults(f"ground_effect.{key}", Model.parse, text)


class Gear(Strict):
    """``[gear]``: ground runs and landings with the compression of the legs, for `identify_landing_gear`."""

    flown: Annotated[tuple[Flown, ...], Field(min_length=1)]
    errors: dict[str, Annotated[float, Field(ge=0.0)]] = {}
    output_error: bool = True

    def problems(self) -> Iterator[str]:
        """Yield what is wrong with the standard errors."""
        for name in self.errors:
            if name not in GEAR_ERRORS:
                yield f"gear.errors: {UnknownName(name, GEAR_ERRORS, 'source of error')}"


class Engine(Strict):
    """``[engine]``: power changes that begin at rest, starts, and settled points, for `identify_engine`."""

    flown: tuple[Flown, ...] = ()
    flights: tuple[Flown, ...] = ()
    starts: tuple[Flown, ...] = ()
    engines: tuple[Annotated[int, Field(ge=1)], ...] = (1,)
    pla: tuple[si("rad"), si("rad")] | None = None  # type: ignore[valid-type]
    rate: Positive = 25.0
    structure: str | None = None
    points: str | None = None
    climbs: str | None = None
    polar: tuple[float, float] | None = None
    polar_stderr: tuple[float, float] = (0.0, 0.0)

    def problems(self) -> Iterator[str]:
        """Yield what is missing."""
        if not (self.flown or self.flights or self.starts or self.points or self.climbs):
            yield "engine: no records; give flown, flights, starts, points or climbs"
        if self.climbs and self.polar is None:
            yield "engine.polar: missing; climbs need CD0 and K of the drag polar"


class Control(Strict):
    """``[controls.column]``, ``wheel`` or ``pedal``: slow manoeuvres and free motion, for `identify_control_loading`."""

    driven: Annotated[tuple[Flown, ...], Field(min_length=1)]
    free: tuple[Flown, ...] = ()
    model: str = ""
    constants: Names = ()
    arm: si("m") = 0.0  # type: ignore[valid-type]
    order: Literal[2, 4] = 4

    def problems(self, item: str) -> Iterator[str]:
        """Yield what is wrong with model and constants."""
        place = f"controls.{item}"
        if self.model:
            yield from _faults(f"{place}.model", _hinge_moment, self.model, COEFFICIENT[item])
        for name in self.constants:
            if name not in FORCES:
                yield f"{place}.constants: {UnknownName(name, FORCES, 'term of the force')}"


class Controls(Strict):
    """``[controls]``: one table for each control."""

    column: Control | None = None
    wheel: Control | None = None
    pedal: Control | None = None

    @property
    def given(self) -> dict[str, Control]:
        """The controls that have a table."""
        return {item: one for item, one in self if one is not None}


def selections(
    engine: Engine | None, controls: Mapping[str, Control], gear: Gear | None, ground_effect: GroundEffect | None
) -> dict[str, tuple[Flown, ...]]:
    """Return the records and manoeuvres of every section, by the place in the project file."""
    found: dict[str, tuple[Flown, ...]] = {}
    if engine is not None:
        found |= {"engine.flown": engine.flown, "engine.flights": engine.flights, "engine.starts": engine.starts}
    for item, one in controls.items():
        found |= {f"controls.{item}.driven": one.driven, f"controls.{item}.free": one.free}
    if gear is not None:
        found["gear.flown"] = gear.flown
    if ground_effect is not None:
        found["ground_effect.flown"] = ground_effect.flown
    return {place: flown for place, flown in found.items() if flown}


def _hinge_moment(text: str, coefficient: str) -> None:
    model = Model.parse(text)
    if model.coefficient != coefficient:
        raise UnknownName(model.coefficient, [coefficient], "hinge-moment coefficient")


def _faults(place: str, act: Callable[..., object], *items: object) -> Iterator[str]:
    """Yield the faults that ``act(*items)`` finds."""
    try:
        act(*items)
    except SchemaError as error:
        yield from (f"{place}: {text}" for text in error.problems)
    except AeromatchError as error:
        yield f"{place}: {error}"
