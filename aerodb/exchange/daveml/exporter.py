"""Export of a database as a DAVE-ML 2.0.2 file with build-up equations and check cases."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from datetime import date
from importlib.metadata import version
from typing import Any

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
from aerodb.exchange.daveml.vocabulary import VALUE, WRITER, pack_attributes, source_runs
from aerodb.store.schema import require_valid, terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.build_up import used_coefficients
from flightmech.errors import SchemaError
from flightmech.names import REDUCED_RATES, SEPARATION, lookup
from flightmech.support.atomic_write import write_text
from flightmech.terms import list_model_variables, list_regressors, power_factor

_HEAD = """<?xml version="1.0" standalone="no"?>
<!DOCTYPE DAVEfunc PUBLIC "-//AIAA//DTD for Flight Dynamic Models - Functions 2.0//EN" \
"http://www.daveml.org/DTDs/2p0/DAVEfunc.dtd">"""
_NAMESPACE = "http://daveml.org/2010/DAVEML"
_MATH = "http://www.w3.org/1998/Math/MathML"
_LEAST_AIRSPEED = 0.1  # m/s; a divisor of the reduced rates must not be zero
_GEOMETRY = (*SIZES, "x_ref", "y_ref", "z_ref")
_AGREE = 1e-6  # relative difference of equal reference lengths
_TABLES = ("value", "K1", "K2")
_ALPHABET = 26


def export_daveml(
    db: xr.DataTree, path: str | os.PathLike[str], aircraft: Aircraft | None = None, shots: int = 20
) -> None:
    """Write a database as a DAVE-ML 2.0.2 file (ANSI/AIAA S-119).

    Every term is a function, with one more for each factor table, and a variable ``CL_flap``.  The
    coefficients are sums of these variables.  Inputs are in SI and radians under their S-119 names
    if they have one.  Reduced rates are computed from airspeed and rates.  Equal tables are written
    once.  ``outside`` is the attribute ``extrapolate`` (``neither`` or ``both``).  Standard errors
    are the additive normal uncertainty of the tables with one sigma.  The history is the
    modification record.  Attributes without an element in the format are in the descriptions, and
    `import_daveml` reads them from there.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        The file, written atomically.
    aircraft : Aircraft, optional
        Its control limits bound the check cases.  Its geometry must equal that of the database.
    shots : int
        Number of check cases, spread over the tables, half of them to 15 % beyond.  They are the
        same for the same database.  The cases in ``/checks`` whose expected values the database
        meets are added.

    Raises
    ------
    SchemaError
        A database with faults, one of another aircraft, or a term with a power factor or one that
        depends on a coefficient, such as ``CL``.

    Warns
    -----
    AeromatchWarning
        Cases in ``/checks`` that are left out, with the reason.
    """
    require_valid(db)
    if shots < 1:
        raise ValueError(f"shots is {shots}; a file has at least one")
    _demand_tables(db)
    limits: Mapping[str, tuple[float, float]] = {}
    if aircraft is not None:
        _demand_same_sizes(db, aircraft)
        limits = aircraft.limits
    writer = _Writer(db)
    cases = [*draw_check_cases(db, shots, limits), *read_stored_cases(db)]
    lines = [_HEAD, *element_lines("DAVEfunc", {"xmlns": _NAMESPACE}, writer.lines(cases))]
    write_text(path, "\n".join(lines) + "\n")


def _demand_tables(db: xr.DataTree) -> None:
    """Raise if a term is not a product of tables and inputs."""
    problems = []
    for name, leaf in terms(db).items():
        if power_factor(leaf) is not None:
            problems.append(
                f"{name}: the factor {power_factor(leaf)} is a formula, and the file takes tables; "
                "make it one first (aerodb.transform.with_height_table)"
            )
        for variable in sorted(list_model_variables(leaf) & set(SEPARATION)):
            problems.append(
                f"{name}: {variable} is a state of the flow, and the file holds functions; leave "
                f"the term out (aerodb.delete_terms), or write an FMU, which has it"
            )
        for coefficient in sorted(used_coefficients(leaf)):
            problems.append(
                f"{name}: {coefficient} is an output of the file and no input; leave the term out "
                f"(aerodb.delete_terms)"
            )
    if problems:
        raise SchemaError("DAVE-ML file", problems)


def _demand_same_sizes(db: xr.DataTree, aircraft: Aircraft) -> None:
    problems = []
    for name in SIZES:
        database_size, aircraft_size = float(db.attrs[name]), getattr(aircraft, name)
        if not np.isclose(database_size, aircraft_size, rtol=_AGREE):
            problems.append(
                f"{name} is {database_size:.8g} in the database and {aircraft_size:.8g} in the "
                f"aircraft; they must agree"
            )
    if problems:
        raise SchemaError(f"database {db.attrs['title']!r} for {aircraft.name}", problems)


class _Writer:
    """One export: shared breakpoints and tables by their contents, and the identifiers in use."""

    def __init__(self, db: xr.DataTree):
        self.db = db
        self.leaves = terms(db)
        self.today = date.today().isoformat()
        self.breakpoints: dict[tuple[Any, ...], str] = {}
        self.tables: dict[tuple[Any, ...], str] = {}
        self.table_lines: list[str] = []
        self.breakpoint_lines: list[str] = []
        self.function_lines: list[str] = []
        self.term_lines: list[str] = []
        self.ids: set[str] = set()
        self.term_ids: dict[str, str] = {}

    def lines(self, cases: Iterable[CheckShot]) -> list[str]:
        """Return the lines of all elements in the order of the DTD."""
        # The order of the calls determines the identifiers: a repeated one gets a number.
        lines = self._header_lines()
        for name in self._inputs():
            lines += self._input_lines(name)
        for name in _GEOMETRY:
            lines += self._constant_lines(name)
        required = sample_states.required_variables(self.leaves.values())
        for name in REDUCED_RATES:
            if name in required:
                lines += self._reduced_rate_lines(name)
        for name, leaf in self.leaves.items():
            self.term_ids[name] = self._new_id(name.replace("/", "_"))
            self._write_term(name, leaf)
        lines += self.term_lines
        for name in exported_coefficients(self.db):
            lines += self._total_lines(name)
        lines += [*self.breakpoint_lines, *self.table_lines, *self.function_lines]
        check_lines: list[str] = []
        for case in cases:
            check_lines += shot_lines(case, self.term_ids, self._inputs())
        return lines + element_lines("checkData", {}, check_lines)

    def _new_id(self, preferred: str) -> str:
        """Return an unused identifier, with a number if the preferred one is in use."""
        # The second use of an identifier gets the number 2.
        identifier, number = preferred, 2
        while identifier in self.ids:
            identifier = f"{preferred}__{number}"
            number += 1
        self.ids.add(identifier)
        return identifier

    def _author_lines(self) -> list[str]:
        return element_lines("author", {"name": WRITER, "org": "-"})

    def _header_lines(self) -> list[str]:
        attributes = {str(key): value for key, value in self.db.attrs.items()}
        # Attributes without an element of their own are in the description.
        texts = {}
        for key, value in attributes.items():
            if key not in (*_GEOMETRY, "history", "force_axes"):
                texts[key] = value
        inside = [
            *self._author_lines(),
            *element_lines("creationDate", {"date": self.today}),
            *element_lines("fileVersion", {}, f"{WRITER} {version('aeromatch')}"),
            *text_element_lines("description", pack_attributes(texts)),
        ]
        documents = filter(None, str(attributes.get("references", "")).split("; "))
        for number, title in enumerate(documents, 1):
            inside += self._reference_lines(f"REF{number}", title)
        history = filter(None, str(attributes.get("history", "")).split("\n"))
        for index, entry in enumerate(history):
            inside += self._modification_lines(_letter_number(index), entry)
        return element_lines("fileHeader", {"name": str(attributes["title"])}, inside)

    def _provenance_lines(self) -> list[str]:
        """Return author and date of a function, in full: some readers follow no reference."""
        created = element_lines("creationDate", {"date": self.today})
        return element_lines("provenance", {}, [*self._author_lines(), *created])

    def _reference_lines(self, key: str, title: str) -> list[str]:
        # The last date in the title, or only its year, is the date of the document.
        dates = re.findall(r"(?:19|20)\d\d(?:-\d\d(?:-\d\d)?)?", title)
        document_date = dates[-1] if dates else "-"
        attributes = {"refID": key, "author": "-", "title": title, "date": document_date}
        return element_lines("reference", attributes)

    def _modification_lines(self, key: str, entry: str) -> list[str]:
        match = re.search(r"\d{4}-\d\d-\d\d", entry)
        attributes = {"modID": key, "date": match[0] if match else self.today}
        inside = [*self._author_lines(), *text_element_lines("description", entry)]
        return element_lines("modificationRecord", attributes, inside)

    def _inputs(self) -> list[str]:
        """Return the input variables of the file, by name. [SI]"""
        names = set()
        for name in sample_states.required_variables(self.leaves.values()):
            if name in REDUCED_RATES:
                # A reduced rate is computed from its rate and the airspeed.
                names |= {REDUCED_RATES[name][0], "V"}
            else:
                names.add(name)
        return sorted(names)

    def _input_lines(self, name: str) -> list[str]:
        # An airspeed of zero would make the reduced rates infinite.
        self.ids.add(name)
        limits = {"minValue": repr(_LEAST_AIRSPEED)} if name == "V" else {}
        return self._variable_lines(name, name, limits, inside=["<isInput/>"])

    def _constant_lines(self, name: str) -> list[str]:
        self.ids.add(name)
        value = {"initialValue": repr(float(self.db.attrs[name]))}
        if name in SIZES:
            return self._variable_lines(name, name, value, inside=["<isOutput/>"])
        attributes = {"name": name, "varID": name, "units": "m", **value}
        text = f"moment reference point from the drawing datum, body {name[0]}"
        return element_lines("variableDef", attributes, element_lines("description", {}, text))

    def _reduced_rate_lines(self, name: str) -> list[str]:
        rate, length = REDUCED_RATES[name]
        self.ids.add(name)
        # reduced rate = rate * length / (2 V)
        numerator = Apply("times", (Name(rate), Name(length)))
        denominator = Apply("times", (MathNumber(2.0), Name("V")))
        calculation = _calculation_lines(Apply("divide", (numerator, denominator)))
        return self._variable_lines(name, name, {}, inside=calculation)

    def _variable_lines(
        self, varID: str, quantity: str, attributes: Mapping[str, str], inside: list[str]
    ) -> list[str]:
        """Return the definition of a variable that is a quantity of the vocabulary."""
        row, name = lookup(quantity), standard_name(quantity)
        properties = {
            "name": name or quantity,
            "varID": varID,
            "units": code_of(row.units),
            "sign": row.sign,
            **attributes,
        }
        children = [*element_lines("description", {}, row.long_name), *inside]
        if name:
            children.append("<isStdAIAA/>")
        return element_lines("variableDef", properties, children)

    def _total_lines(self, coefficient: str) -> list[str]:
        """Return a coefficient as the sum of its terms."""
        summands = []
        for name in self.leaves:
            if name.split("/")[0] == coefficient:
                summands.append(Name(self.term_ids[name]))
        # Only these coefficients are in the force axes, all others are in body axes.
        force_axes = self.db.attrs["force_axes"]
        force_coefficients = {"CL", "CD", "CX", "CZ"}
        if force_axes == "wind":
            force_coefficients = {"CL", "CD", "CY"}
        axes = force_axes if coefficient in force_coefficients else "body"
        attributes = {
            "axisSystem": "" if coefficient.startswith("Ch_") else f"{axes} axes",
            "initialValue": "" if summands else "0.0",
        }
        inside = []
        if summands:
            inside += _calculation_lines(Apply("plus", tuple(summands)))
        inside.append("<isOutput/>")
        return self._variable_lines(
            self._new_id(coefficient), coefficient, attributes, inside=inside
        )

    def _write_term(self, name: str, leaf: xr.Dataset) -> None:
        """Write a term: its tables as functions, its product as a variable."""
        factors: list[Expression] = []
        for key in _TABLES:
            if key in leaf:
                factors.append(Name(self._write_table_variable(name, key, leaf)))
        factors += [Name(regressor) for regressor in list_regressors(leaf)]
        # term = value K1 K2 regressor1 regressor2
        product = _calculation_lines(Apply("times", tuple(factors)))
        texts = {}
        for attribute, value in leaf.attrs.items():
            if attribute not in ("regressors", "outside"):
                texts[str(attribute)] = value
        if "source" in leaf:
            texts["source"] = source_runs(leaf["source"].values)
        properties = {"name": name, "varID": self.term_ids[name], "units": "nd"}
        inside = [*text_element_lines("description", pack_attributes(texts)), *product]
        self.term_lines += element_lines("variableDef", properties, inside)

    def _write_table_variable(self, name: str, key: str, leaf: xr.Dataset) -> str:
        """Write a table of a term and return the varID of its result."""
        label = f"{name}{VALUE}" if key == "value" else f"{name} {key}"
        varID = self._new_id(f"{self.term_ids[name]}__{key}")
        table = leaf[key]
        stderr = leaf["stderr"] if key == "value" and "stderr" in leaf else None
        properties = {"name": label, "varID": varID, "units": "nd"}
        if table.ndim == 0:
            # A table without axes is a constant.
            inside = [] if stderr is None else _uncertainty_lines([repr(float(stderr))])
            properties["initialValue"] = repr(float(table))
            self.term_lines += element_lines("variableDef", properties, inside)
            return varID
        self.term_lines += element_lines("variableDef", properties)
        is_linear = leaf.attrs.get("outside", "hold") == "linear"
        rules = {"extrapolate": "both" if is_linear else "neither", "interpolate": "linear"}
        self._write_function(label, varID, table, stderr=stderr, rules=rules)
        return varID

    def _write_function(
        self,
        name: str,
        varID: str,
        table: xr.DataArray,
        stderr: xr.DataArray | None,
        rules: Mapping[str, str],
    ) -> None:
        # S-119 demands a provenance for each function.
        inside = self._provenance_lines()
        for axis in table.dims:
            inside += element_lines("independentVarRef", {"varID": str(axis), **rules})
        inside += element_lines("dependentVarRef", {"varID": varID})
        reference = element_lines("griddedTableRef", {"gtID": self._table_id(name, table, stderr)})
        inside += element_lines("functionDefn", {"name": f"{varID}_fn"}, reference)
        self.function_lines += element_lines("function", {"name": name}, inside)

    def _table_id(self, name: str, table: xr.DataArray, stderr: xr.DataArray | None) -> str:
        """Return the gtID of a table; a table is written only once."""
        breakpoint_ids = []
        for axis in table.dims:
            breakpoint_ids.append(self._breakpoint_id(str(axis), table[axis].values))
        values = table.values.astype(float)
        spread = None if stderr is None else stderr.values.astype(float)
        # Equal tables have equal breakpoints, values and standard errors, bit by bit.
        key = (*breakpoint_ids, values.tobytes(), b"" if spread is None else spread.tobytes())
        if key in self.tables:
            return self.tables[key]
        self.tables[key] = self._new_id(f"T{len(self.tables) + 1}")
        references: list[str] = []
        for breakpoint_id in breakpoint_ids:
            references += element_lines("bpRef", {"bpID": breakpoint_id})
        inside = element_lines("breakpointRefs", {}, references)
        if spread is not None:
            inside += _uncertainty_lines(element_lines("dataTable", {}, number_lines(spread)))
        inside += element_lines("dataTable", {}, number_lines(values))
        attributes = {"name": name, "gtID": self.tables[key], "units": "nd"}
        self.table_lines += element_lines("griddedTableDef", attributes, inside)
        return self.tables[key]

    def _breakpoint_id(self, axis: str, points: np.ndarray) -> str:
        """Return the bpID of breakpoints; equal breakpoints of one axis are written only once."""
        points = points.astype(float)
        key = (axis, points.tobytes())
        if key in self.breakpoints:
            return self.breakpoints[key]
        name = f"B{len(self.breakpoints) + 1}_{axis.replace('.', '_')}"
        self.breakpoints[key] = self._new_id(name)
        row = lookup(axis)
        inside = [
            *element_lines("description", {}, row.long_name),
            *element_lines("bpVals", {}, number_lines(points)),
        ]
        attributes = {"name": axis, "bpID": self.breakpoints[key], "units": code_of(row.units)}
        self.breakpoint_lines += element_lines("breakpointDef", attributes, inside)
        return self.breakpoints[key]


def _calculation_lines(expression: Expression) -> list[str]:
    math = element_lines("math", {"xmlns": _MATH}, mathml.write_mathml(expression, ""))
    return element_lines("calculation", {}, math)


def _uncertainty_lines(bounds: list[str]) -> list[str]:
    """Return standard errors as an additive normal uncertainty of one sigma."""
    bound_lines = element_lines("bounds", {}, bounds)
    distribution = element_lines("normalPDF", {"numSigmas": "1"}, bound_lines)
    return element_lines("uncertainty", {"effect": "additive"}, distribution)


def _letter_number(index: int) -> str:
    """Return A, B, ... Z, AA, AB ... for 0, 1, ..., as the modification record counts."""
    letters = ""
    # Bijective number system with the digits A ... Z, which has no zero.
    index += 1
    while index:
        index, digit = divmod(index - 1, _ALPHABET)
        letters = chr(ord("A") + digit) + letters
    return letters
