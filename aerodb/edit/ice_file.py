"""Differences of terms by ice: a TOML or CSV file of factors and offsets with standard errors.

    title = "artificial tail ice, flap 0"
    reference = "NASA TM, 1993"
    valid = "DHC-6, flap 0, thrust coefficient 0 to 0.14"

    [terms."Cm/elevator"]
    factor = 0.88
    factor_stderr = 0.05

    [terms."CL/basic"]
    axes = { alpha = ["0 deg", "4 deg", "8 deg"] }
    offset = [-0.088, -0.102, -0.113]
    offset_stderr = 0.02

With the clean table P, the iced one is  factor P + offset  (Deiler's icing model [Deiler2021]_).
With ``about`` the factor acts on the change from that angle of attack, for a published slope:
factor (P - P(about)) + P(about).

A CSV file has a row per node of an offset, with the columns ``term``, ``factor``,
``factor_stderr``, ``offset``, ``offset_stderr``, and one for each axis, such as ``alpha [deg]``.
Title, reference and validity are lines before the heading, ``# title: ...``.

References
----------
.. [Deiler2021] C. Deiler, Flight characteristics with different supercooled large droplet ice
   configurations, The Aeronautical Journal, 2021 (nomenclature: k_P, d_P).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from io import StringIO
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from flightmech.errors import ParseError, SchemaError, UnitError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.input_files import demand_regular
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits

_NUMBERS = ("factor", "factor_stderr", "offset", "offset_stderr")
_LARGEST = {"factor": 10.0, "factor_stderr": 1.0}
_LINE = re.compile(r"#\s*(\w+)\s*:\s*(.*)")
_AXIS = re.compile(r"(\w+)\s*(?:\[(.+)\])?$")
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class IceDifference(Strict):
    """Difference of one term by ice: iced table = factor x clean table + offset."""

    factor: NotNegative | None = Field(
        default=None, description="Factor on the clean table, 0 to 10 (0.88, not 88 or -12 %)."
    )
    factor_stderr: NotNegative | None = Field(
        default=None, description="Its standard error; required with a factor."
    )
    about: Annotated[float, InUnits("rad")] | None = Field(
        default=None,
        description="Angle of attack from which the factor counts the change of the table.",
    )
    offset: float | tuple[float, ...] | None = Field(
        default=None, description="Offset in the unit of the table, or one for each node of axes."
    )
    offset_stderr: NotNegative | tuple[NotNegative, ...] | None = Field(
        default=None, description="Its standard error; required with an offset."
    )
    axes: dict[str, tuple[float | str, ...]] = Field(
        default={}, description="One axis of the offset with its breakpoints."
    )

    @field_validator("factor", "factor_stderr")
    @classmethod
    def _check_share(cls, share: float | None, info: ValidationInfo) -> float | None:
        """Raise for a number in per cent."""
        largest = _LARGEST[str(info.field_name)]
        if share is not None and share > largest:
            raise ValueError(
                f"{share:g} is {share:g} times the clean table; at most {largest:g} is allowed: "
                f"write {share / 100.0:g} for {share:g} %"
            )
        return share

    @model_validator(mode="after")
    def _check_numbers(self) -> IceDifference:
        if self.factor is None and self.offset is None:
            raise ValueError("neither factor nor offset; give one of them")
        for name in ("factor", "offset"):
            has_stderr = getattr(self, f"{name}_stderr") is not None
            if has_stderr != (getattr(self, name) is not None):
                raise ValueError(f"{name} and {name}_stderr go together; no default is assumed")
        if self.about is not None and self.factor is None:
            raise ValueError("about goes with a factor")
        self._check_sizes()
        return self

    def _check_sizes(self) -> None:
        """Raise unless an offset is one number, or has a number for each node of its axis."""
        sizes = [len(points) for points in self.axes.values()]
        if len(sizes) > 1:
            raise ValueError("one axis at most")
        size = sizes[0] if sizes else None
        for name in ("offset", "offset_stderr"):
            numbers = getattr(self, name)
            if numbers is not None and np.ndim(numbers) and np.size(numbers) != size:
                raise ValueError(f"{name} has {np.size(numbers)} numbers for {size or 'no'} nodes")
        if sizes and self.offset is None:
            raise ValueError("axes go with an offset")

    def breakpoints(self) -> dict[str, np.ndarray]:
        """Return the breakpoints of the offset by axis. [SI]

        Raises
        ------
        UnknownName, UnitError
            An axis or a unit that does not exist.
        """
        points = {}
        for name, texts in self.axes.items():
            units = lookup(name).units
            points[name] = np.array([parse_quantity(text, units) for text in texts])
        return points

    def filled_offset(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the offsets and their standard errors in the shape of the axes."""
        shape = tuple(len(points) for points in self.axes.values())
        offset = np.broadcast_to(np.asarray(self.offset or 0.0, float), shape)
        return offset, np.broadcast_to(np.asarray(self.offset_stderr or 0.0, float), shape)


class IceFile(Strict):
    """Ice of one kind: where its numbers come from, and the differences by term."""

    title: str = Field(description="What ice.", examples=["tail ice, flap 0"])
    reference: str = Field(description="Document of the numbers.", examples=["NASA TM, 1993"])
    valid: str = Field(
        description="Conditions for which the numbers hold.", examples=["flap 0, below 12 deg"]
    )
    terms: Annotated[dict[str, IceDifference], Field(min_length=1)] = Field(
        description="Differences by term, such as Cm/elevator."
    )


def read_ice(path: str | Path) -> IceFile:
    """Return the differences in a TOML or CSV file.

    Raises
    ------
    ParseError
        The file is not TOML or CSV, or a number is not one.
    SchemaError
        With all wrong keys and values.
    """
    file = Path(path)
    demand_regular(file, "differences by ice (.toml or .csv)")
    content: Mapping[str, Any]
    content = _read_csv(file) if file.suffix.lower() == ".csv" else read_toml(file)
    ice = validate_content(IceFile, dict(content), str(file))
    problems = []
    for name, difference in ice.terms.items():
        try:
            difference.breakpoints()
        except (UnitError, SchemaError) as error:
            problems.append(f"terms.{name}.axes: {error}")
    if problems:
        raise SchemaError(str(file), problems)
    return ice


def _read_csv(file: Path) -> dict[str, Any]:
    """Return the content of a CSV file in the form of a TOML file."""
    lines = file.read_text(encoding="utf-8-sig").splitlines()
    content: dict[str, Any] = {}
    head = list(takewhile(lambda line: line.startswith("#"), lines))
    for match in filter(None, map(_LINE.match, head)):
        content[match[1]] = match[2].strip()
    start = len(head)
    reader = csv.DictReader(StringIO("\n".join(lines[start:])))
    columns = [str(name).strip() for name in reader.fieldnames or []]
    if "term" not in columns:
        raise ParseError(
            str(file),
            start + 1,
            repr(",".join(columns)),
            f"a heading with term, {', '.join(_NUMBERS)}",
        )
    terms: dict[str, dict[str, Any]] = {}
    for number, row in enumerate(reader, start + 2):
        if None in row:
            count = len(columns) + len(row[None])
            expected = f"{len(columns)} cells; a decimal comma needs quotes"
            raise ParseError(str(file), number, f"{count} cells", expected)
        cells = {str(k).strip(): (v or "").strip() for k, v in row.items()}
        _add_row(terms.setdefault(cells.pop("term"), {}), cells, file, number)
    for entry in terms.values():
        _make_scalar(entry)
    return {**content, "terms": terms}


def _add_row(entry: dict[str, Any], cells: Mapping[str, str], file: Path, number: int) -> None:
    """Add the numbers of one row to those of its term."""
    for column, cell in cells.items():
        if not cell:
            continue
        if column == "about":
            _set_once(entry, column, cell, file, number)
            continue
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ParseError(str(file), number, f"{column} {cell!r}", "a number, or an empty cell")
        if column in ("factor", "factor_stderr"):
            _set_once(entry, column, value, file, number)
        elif column in _NUMBERS:
            entry.setdefault(column, []).append(value)
        else:
            match = _AXIS.match(column)
            if match is None:
                raise ParseError(str(file), number, column, "a column such as 'alpha [deg]'")
            if not match[2]:
                raise ParseError(
                    str(file),
                    number,
                    f"column {column!r} without a unit",
                    f"'{match[1]} [deg]' (or [rad], [1])",
                )
            text = f"{cell} {match[2]}"
            entry.setdefault("axes", {}).setdefault(match[1], []).append(text)


def _set_once(entry: dict[str, Any], key: str, item: Any, file: Path, number: int) -> None:
    """Set a number that a term has once, in one row or equal in all of its rows."""
    if entry.setdefault(key, item) != item:
        raise ParseError(str(file), number, f"{key} {item}", f"{entry[key]}, as in the row before")


def _make_scalar(entry: dict[str, Any]) -> None:
    """Make single numbers of the offsets of a term without an axis."""
    for name in ("offset", "offset_stderr"):
        if "axes" not in entry and len(entry.get(name, ())) == 1:
            (entry[name],) = entry[name]
