"""Project file: one aircraft, its listings, its flights and its Proof-of-Match cases."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationInfo,
    field_validator,
    model_validator,
)

from aerodb.edit.ice_file import read_ice
from aeromatch.project.devices import DeviceSection
from aeromatch.project.files import (
    FlightFiles,
    InputFile,
    InputFiles,
    Listings,
    MatchedFiles,
    OptionalFile,
    ProjectFolder,
)
from aeromatch.project.model_sections import FitSection, NewTerm, ThirdPartyModel
from aeromatch.project.priors import PriorSection
from aeromatch.project.sections import (
    Controls,
    EngineSection,
    GearSection,
    GroundEffectSection,
    RecordSelection,
    StallSection,
    find_faults,
    repeated_records,
    section_selections,
)
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, file_schema, validate_content
from flightmech.support.toml_quantities import InUnits
from flighttest.reconstruction.dynamics.coefficient_errors import ERRORS
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.engine.tables import read_structure
from pom.cases.signatures import Role, Signature

OWN_MODELS = ("datcom", "prior", "corrected", "final")
"""Names of the models that a project makes; ``prior`` replaces ``datcom`` with `[[prior]]`."""


class Project(Strict):
    """A project. The attributes are the keys of its file; all paths are absolute."""

    # `project_schema` describes the file, so the schema does not use the docstring.
    model_config = ConfigDict(json_schema_extra=lambda schema: schema.pop("description", None))
    _file: Path = PrivateAttr(default=Path())
    title: str = Field(max_length=200, description="Title of the project and its report.")
    aircraft: InputFile = Field(description="Aircraft file.")
    apriori: OptionalFile = Field(
        default=None,
        description="Aircraft file as it was known before the flights; without it aircraft.",
    )
    names: OptionalFile = Field(
        default=None,
        description="Name map of the flight records; not needed where they have canonical names.",
    )
    flights: FlightFiles = Field(
        description="Pattern of the flight records, or several; a record is named by its file "
        "without extension."
    )
    manoeuvres: OptionalFile = Field(
        default=None,
        description="Table of manoeuvres, CSV or TOML; its rows stand in place of the marks that "
        "their records carry.",
    )
    listings: Listings = Field(
        default=Listings(),
        description="Digital DATCOM listings by role: FILE, FILE:CASE, a pattern, or several. "
        "Without listings the a-priori database is that of `[[prior]]`.",
    )
    prior: tuple[PriorSection, ...] = Field(
        default=(),
        max_length=20,
        description="Further a-priori sources, blended with the listings by their standard errors.",
    )
    take: dict[str, str] = Field(
        default={},
        examples=[{"Cn/*": "AVL"}],
        description="Term or pattern to the one source that it is taken from, in place of a blend.",
    )
    ice: OptionalFile = Field(
        default=None,
        examples=["ice.toml"],
        description="Differences of terms by ice, which act in records and cases with "
        "device.ice.setting.",
    )
    cases: MatchedFiles = Field(description="Patterns of Proof-of-Match cases.")
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
        description="Terms that the listings cannot give, zero at first, by a name such as "
        "CL/gear.",
    )
    models: dict[str, ThirdPartyModel] = Field(
        default={}, description="Models from elsewhere that are replayed as well, by name."
    )
    devices: dict[str, DeviceSection] = Field(
        default={},
        description="Training devices, by name: their recordings are judged as models are.",
    )
    fit: tuple[FitSection, ...] = Field(
        default=(),
        description="Local models: what is fitted to which manoeuvres; without any, the match "
        "proves the a-priori model.",
    )
    published: InputFiles = Field(
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
    stall: StallSection | None = Field(
        default=None,
        description="Identification of a stall; without it that of the aircraft file and listings.",
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
    def _require_positive(cls, cutoff: float | None) -> float | None:
        if cutoff is not None and not 0.0 < cutoff < math.inf:
            raise ValueError(
                "a low-pass needs a frequency of more than 0 Hz; leave the key out for none"
            )
        return cutoff

    @model_validator(mode="after")
    def _check_references(self, info: ValidationInfo) -> Project:
        """Collect the problems of the records, models and files that the sections name."""
        if isinstance(info.context, ProjectFolder):
            self._file = info.context.file
            info.context.problems += [
                *self._fit_problems(),
                *self._section_problems(),
                *self._name_problems(),
            ]
            self._check_files(info.context)
        return self

    def _fit_problems(self) -> list[str]:
        problems: list[str] = []
        for number, fit in enumerate(self.fit):
            problems += self._record_problems(f"fit.{number}", fit)
            problems += repeated_records({f"fit.{number}": (fit,)})
            for model in fit.models:
                problems += find_faults(f"fit.{number}.models", RegressionModel.parse, model)
        return problems

    def _section_problems(self) -> list[str]:
        problems: list[str] = []
        for section in (self.engine, self.gear, self.ground_effect, self.stall):
            if section is not None:
                problems += section.problems()
        for control, control_section in self.controls.sections.items():
            problems += control_section.problems(control)
        problems += repeated_records(self.submodels)
        for position, selections in self.submodels.items():
            for selection in selections:
                # Two selections of one section may name the same unknown record.
                for problem in self._record_problems(position, selection):
                    if problem not in problems:
                        problems.append(problem)
        return problems

    def _record_problems(self, position: str, selection: RecordSelection) -> list[str]:
        problems = []
        for record in selection.records:
            if record not in self.flights:
                problems.append(
                    f"{position}.records: {UnknownName(record, self.flights, 'record')}"
                )
        return problems

    def _source_problems(self) -> list[str]:
        problems: list[str] = []
        roles = self.listings.by_role
        if roles and "clean" not in roles:
            problems.append(
                f"listings.clean: missing, with listings of {', '.join(roles)}; give the listing "
                f"of the whole aeroplane without deflections"
            )
        if not roles and not self.prior:
            problems.append(
                "listings: no a-priori source; give listings.clean, a Digital DATCOM listing, or a "
                "table [[prior]] with outputs of another program"
            )
        for number, section in enumerate(self.prior):
            problems += section.problems(f"prior.{number}")
        if self.take and len(self.prior) + bool(roles) < 2:
            problems.append("take: chooses among several sources; give more [[prior]] tables")
        return problems

    def _name_problems(self) -> list[str]:
        problems = self._source_problems()
        if self.ice is not None and self.ice.is_file():
            problems += find_faults("ice", read_ice, self.ice)
        for source in self.errors:
            if source not in ERRORS:
                problems.append(f"errors: {UnknownName(source, ERRORS, 'source of error')}")
        for term, new_term in self.terms.items():
            problems += find_faults(f"terms.{term}", new_term.leaf)
        for name in self.models:
            if name in OWN_MODELS or name == "flight":
                problems.append(
                    f"models.{name}: the name is taken; call it otherwise than flight, "
                    f"{', '.join(OWN_MODELS)}"
                )
        for name in self.devices:
            if name in (*OWN_MODELS, *self.models, "flight"):
                problems.append(
                    f"devices.{name}: the name is taken; call it otherwise than flight, "
                    f"{', '.join((*OWN_MODELS, *self.models))}"
                )
        return problems

    def _check_files(self, folder: ProjectFolder) -> None:
        """Check the files of the engine and of the models from elsewhere."""
        for name, file in self._engine_files().items():
            path = folder.existing(file, f"engine.{name}")
            if name == "structure" and path.is_file():
                folder.problems += find_faults("engine.structure", read_structure, path)
        for name, model in self.models.items():
            folder.existing(model.fmu, f"models.{name}.fmu")
            if model.names:
                folder.existing(model.names, f"models.{name}.names")

    def _engine_files(self) -> dict[str, str]:
        """Return the files of the section ``[engine]`` as the section names them."""
        files = {}
        for name in ("points", "climbs", "structure"):
            file = getattr(self.engine, name, None)
            if file:
                files[name] = file
        return files

    @property
    def file(self) -> Path:
        """The project file."""
        return self._file

    @property
    def prior_model(self) -> str:
        """Name of the a-priori model: ``datcom``, or ``prior`` with sources of ``[[prior]]``."""
        return "prior" if self.prior else "datcom"

    @property
    def own_models(self) -> tuple[str, str, str]:
        """Names of the three models of a match, from the a-priori to the final one."""
        return self.prior_model, "corrected", "final"

    @property
    def submodels(self) -> dict[str, tuple[RecordSelection, ...]]:
        """Records and manoeuvres that identify the submodels, by the place in the project file."""
        return section_selections(
            self.engine,
            self.controls.sections,
            gear=self.gear,
            ground_effect=self.ground_effect,
            stall=self.stall,
        )

    @property
    def fmus(self) -> dict[str, Path]:
        """FMUs from elsewhere, by the name of the model."""
        return {name: self.file.parent / model.fmu for name, model in self.models.items()}

    @property
    def tables(self) -> dict[str, Path]:
        """Tables of names of the FMUs from elsewhere, for those that have a table."""
        models = self.models.items()
        return {name: self.file.parent / model.names for name, model in models if model.names}

    @property
    def points(self) -> dict[str, Path]:
        """Files for the engine: settled ``points``, ``climbs``, and the ``structure`` of its
        deck.
        """
        return {name: self.file.parent / file for name, file in self._engine_files().items()}

    def with_changes(self, **changes: Any) -> Project:
        """Return a copy with other values of some attributes. The values are not checked.

        Raises
        ------
        TypeError
            A name is not an attribute of a project file.
        """
        unknown = changes.keys() - type(self).model_fields.keys()
        if unknown:
            raise TypeError(
                f"{', '.join(sorted(unknown))}: not a key of a project file; the keys are "
                f"{', '.join(type(self).model_fields)}. Use the names of the keys."
            )
        return self.model_copy(update=changes)


def read_project(path: str | Path) -> Project:
    """Read a project file and check that all files that it names exist.

    Parameters
    ----------
    path : path
        ``aeromatch.toml``.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        With all unknown keys and wrong types. If there are none, with all missing files, unknown
        records and quantities, and faulty models.
    """
    path = Path(path)
    folder = ProjectFolder(path.resolve())
    project = validate_content(Project, read_toml(path), str(path), context=folder)
    if folder.problems:
        raise SchemaError(str(path), folder.problems)
    return project


def project_schema() -> dict[str, Any]:
    """Return the JSON schema of project files."""
    return file_schema(
        Project,
        "A project: one aircraft, its listings, its flights and its Proof-of-Match cases.",
    )
