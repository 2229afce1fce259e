"""Sections of a project file that identify a submodel: ``[engine]``, ``[controls.*]``, ``[gear]``,
``[ground_effect]``, ``[stall]``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.quantities import time_text
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.control_loading.loading import COEFFICIENT, FORCES
from flighttest.submodels.landing_gear.reconstructed_loads import ERRORS
from flighttest.submodels.stall.model import COEFFICIENTS, demand_attached, demand_station

GEAR_ERRORS = (*ERRORS, "wind")
Names = tuple[str, ...]
Positive = Annotated[float, Field(gt=0.0)]
# CD0, K and their standard errors, as in `Polar.demand_possible`.
_ProfileDrag = Annotated[float, Field(gt=0.0, lt=1.0)]
_InducedDrag = Annotated[float, Field(ge=0.0, lt=2.0)]
_DragError = Annotated[float, Field(ge=0.0, lt=1.0)]


class RecordSelection(Strict):
    """Records, and what is taken of each: manoeuvres that it marks, and windows from start to end;
    without both the whole record.
    """

    records: Annotated[Names, Field(min_length=1)] = Field(
        examples=[["run_1", "run_2"]], description="Records, by file name without extension."
    )
    manoeuvres: Names = Field(
        default=(),
        examples=[["doublet elevator"]],
        description="Manoeuvres of the records, by kind, or by kind and control.",
    )
    window: tuple[tuple[Annotated[float, InUnits("s")], Annotated[float, InUnits("s")]], ...] = (
        Field(
            default=(),
            examples=[[[12.0, 27.5]]],
            description="[start, end] in seconds of the record, or several.",
        )
    )

    @field_validator("window", mode="before")
    @classmethod
    def _accept_single_window(cls, item: Any) -> Any:
        """Return a sequence of windows, also for ``[start, end]``."""
        if not isinstance(item, list | tuple) or len(item) != 2:
            return item
        # Two windows also have a length of 2, but their items are sequences.
        if isinstance(item[0], list | tuple):
            return item
        return (item,)

    @field_validator("window")
    @classmethod
    def _require_order(
        cls, item: tuple[tuple[float, float], ...]
    ) -> tuple[tuple[float, float], ...]:
        """Raise if a window does not end after its start."""
        for start, end in item:
            if not start < end:
                raise ValueError(
                    f"a window from {time_text(start)} to {time_text(end)} s; give start and end "
                    f"in seconds of the record, the end later"
                )
        return item


class GroundEffectSection(Strict):
    """``[ground_effect]``: landings and low passes, and records in free air of the same flap
    setting, for `identify_ground_effect`.
    """

    flown: Annotated[tuple[RecordSelection, ...], Field(min_length=1)] = Field(
        description="Low passes, landings, and free air with the same flaps."
    )
    models: Annotated[Names, Field(min_length=1)] = Field(
        examples=[["CL = 1 + alpha + delta_e"]], description="Free-air terms of each coefficient."
    )
    ground: Names = Field(
        default=(),
        description="Terms that the ground may change; all without it.",
        examples=[["CL = 1 + alpha"]],
    )
    free_air: Literal["estimated", "held"] = Field(
        default="estimated",
        description="Whether the free-air terms are estimated too, or held at the database.",
    )
    tables: bool = Field(
        default=False,
        description="Whether the effect is a table over the height in place of k h^s.",
    )

    def problems(self) -> Iterator[str]:
        """Yield what is wrong with the models."""
        for key in ("models", "ground"):
            for text in getattr(self, key):
                yield from find_faults(f"ground_effect.{key}", RegressionModel.parse, text)


class StallSection(Strict):
    """``[stall]``: quasi-steady and accelerated stalls with their entries, for `identify_stall`."""

    flown: Annotated[tuple[RecordSelection, ...], Field(min_length=1)] = Field(
        description="Quasi-steady and accelerated stalls with their entries."
    )
    attached_to: str = Field(
        default="",
        examples=["12 deg"],
        description="Angle of attack from which the tables of the database go on linearly, where "
        "they contain a stall.",
    )
    station: str = Field(
        default="",
        examples=["2.5 m"],
        description="Station of the wing halves from the plane of symmetry. Default: a quarter of "
        "the span.",
    )
    over: str = Field(
        default="",
        examples=["delta_f"],
        description="Variable of the configuration over which a1 and alpha_star are tables.",
    )
    coefficients: Names = Field(
        default=("CL", "CD", "Cm", "Cl", "Cn"),
        examples=[["CL", "CD", "Cm"]],
        description="Coefficients to fit; CL is needed.",
    )
    attached: Names = Field(
        default=(),
        examples=[["CL = 1 + alpha + qhat"]],
        description="Terms of the attached flow that are estimated along, by coefficient.",
    )

    @property
    def models(self) -> tuple[str, ...]:
        """Models that need the variables which the records have to hold."""
        more = f" + {self.over}" if self.over else ""
        return (f"CL = 1 + alpha + p + r + V{more}", *self.attached)

    def problems(self) -> Iterator[str]:
        """Yield what is wrong with models, coefficients and quantities."""
        for text in self.attached:
            yield from find_faults("stall.attached", RegressionModel.parse, text)
        for name in self.coefficients:
            if name not in COEFFICIENTS:
                unknown = UnknownName(name, COEFFICIENTS, "coefficient of a stall")
                yield f"stall.coefficients: {unknown}"
        if len(set(self.coefficients)) < len(self.coefficients):
            yield "stall.coefficients: a coefficient occurs twice; give each once"
        if "CL" not in self.coefficients:
            yield "stall.coefficients: CL is missing; it shows the separation, add it"
        if self.station:
            yield from find_faults("stall.station", demand_station, self.station)
        if self.attached_to:
            yield from find_faults("stall.attached_to", demand_attached, self.attached_to)


class GearSection(Strict):
    """``[gear]``: ground runs and landings with the compression of the legs, for
    `identify_landing_gear`.
    """

    flown: Annotated[tuple[RecordSelection, ...], Field(min_length=1)] = Field(
        description="Ground runs and landings with the compression of every leg."
    )
    errors: dict[str, Annotated[float, Field(ge=0.0)]] = Field(
        default={},
        json_schema_extra={"propertyNames": {"enum": list(GEAR_ERRORS)}},
        examples=[{"drag": 0.02}],
        description="Standard errors where not the defaults.",
    )
    output_error: bool = Field(
        default=True,
        description="Whether tyres and steering are estimated by output error too, or by wheel "
        "loads alone.",
    )

    def problems(self) -> Iterator[str]:
        """Yield what is wrong with the standard errors."""
        for name in self.errors:
            if name not in GEAR_ERRORS:
                yield f"gear.errors: {UnknownName(name, GEAR_ERRORS, 'source of error')}"


class EngineSection(Strict):
    """``[engine]``: power changes that begin at rest, starts, and settled points, for
    `identify_engine`.
    """

    flown: tuple[RecordSelection, ...] = Field(
        default=(), description="Chops, slams and steps, each beginning with the lever at rest."
    )
    flights: tuple[RecordSelection, ...] = Field(
        default=(),
        description="Whole flights: power changes are cut out of them, and the tables that "
        "structure names estimated; with propellers also thrust and power.",
    )
    starts: tuple[RecordSelection, ...] = Field(default=(), description="Starts and shut-downs.")
    engines: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        default=(1,), examples=[[1, 2]], description="Engines of the records, averaged."
    )
    pla: tuple[Annotated[float, InUnits("rad")], Annotated[float, InUnits("rad")]] | None = Field(
        default=None,
        description="Lever angles of idle and full power, where records have angles.",
        examples=[["10 deg", "50 deg"]],
    )
    rate: Positive = Field(
        default=25.0,
        examples=[10.0],
        description="Samples of the records per second that are used.",
    )
    structure: str | None = Field(
        default=None,
        examples=["engine.toml"],
        description="TOML file of what the tables depend on.",
    )
    points: str | None = Field(
        default=None,
        description="CSV file of settled points with recorded thrust.",
        examples=["engine_points.csv"],
    )
    climbs: str | None = Field(
        default=None,
        description="CSV file of climbs and level accelerations; needs polar.",
        examples=["climbs.csv"],
    )
    polar: tuple[_ProfileDrag, _InducedDrag] | None = Field(
        default=None,
        description="CD0 and K of the drag polar, for climbs and propellers.",
        examples=[[0.025, 0.05]],
    )
    polar_stderr: tuple[_DragError, _DragError] = Field(
        default=(0.0, 0.0),
        description="Their standard errors; zero holds them.",
        examples=[[0.001, 0.002]],
    )

    def problems(self) -> Iterator[str]:
        """Yield what is missing."""
        if not (self.flown or self.flights or self.starts or self.points or self.climbs):
            yield "engine: no records; give flown, flights, starts, points or climbs"
        if self.climbs and self.polar is None:
            yield "engine.polar: missing; climbs need CD0 and K of the drag polar"


class ControlSection(Strict):
    """``[controls.column]``, ``wheel`` or ``pedal``: slow manoeuvres and free motion, for
    `identify_control_loading`.
    """

    driven: Annotated[tuple[RecordSelection, ...], Field(min_length=1)] = Field(
        description="Slow manoeuvres at several speeds and tab settings; whole records are taken "
        "without the free manoeuvres."
    )
    free: tuple[RecordSelection, ...] = Field(default=(), description="Pulses and releases.")
    model: str = Field(
        default="", description="Hinge moment; without it the usual one of the control."
    )
    constants: Names = Field(
        default=(),
        examples=[["preload", "friction"]],
        description="Terms of the force; the rest is held at zero. Without it the usual ones of "
        "the control.",
    )
    arm: Annotated[float, InUnits("m")] = Field(
        default=0.0,
        examples=["3.4 m"],
        description="Ailerons from the plane of symmetry; the wheel needs it.",
    )
    order: Literal[2, 4] = Field(
        default=4, description="Masses: 4: cockpit and surface on a cable; 2: one."
    )
    method: Literal["best", "regression", "output error"] = Field(
        default="best",
        description="Regressions alone, or output error of the free motion started from them; best "
        "is the output error if its search converges.",
    )

    def problems(self, item: str) -> Iterator[str]:
        """Yield what is wrong with model and constants."""
        position = f"controls.{item}"
        if self.model:
            yield from find_faults(
                f"{position}.model", _require_hinge_moment, self.model, COEFFICIENT[item]
            )
        for name in self.constants:
            if name not in FORCES:
                yield f"{position}.constants: {UnknownName(name, FORCES, 'term of the force')}"


class Controls(Strict):
    """``[controls]``: one table for each control."""

    column: ControlSection | None = Field(default=None, description="Column and elevator.")
    wheel: ControlSection | None = Field(default=None, description="Wheel and ailerons.")
    pedal: ControlSection | None = Field(default=None, description="Pedals and rudder.")

    @property
    def sections(self) -> dict[str, ControlSection]:
        """The sections by control, for the controls that have one."""
        return {control: section for control, section in self if section is not None}


def section_selections(
    engine: EngineSection | None,
    controls: Mapping[str, ControlSection],
    gear: GearSection | None,
    ground_effect: GroundEffectSection | None,
    stall: StallSection | None = None,
) -> dict[str, tuple[RecordSelection, ...]]:
    """Return the records and manoeuvres of every section, by the place in the project file."""
    selections: dict[str, tuple[RecordSelection, ...]] = {}
    if engine is not None:
        selections["engine.flown"] = engine.flown
        selections["engine.flights"] = engine.flights
        selections["engine.starts"] = engine.starts
    for control, section in controls.items():
        selections[f"controls.{control}.driven"] = section.driven
        selections[f"controls.{control}.free"] = section.free
    if gear is not None:
        selections["gear.flown"] = gear.flown
    if ground_effect is not None:
        selections["ground_effect.flown"] = ground_effect.flown
    if stall is not None:
        selections["stall.flown"] = stall.flown
    # A key without records identifies nothing.
    return {key: records for key, records in selections.items() if records}


def _require_hinge_moment(text: str, coefficient: str) -> None:
    """Raise if a model is not a model of the hinge moment of the control."""
    model = RegressionModel.parse(text)
    if model.coefficient != coefficient:
        raise UnknownName(model.coefficient, [coefficient], "hinge-moment coefficient")


def repeated_records(selections: Mapping[str, tuple[RecordSelection, ...]]) -> Iterator[str]:
    """Yield records that one key takes twice: they would count twice."""
    for key, several in selections.items():
        taken: set[tuple[Any, ...]] = set()
        for selection in several:
            for record in selection.records:
                part = (record, selection.manoeuvres, selection.window)
                if part in taken:
                    yield f"{key}: record {record!r} is taken twice; take it once"
                taken.add(part)


def find_faults(position: str, act: Callable[..., object], *items: object) -> Iterator[str]:
    """Yield the problems that ``act(*items)`` raises, each with the position in the project
    file.
    """
    try:
        act(*items)
    except SchemaError as error:
        for text in error.problems:
            yield f"{position}: {text}"
    except AeromatchError as error:
        yield f"{position}: {error}"
