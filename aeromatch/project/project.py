"""A project: one aircraft, its listings, its flights, its test points and its Proof-of-Match cases,
from one TOML file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from glob import glob
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import Field, field_validator, model_validator

from aeromatch.project.sections import (
    Controls,
    ControlSection,
    EngineSection,
    GearSection,
    GroundEffectSection,
    RecordSelection,
    section_selections,
)
from datcom_io.reading.reader import ListingCase, place_of
from flightmech import terms
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, file_schema, validate_content
from flightmech.support.toml_quantities import UNFILLED, InUnits
from flightmech.units import parse_quantity
from flighttest.reconstruction.dynamics.force_coefficients import ERRORS
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.engine.tables import read_structure
from pom.cases.case_file import Role, Signature, plain_signatures

STATED = ("powered", "tailless", "move_reference")
"""What a project may state about its listings, see `aerodb.from_datcom`."""

OWN_MODELS = ("datcom", "corrected", "final")
"""Names of the models that a project makes."""


class NewTerm(Strict):
    """A term that the listings cannot give: zero at first, with a wide standard error, for the
    flights to find.
    """

    axes: dict[str, tuple[float | str, ...]] = Field(
        default={},
        description="Breakpoints by axis, SI or with units; without them one number.",
        examples=[{"delta_f": ["0 deg", "40 deg"]}],
    )
    regressors: tuple[str, ...] = Field(
        default=(), description="What the table is multiplied by.", examples=[["gear"]]
    )
    stderr: float | tuple[float, ...] = Field(
        description="Standard error of the zero it starts from: one for all nodes, or one each.",
        examples=[0.05],
    )
    comment: str = Field(
        default="", description="Why the term is there.", examples=["drag of the gear"]
    )

    def leaf(self) -> xr.Dataset:
        """Return the term, zero at every node."""
        axes = {
            name: [parse_quantity(point, lookup(name).units) for point in points]
            for name, points in self.axes.items()
        }
        value = np.zeros(tuple(len(points) for points in axes.values()))
        if np.ndim(self.stderr) and np.shape(self.stderr) != value.shape:
            raise SchemaError(
                "term",
                [
                    f"stderr has {np.size(self.stderr)} values for {value.size} nodes; give "
                    f"one for all, or one per node"
                ],
            )
        return terms.make_term(
            value,
            axes,
            self.regressors,
            stderr=self.stderr,
            source="judgement",
            comment=self.comment,
        )


class FitSection(RecordSelection):
    """Manoeuvres or windows of a record that are fitted together by each of some models; the same
    for each of `records`.
    """

    name: str = Field(description="Name of the fit, for the report.")
    models: tuple[str, ...] = Field(
        description="Models to fit, one for each coefficient: terms of the right-hand side are "
        "regressors."
    )

    @model_validator(mode="after")
    def _of_something(self) -> FitSection:
        if not self.manoeuvres and not self.window:
            raise ValueError(
                "neither manoeuvres nor window; give one of them, as window = [start, end] "
                "in seconds of the record"
            )
        return self


class ThirdPartyModel(Strict):
    """A model from elsewhere that is replayed with those of the project, and its table of names
    (`pom.replay`).
    """

    fmu: str = Field(
        description="The FMU, relative to this file.", examples=["other/simulator.fmu"]
    )
    names: str = Field(
        default="",
        description="Its table of names, when names, units or signs are not the canonical ones.",
        examples=["other/names.toml"],
    )


Paths = str | tuple[str, ...]


class Listings(Strict):
    """Digital DATCOM listings by their role in `aerodb.from_datcom`, one or several each;
    ``FILE:CASE`` takes one case of a file.
    """

    clean: Paths = Field(description="The whole aeroplane without deflections.")
    flaps: Paths = Field(default=(), description="Increments of the flaps.")
    elevator: Paths = Field(default=(), description="Increments of the elevator or stabiliser.")
    aileron: Paths = Field(default=(), description="Increments of the ailerons.")
    ground: Paths = Field(default=(), description="The whole aeroplane in ground effect.")
    ground_flap: Paths = Field(default=(), description="The same with flaps.")
    ground_elevator: Paths = Field(
        default=(), examples=["datcom/ground_elevator.out"], description="The same with elevator."
    )
    power: Paths = Field(
        default=(),
        examples=["datcom/power.out"],
        description="The whole aeroplane with power effects.",
    )
    spoilers: Paths = Field(
        default=(), examples=["datcom/spoilers.out"], description="Increments of the spoilers."
    )
    differential_tail: Paths = Field(
        default=(),
        examples=["datcom/differential_tail.out"],
        description="Increments of a differential tail.",
    )
    tabs: Paths = Field(
        default=(), examples=["datcom/tabs.out"], description="Increments of trim tabs."
    )
    aileron_hinge: Paths = Field(
        default=(),
        examples=["datcom/aileron_hinge.out"],
        description="Hinge moments of the ailerons.",
    )
    altitude: Annotated[float, InUnits("m")] | None = Field(
        default=None, examples=["5000 ft"], description="Reference altitude of the a-priori tables."
    )
    powered: bool = Field(
        default=False,
        description="Whether clean pages hold power effects: thrust terms are taken off and "
        "standard errors are wider.",
    )
    tailless: bool = Field(
        default=False, description="Whether the aeroplane has no horizontal tail."
    )
    move_reference: bool = Field(
        default=False,
        description="Whether the listing's reference point is moved to that of the aircraft file.",
    )


class _ProjectFile(Strict):
    title: str = Field(description="Title of the project and its report.")
    aircraft: str = Field(description="Aircraft file.")
    apriori: str | None = Field(
        default=None,
        description="Aircraft file as it was known before the flights; without it aircraft.",
    )
    names: str | None = Field(
        default=None,
        description="Name map of the flight records; not needed where they have canonical names.",
    )
    flights: Paths = Field(
        description="Pattern of the flight records, or several; a record is named by its file "
        "without extension."
    )
    manoeuvres: str | None = Field(
        default=None,
        description="Table of manoeuvres, CSV or TOML; its rows stand in place of the marks that "
        "their records carry.",
    )
    listings: Listings = Field(
        description="Digital DATCOM listings by role: FILE, FILE:CASE, or several."
    )
    cases: tuple[str, ...] = Field(description="Patterns of Proof-of-Match cases.")
    cutoff: Annotated[float, InUnits("Hz")] | None = Field(
        default=None, description="Low-pass before coefficients are formed; none without it."
    )
    tabulation: Literal["tabulate", "direct", "join"] = Field(
        default="tabulate",
        description="How flights enter the tables: local models projected on the nodes, nodes "
        "estimated directly from the samples, or "
        "local models joined by regression.",
    )
    unplaced: Literal["raise", "warn"] = Field(
        default="raise",
        description="What to do if no table of the database carries a significant term of a fit: "
        "stop, or go on with a warning in the "
        "history of the database and in the report.",
    )
    held: tuple[str, ...] = Field(
        default=(), examples=[["Cm/qhat"]], description="Terms that keep their a-priori value."
    )
    errors: dict[str, Annotated[float, Field(ge=0.0)]] = Field(
        default={},
        json_schema_extra={"propertyNames": {"enum": list(ERRORS)}},
        description="Relative standard errors where not the defaults of flighttest.coefficients.",
    )
    terms: dict[str, NewTerm] = Field(
        default={},
        description="Terms that the listings cannot give, zero at first, by a name such as CL/gear.",
    )
    models: dict[str, ThirdPartyModel] = Field(
        default={}, description="Models from elsewhere that are replayed as well, by name."
    )
    fit: tuple[FitSection, ...] = Field(
        description="Local models: what is fitted to which manoeuvres."
    )
    published: tuple[str, ...] = Field(
        default=(),
        examples=[["literature/local_models.csv"]],
        description="Local models from elsewhere with standard errors, CSV; they identify as the "
        "fits do.",
    )
    engine: EngineSection | None = Field(
        default=None,
        description="Identification of the engine; without it that of the aircraft file.",
    )
    controls: Controls = Field(
        default=Controls(), description="Identification of the control loading, by control."
    )
    gear: GearSection | None = Field(
        default=None,
        description="Identification of the landing gear; without it that of the aircraft file.",
    )
    ground_effect: GroundEffectSection | None = Field(
        default=None,
        description="Identification of the ground effect; without it that of the listings.",
    )
    signatures: dict[Role, Signature] = Field(
        default={}, description="Who signs the report, by role; printed on its cover."
    )
    chapters: tuple[Literal["identification", "database"], ...] = Field(
        default=(),
        examples=[["identification", "database"]],
        description="Chapters of the PDF behind the proof of match: the data report of local "
        "models and databases.",
    )

    @field_validator("cutoff")
    @classmethod
    def _above_zero(cls, cutoff: float | None) -> float | None:
        if cutoff is not None and not 0.0 < cutoff < math.inf:
            raise ValueError(
                "a low-pass needs a frequency of more than 0 Hz; leave the key out for none"
            )
        return cutoff


@dataclass(frozen=True)
class Project:
    """A project as read; paths are absolute.

    Attributes
    ----------
    title : str
    file, aircraft : Path
        The project file, the aircraft file.
    names : Path or None
        The name map of the flight records; None where they speak canonical names.
    apriori : Path or None
        The aircraft as it was known before the flights, when its engines, gear or control circuits
        were others.
    listings : dict of str to tuple of Place
        Digital DATCOM listings, or single cases of them, by their role in `aerodb.from_datcom`:
        ``clean``, ``flaps``, ``elevator`` ...
    altitude : float or None
        Reference altitude of the a-priori tables. [m]
    flights : dict of str to Path
        Flight records by stem.
    cases : tuple of Path
        Proof-of-Match case files.
    cutoff : float or None
        Low-pass applied before coefficients are formed. [Hz]
    errors : dict of str to float
        Relative standard errors of ``qbar mass inertia thrust`` that differ from the defaults, see
        `flighttest.coefficients`.
    terms : dict of str to NewTerm
        Terms that start from nothing, by ``CL/gear``.
    held : tuple of str
        Terms that keep their a-priori value in the identification.
    fits : tuple of Fit
    models : dict of str to Path
        FMUs from elsewhere, by the name of the model.
    tables : dict of str to Path
        Their tables of names, for those that have one.
    engine : Engine or None
        How the engine is identified; None keeps that of the aircraft file.
    controls : dict of str to Control
        How the control loading is identified, by ``column wheel pedal``.
    gear : Gear or None
        How the landing gear is identified; None keeps that of the aircraft file.
    ground_effect : GroundEffect or None
        How the ground effect is identified; None leaves it to the tables over height.
    points : dict of str to Path
        Files for the engine: settled ``points``, ``climbs``, and the ``structure`` of its deck.
    manoeuvres : Path or None
        Table of manoeuvres, in place of the marks of its records
        (`flighttest.records.read_manoeuvres`).
    stated : dict of str to bool
        What is stated about the listings: `STATED`.
    published : tuple of Path
        Files of local models from elsewhere (`flighttest.combining.read_published`).
    tabulation : str
        How the flights enter the tables: a key of `aeromatch.workflow.WAYS`.
    unplaced : {"raise", "warn"}
        What happens if no table carries a significant term of a fit (`aerodb.tabulate`).
    chapters : tuple of str
        Chapters of the PDF behind the proof of match (`pom.write_report`).
    signatures : dict of str to dict
        Who signs the report, by role: ``name``, ``date``, ``organisation``.
    """

    title: str
    file: Path
    aircraft: Path
    apriori: Path | None
    names: Path | None
    listings: dict[str, tuple[ListingCase, ...]]
    altitude: float | None
    flights: dict[str, Path]
    cases: tuple[Path, ...]
    cutoff: float | None
    errors: dict[str, float]
    terms: dict[str, NewTerm]
    held: tuple[str, ...]
    fits: tuple[FitSection, ...]
    models: dict[str, Path] = field(default_factory=dict)
    tables: dict[str, Path] = field(default_factory=dict)
    engine: EngineSection | None = None
    controls: dict[str, ControlSection] = field(default_factory=dict)
    gear: GearSection | None = None
    ground_effect: GroundEffectSection | None = None
    points: dict[str, Path] = field(default_factory=dict)
    manoeuvres: Path | None = None
    stated: dict[str, bool] = field(default_factory=dict)
    published: tuple[Path, ...] = ()
    tabulation: str = "tabulate"
    chapters: tuple[str, ...] = ()
    signatures: dict[str, dict[str, str]] = field(default_factory=dict)
    unplaced: str = "raise"

    @property
    def submodels(self) -> dict[str, tuple[RecordSelection, ...]]:
        """Records and manoeuvres that identify the submodels, by the place in the project file."""
        return section_selections(self.engine, self.controls, self.gear, self.ground_effect)


def read_project(path: str | Path) -> Project:
    """Read a project file and check that everything it names is there.

    Parameters
    ----------
    path : path
        ``aeromatch.toml``.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        All unknown keys and wrong types; when there are none, all missing files, unknown records
        and quantities, and faulty models.
    """
    path = Path(path)
    content = validate_content(_ProjectFile, read_toml(path), str(path))
    folder = path.resolve().parent
    problems: list[str] = []

    def existing(name: str, place: str) -> Path:
        file = folder / name
        if not file.is_file():
            problems.append(f"{place}: no file {name!r} in {folder}")
        return file

    def listing(text: str, place: str) -> ListingCase:
        if text == UNFILLED:
            problems.append(
                f"{place}: {UNFILLED!r} stands for a listing that is still to be given; "
                f"write FILE, or FILE:CASE"
            )
            return ListingCase(folder / text)
        try:
            return place_of(text, folder)
        except FileNotFoundError:
            problems.append(
                f"{place}: no file {text!r} in {folder}; write FILE, or FILE:CASE for one "
                f"case of it"
            )
            return ListingCase(folder / text)

    given = {
        role: paths
        for role, paths in content.listings
        if role not in ("altitude", *STATED) and paths
    }
    listings = {
        role: tuple(
            listing(name, f"listings.{role}")
            for name in ((paths,) if isinstance(paths, str) else paths)
        )
        for role, paths in given.items()
    }
    patterns = (content.flights,) if isinstance(content.flights, str) else content.flights
    flights = {file.stem: file for pattern in patterns for file in _matching(folder, pattern)}
    problems += [
        f"flights: {_no_match(folder, pattern)}"
        for pattern in patterns
        if not _matching(folder, pattern)
    ]
    if not patterns:
        problems.append("flights: an empty list; give a file or a pattern such as 'flight/*.csv'")
    for number, fit in enumerate(content.fit):
        for record in fit.records:
            if record not in flights:
                problems.append(f"fit.{number}.records: {UnknownName(record, flights, 'record')}")
        for model in fit.models:
            _collect(problems, f"fit.{number}.models", RegressionModel.parse, model)
    problems += _submodel_problems(content, flights)
    for source in content.errors:
        if source not in ERRORS:
            problems.append(f"errors: {UnknownName(source, ERRORS, 'source of error')}")
    for term, new in content.terms.items():
        _collect(problems, f"terms.{term}", new.leaf)
    cases = tuple(file for pattern in content.cases for file in _matching(folder, pattern))
    problems += [
        f"cases: {_no_match(folder, pattern)}"
        for pattern in content.cases
        if not _matching(folder, pattern)
    ]
    for name in content.models:
        if name in OWN_MODELS or name == "flight":
            problems.append(
                f"models.{name}: the name is taken; call it otherwise than flight, "
                f"{', '.join(OWN_MODELS)}"
            )
    wanted = {
        name: getattr(content.engine, name, None) for name in ("points", "climbs", "structure")
    }
    engine_files = {name: existing(file, f"engine.{name}") for name, file in wanted.items() if file}
    structure = engine_files.get("structure")
    if structure is not None and structure.is_file():
        _collect(problems, "engine.structure", read_structure, structure)
    project = Project(
        content.title,
        path.resolve(),
        existing(content.aircraft, "aircraft"),
        existing(content.apriori, "apriori") if content.apriori else None,
        existing(content.names, "names") if content.names else None,
        listings,
        content.listings.altitude,
        flights,
        cases,
        content.cutoff,
        content.errors,
        content.terms,
        content.held,
        content.fit,
        {name: existing(item.fmu, f"models.{name}.fmu") for name, item in content.models.items()},
        {
            name: existing(item.names, f"models.{name}.names")
            for name, item in content.models.items()
            if item.names
        },
        content.engine,
        content.controls.given,
        content.gear,
        content.ground_effect,
        engine_files,
        existing(content.manoeuvres, "manoeuvres") if content.manoeuvres else None,
        {name: getattr(content.listings, name) for name in STATED},
        tuple(existing(name, "published") for name in content.published),
        content.tabulation,
        content.chapters,
        plain_signatures(content.signatures),
        content.unplaced,
    )
    if problems:
        raise SchemaError(str(path), problems)
    return project


def project_schema() -> dict[str, Any]:
    """Return the JSON schema of project files."""
    return file_schema(
        _ProjectFile,
        "A project: one aircraft, its listings, its flights and its Proof-of-Match cases.",
    )


def _matching(folder: Path, pattern: str) -> list[Path]:
    """Return the files that a pattern names, from `folder` or absolute, in order."""
    return sorted(
        Path(name) for name in glob(str(folder / pattern), recursive=True) if Path(name).is_file()
    )


def _no_match(folder: Path, pattern: str) -> str:
    if pattern == UNFILLED:
        return (
            f"{UNFILLED!r} stands for files that are still to be given; write a file or a "
            f"pattern such as 'folder/*.csv'"
        )
    if pattern and (folder / pattern).is_dir():
        return f"{pattern!r} is a folder; name its files, such as {str(Path(pattern) / '*')!r}"
    return (
        f"no file matches {pattern!r} in {folder}; give a file or a pattern such as 'folder/*.toml'"
    )


def _submodel_problems(content: _ProjectFile, flights: Mapping[str, Path]) -> list[str]:
    """Return what is wrong with the sections of the submodels."""
    found = [
        text
        for section in (content.engine, content.gear, content.ground_effect)
        if section is not None
        for text in section.problems()
    ]
    found += [text for item, one in content.controls.given.items() for text in one.problems(item)]
    for place, flown in section_selections(
        content.engine, content.controls.given, content.gear, content.ground_effect
    ).items():
        records = dict.fromkeys(record for one in flown for record in one.records)
        found += [
            f"{place}.records: {UnknownName(record, flights, 'record')}"
            for record in records
            if record not in flights
        ]
    return found


def _collect(problems: list[str], place: str, act: Callable[..., object], *items: object) -> None:
    """Call ``act(*items)``; an error becomes one more problem."""
    try:
        act(*items)
    except SchemaError as error:
        problems += [f"{place}: {text}" for text in error.problems]
    except AeromatchError as error:
        problems.append(f"{place}: {error}")
