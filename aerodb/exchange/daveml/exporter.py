"""A database as a DAVE-ML 2.0.2 file: variables, tables, functions, build-up equations, check
cases.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from datetime import date
from importlib.metadata import version

import numpy as np
import xarray as xr

from aerodb.exchange.daveml import export_checks as sample_states
from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.mathml import Apply, Expression, MathNumber, Name
from aerodb.exchange.daveml.document.units import code_of
from aerodb.exchange.daveml.export_checks import (
    SIZES,
    CheckShot,
    draw_check_cases,
    element_lines,
    exported_coefficients,
    number_lines,
    read_stored_cases,
    shot_lines,
    standard_name,
    text_element_lines,
)
from aerodb.exchange.daveml.vocabulary import REDUCED, VALUE, WRITER, pack_attributes, source_runs
from aerodb.store.schema import require_valid, terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.build_up import used_coefficients
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.support.atomic_write import write_text
from flightmech.terms import list_regressors, power_factor

_HEAD = """<?xml version="1.0" standalone="no"?>
<!DOCTYPE DAVEfunc PUBLIC "-//AIAA//DTD for Flight Dynamic Models - Functions 2.0//EN" "http://www.daveml.org/DTDs/2p0/DAVEfunc.dtd">"""
_NAMESPACE = "http://daveml.org/2010/DAVEML"
_MATH = "http://www.w3.org/1998/Math/MathML"
_LEAST_AIRSPEED = 0.1  # m/s; what is divided by must not be zero
_GEOMETRY = (*SIZES, "x_ref", "y_ref", "z_ref")
_AGREE = 1e-6
_TABLES = ("value", "K1", "K2")


def export_daveml(
    db: xr.DataTree, path: str | os.PathLike, aircraft: Aircraft | None = None, shots: int = 20
) -> None:
    """Write a database as a DAVE-ML 2.0.2 file (ANSI/AIAA S-119).

    Every term is a function (one more for each factor table) and a variable ``CL_flap``; the
    coefficients are sums of these.  Inputs are SI and radians under their S-119 names where they
    have one; reduced rates are computed from airspeed and rates.  Equal tables are written once.
    ``outside`` is the attribute ``extrapolate`` (``neither`` or ``both``), standard errors are the
    additive normal uncertainty of the tables with one sigma, the history is the modification
    record, and what the format has no element for stands in the descriptions, from where
    `import_daveml` takes it back.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        The file, written atomically.
    aircraft : Aircraft, optional
        Its control limits bound the check cases; its geometry must be the database's.
    shots : int
        Number of check cases, spread over the tables, half of them to 15 % beyond; always the same
        for the same database.  The cases in ``/checks`` whose expected values the database meets
        come on top.

    Raises
    ------
    SchemaError
        A database with faults, one of another aircraft, or a term with a power factor or one that
        depends on a coefficient, such as ``CL``.
    """
    require_valid(db)
    if shots < 1:
        raise ValueError(f"shots is {shots}; a file has at least one")
    _demand_tables(db)
    if aircraft is not None:
        _demand_same(db, aircraft)
    limits = aircraft.limits if aircraft is not None else {}
    writer = _Writer(db)
    cases = [*draw_check_cases(db, shots, limits), *read_stored_cases(db)]
    lines = [_HEAD, *element_lines("DAVEfunc", {"xmlns": _NAMESPACE}, writer.lines(cases))]
    write_text(path, "\n".join(lines) + "\n")


def _demand_tables(db: xr.DataTree) -> None:
    problems = []
    for name, leaf in terms(db).items():
        if power_factor(leaf) is not None:
            problems.append(
                f"{name}: the factor {power_factor(leaf)} is a formula, and the file takes tables; "
                "make it one first (aerodb.transform.with_height_table)"
            )
        for word in sorted(used_coefficients(leaf)):
            problems.append(
                f"{name}: {word} is an output of the file and no input; leave the term out "
                f"(aerodb.delete_terms)"
            )
    if problems:
        raise SchemaError("DAVE-ML file", problems)


def _demand_same(db: xr.DataTree, aircraft: Aircraft) -> None:
    problems = [
        f"{name} is {float(db.attrs[name]):.8g} in the database and "
        f"{getattr(aircraft, name):.8g} in the aircraft; they must agree"
        for name in SIZES
        if not np.isclose(float(db.attrs[name]), getattr(aircraft, name), rtol=_AGREE)
    ]
    if problems:
        raise SchemaError(f"database {db.attrs['title']!r} for {aircraft.name}", problems)


class _Writer:
    """One export: the shared breakpoints and tables by their contents, the names given so far."""

    def __init__(self, db: xr.DataTree):
        self.db = db
        self.leaves = terms(db)
        self.today = date.today().isoformat()
        self.breakpoints: dict[tuple, str] = {}
        self.tables: dict[tuple, str] = {}
        self.table_lines: list[str] = []
        self.breakpoint_lines: list[str] = []
        self.function_lines: list[str] = []
        self.term_lines: list[str] = []
        self.ids: set[str] = set()
        self.term_ids: dict[str, str] = {}

    def lines(self, cases: Iterable[CheckShot]) -> list[str]:
        head = self._header()
        given = [line for name in self._inputs() for line in self._input(name)]
        fixed = [line for name in _GEOMETRY for line in self._constant(name)]
        rates = [
            line
            for name in REDUCED
            if name in sample_states.required_variables(self.leaves.values())
            for line in self._reduced(name)
        ]
        for name, leaf in self.leaves.items():
            self.term_ids[name] = self._id(name.replace("/", "_"))
            self._term(name, leaf)
        sums = [line for name in exported_coefficients(self.db) for line in self._total(name)]
        checks = element_lines(
            "checkData",
            {},
            [line for case in cases for line in shot_lines(case, self.term_ids, self._inputs())],
        )
        return [
            *head, *given, *fixed, *rates, *self.term_lines, *sums,
            *self.breakpoint_lines, *self.table_lines, *self.function_lines, *checks,
        ]  # fmt: skip

    def _id(self, wanted: str) -> str:
        """Return an identifier not used so far."""
        found = (
            wanted
            if wanted not in self.ids
            else next(new for i in range(2, 10**6) if (new := f"{wanted}__{i}") not in self.ids)
        )
        self.ids.add(found)
        return found

    def _author(self) -> list[str]:
        return element_lines("author", {"name": WRITER, "org": "-"})

    def _header(self) -> list[str]:
        attributes = {str(key): item for key, item in self.db.attrs.items()}
        texts = {
            key: item
            for key, item in attributes.items()
            if key not in (*_GEOMETRY, "history", "force_axes")
        }
        documents = [item for item in str(attributes.get("references", "")).split("; ") if item]
        history = [line for line in str(attributes.get("history", "")).split("\n") if line]
        inside = [
            *self._author(),
            *element_lines("creationDate", {"date": self.today}),
            *element_lines("fileVersion", {}, f"{WRITER} {version('aeromatch')}"),
            *text_element_lines("description", pack_attributes(texts)),
            *(
                line
                for i, title in enumerate(documents, 1)
                for line in self._reference(f"REF{i}", title)
            ),
            *(
                line
                for i, entry in enumerate(history)
                for line in self._modification(_letters(i), entry)
            ),
        ]
        return element_lines("fileHeader", {"name": str(attributes["title"])}, inside)

    def _provenance(self) -> list[str]:
        """Return who made a function and when, which the standard demands; in full, since not every
        reader follows a reference.
        """
        return element_lines(
            "provenance",
            {},
            [*self._author(), *element_lines("creationDate", {"date": self.today})],
        )

    def _reference(self, key: str, title: str) -> list[str]:
        dates = re.findall(r"(?:19|20)\d\d(?:-\d\d(?:-\d\d)?)?", title)
        return element_lines(
            "reference",
            {"refID": key, "author": "-", "title": title, "date": dates[-1] if dates else "-"},
        )

    def _modification(self, key: str, entry: str) -> list[str]:
        found = re.search(r"\d{4}-\d\d-\d\d", entry)
        inside = [*self._author(), *text_element_lines("description", entry)]
        return element_lines(
            "modificationRecord", {"modID": key, "date": found[0] if found else self.today}, inside
        )

    def _inputs(self) -> list[str]:
        """Return the variables a user of the file must give, in SI."""
        needed = sample_states.required_variables(self.leaves.values())
        rates = [REDUCED[name][0] for name in needed if name in REDUCED]
        plain = [name for name in needed if name not in REDUCED]
        return sorted({*plain, *rates, *(["V"] if rates else [])})

    def _input(self, name: str) -> list[str]:
        self.ids.add(name)
        low = {"minValue": repr(_LEAST_AIRSPEED)} if name == "V" else {}
        return self._variable(name, name, low, ["<isInput/>"])

    def _constant(self, name: str) -> list[str]:
        self.ids.add(name)
        value = {"initialValue": repr(float(self.db.attrs[name]))}
        if name in SIZES:
            return self._variable(name, name, value, ["<isOutput/>"])
        properties = {"name": name, "varID": name, "units": "m", **value}
        return element_lines(
            "variableDef",
            properties,
            element_lines(
                "description", {}, f"moment reference point from the drawing datum, body {name[0]}"
            ),
        )

    def _reduced(self, name: str) -> list[str]:
        rate, length = REDUCED[name]
        self.ids.add(name)
        made = Apply(
            "divide",
            (
                Apply("times", (Name(rate), Name(length))),
                Apply("times", (MathNumber(2.0), Name("V"))),
            ),
        )
        return self._variable(name, name, {}, _calculation(made))

    def _variable(
        self, varID: str, quantity: str, more: Mapping[str, str], inside: list[str]
    ) -> list[str]:
        row, name = lookup(quantity), standard_name(quantity)
        properties = {
            "name": name or quantity,
            "varID": varID,
            "units": code_of(row.units),
            "sign": row.sign,
            **more,
        }
        flags = ["<isStdAIAA/>"] if name else []
        return element_lines(
            "variableDef",
            properties,
            [*element_lines("description", {}, row.long_name), *inside, *flags],
        )

    def _total(self, coefficient: str) -> list[str]:
        parts = [
            Name(self.term_ids[name]) for name in self.leaves if name.split("/")[0] == coefficient
        ]
        forces = (
            ("CL", "CD", "CY")
            if self.db.attrs["force_axes"] == "wind"
            else ("CL", "CD", "CX", "CZ")
        )
        axes = self.db.attrs["force_axes"] if coefficient in forces else "body"
        more = {
            "axisSystem": "" if coefficient.startswith("Ch_") else f"{axes} axes",
            "initialValue": "" if parts else "0.0",
        }
        inside = _calculation(Apply("plus", tuple(parts))) if parts else []
        return self._variable(self._id(coefficient), coefficient, more, [*inside, "<isOutput/>"])

    def _term(self, name: str, leaf: xr.Dataset) -> None:
        """Write a term: its tables as functions, its product as a variable."""
        factors: list[Expression] = []
        for key in (key for key in _TABLES if key in leaf):
            factors.append(Name(self._table_variable(name, key, leaf)))
        factors += [Name(word) for word in list_regressors(leaf)]
        product = _calculation(Apply("times", tuple(factors)))
        texts = {
            str(key): item
            for key, item in leaf.attrs.items()
            if key not in ("regressors", "outside")
        }
        if "source" in leaf:
            texts["source"] = source_runs(leaf["source"].values)
        properties = {"name": name, "varID": self.term_ids[name], "units": "nd"}
        self.term_lines += element_lines(
            "variableDef",
            properties,
            [*text_element_lines("description", pack_attributes(texts)), *product],
        )

    def _table_variable(self, name: str, key: str, leaf: xr.Dataset) -> str:
        """Write a table of a term and return the variable that holds what it gives."""
        label = f"{name}{VALUE}" if key == "value" else f"{name} {key}"
        varID = self._id(f"{self.term_ids[name]}__{key}")
        table = leaf[key]
        stderr = leaf["stderr"] if key == "value" and "stderr" in leaf else None
        properties = {"name": label, "varID": varID, "units": "nd"}
        if table.ndim == 0:
            spread = [] if stderr is None else _uncertainty([repr(float(stderr))])
            self.term_lines += element_lines(
                "variableDef", {**properties, "initialValue": repr(float(table))}, spread
            )
            return varID
        self.term_lines += element_lines("variableDef", properties)
        self._function(
            label,
            varID,
            table,
            stderr,
            "both" if leaf.attrs.get("outside", "hold") == "linear" else "neither",
        )
        return varID

    def _function(
        self,
        name: str,
        varID: str,
        table: xr.DataArray,
        stderr: xr.DataArray | None,
        extrapolate: str,
    ) -> None:
        rules = {"extrapolate": extrapolate, "interpolate": "linear"}
        references = [
            line
            for axis in table.dims
            for line in element_lines("independentVarRef", {"varID": str(axis), **rules})
        ]
        inside = [
            *self._provenance(),
            *references,
            *element_lines("dependentVarRef", {"varID": varID}),
            *element_lines(
                "functionDefn",
                {"name": f"{varID}_fn"},
                element_lines("griddedTableRef", {"gtID": self._table(name, table, stderr)}),
            ),
        ]
        self.function_lines += element_lines("function", {"name": name}, inside)

    def _table(self, name: str, table: xr.DataArray, stderr: xr.DataArray | None) -> str:
        """Return the gtID of a table, written unless an equal one was."""
        points = [self._points(str(axis), table[axis].values) for axis in table.dims]
        values = table.values.astype(float)
        spread = b"" if stderr is None else stderr.values.astype(float).tobytes()
        key = (*points, values.tobytes(), spread)
        if key not in self.tables:
            self.tables[key] = self._id(f"T{len(self.tables) + 1}")
            uncertainty = (
                []
                if stderr is None
                else _uncertainty(
                    element_lines("dataTable", {}, number_lines(stderr.values.astype(float)))
                )
            )
            inside = [
                *element_lines(
                    "breakpointRefs",
                    {},
                    [line for point in points for line in element_lines("bpRef", {"bpID": point})],
                ),
                *uncertainty,
                *element_lines("dataTable", {}, number_lines(values)),
            ]
            self.table_lines += element_lines(
                "griddedTableDef", {"name": name, "gtID": self.tables[key], "units": "nd"}, inside
            )
        return self.tables[key]

    def _points(self, axis: str, points: np.ndarray) -> str:
        points = points.astype(float)
        key = (axis, points.tobytes())
        if key not in self.breakpoints:
            self.breakpoints[key] = self._id(
                f"B{len(self.breakpoints) + 1}_{axis.replace('.', '_')}"
            )
            row = lookup(axis)
            inside = [
                *element_lines("description", {}, row.long_name),
                *element_lines("bpVals", {}, number_lines(points)),
            ]
            properties = {"name": axis, "bpID": self.breakpoints[key], "units": code_of(row.units)}
            self.breakpoint_lines += element_lines("breakpointDef", properties, inside)
        return self.breakpoints[key]


def _calculation(expression: Expression) -> list[str]:
    """Return a calculation element."""
    return element_lines(
        "calculation",
        {},
        element_lines("math", {"xmlns": _MATH}, mathml.write_mathml(expression, "")),
    )


def _uncertainty(bounds: list[str]) -> list[str]:
    """Return standard errors: an additive normal uncertainty of one sigma."""
    return element_lines(
        "uncertainty",
        {"effect": "additive"},
        element_lines("normalPDF", {"numSigmas": "1"}, element_lines("bounds", {}, bounds)),
    )


def _letters(index: int) -> str:
    """Return A, B, ... Z, AA, AB ... as the modification record counts."""
    found = ""
    index += 1
    while index:
        index, rest = divmod(index - 1, 26)
        found = chr(ord("A") + rest) + found
    return found
