"""Section of a project file that names a further a-priori source: ``[[prior]]``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from aerodb.estimators.coefficient_set import EstimateReference
from aerodb.estimators.column_map import read_column_map
from aeromatch.project.files import OptionalFile, PathPatterns
from aeromatch.project.sections import find_faults
from flightmech.quantities import parse_quantity
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits

_NETCDF = ".nc"
_REFERENCE = ("S", "cbar", "b", "x_ref")


class PriorSection(Strict):
    """``[[prior]]``: outputs of another program for the aeroplane, or an a-priori database, that is
    blended with the database of the listings.
    """

    files: PathPatterns = Field(
        description="Outputs of one program (AVL, VSPAERO ...), text tables with columns, or one "
        "database (.nc); a pattern, or several.",
        examples=["avl/*.st"],
    )
    length_unit: str | None = Field(
        default=None, examples=["ft"], description="Unit of length of files that do not state it."
    )
    controls: dict[str, str] = Field(
        default={},
        examples=[{"rudder": "-delta_r"}],
        description="Control of the files to that of the aeroplane with its sign; an empty text "
        "leaves it out.",
    )
    columns: OptionalFile = Field(
        default=None, examples=["tunnel.toml"], description="Column map of text tables."
    )
    S: Annotated[float, InUnits("m2")] | None = Field(
        default=None,
        examples=["174 ft2"],
        description="Wing area of files that do not state it; with cbar, b and x_ref.",
    )
    cbar: Annotated[float, InUnits("m")] | None = Field(
        default=None, examples=["4.9 ft"], description="Mean chord of such files."
    )
    b: Annotated[float, InUnits("m")] | None = Field(
        default=None, examples=["35.8 ft"], description="Span of such files."
    )
    x_ref: Annotated[float, InUnits("m")] | None = Field(
        default=None,
        examples=["7.6 ft"],
        description="Moment centre of such files, aft of the origin of the drawing.",
    )
    mach: float | None = Field(
        default=None, examples=[0.2], description="Mach number of files that do not state it."
    )
    CD0: float | None = Field(
        default=None,
        examples=[0.027],
        description="Friction drag added to that of an inviscid program.",
    )
    method: str = Field(
        default="",
        examples=["low-speed wind tunnel"],
        description="Method, for sources with common errors; without it that of the program.",
    )
    move_reference: bool = Field(
        default=False,
        description="Whether moments are moved by more than 0.1 chord to the reference of the "
        "aircraft file.",
    )

    @property
    def is_database(self) -> bool:
        """Whether the source is a finished database."""
        return any(file.suffix == _NETCDF for file in self.files)

    @property
    def all_files(self) -> list[Path]:
        """All files of the source."""
        return [*self.files, *filter(None, [self.columns])]

    def options(self) -> dict[str, Any]:
        """Return the keywords of `aerodb.from_estimate`."""
        unit = self.length_unit
        return {
            "length_unit": None if unit is None else parse_quantity(f"1 {unit}", "m"),
            "controls": self.controls,
            "columns": None if self.columns is None else read_column_map(self.columns),
            "reference": self._reference(),
            "mach": self.mach,
            "CD0": self.CD0,
            "move_reference": self.move_reference,
        }

    def settings(self) -> Mapping[str, Any]:
        """Return everything but the files, for the hash of a stage."""
        return self.model_dump(exclude={"files", "columns"})

    def problems(self, position: str) -> Iterator[str]:
        """Yield what is wrong with the keys."""
        if self.is_database and len(self.files) > 1:
            yield f"{position}.files: {len(self.files)} files with a database; give one database"
        if self.is_database and self._given_options():
            yield (
                f"{position}: {', '.join(self._given_options())} with a database, which states it; "
                f"leave it out"
            )
        missing = [name for name in _REFERENCE if getattr(self, name) is None]
        if 0 < len(missing) < len(_REFERENCE):
            yield f"{position}: {', '.join(missing)} missing; {', '.join(_REFERENCE)} go together"
        if self.length_unit is not None:
            yield from find_faults(f"{position}.length_unit", self._check_unit)
        if self.columns is not None and self.columns.is_file():
            yield from find_faults(f"{position}.columns", read_column_map, self.columns)

    def _given_options(self) -> list[str]:
        names = ("length_unit", "controls", "columns", *_REFERENCE, "mach", "CD0")
        return [name for name in names if getattr(self, name)]

    def _check_unit(self) -> None:
        parse_quantity(f"1 {self.length_unit}", "m")

    def _reference(self) -> EstimateReference | None:
        if self.S is None or self.cbar is None or self.b is None or self.x_ref is None:
            return None
        return EstimateReference(self.S, self.cbar, self.b, self.x_ref)
