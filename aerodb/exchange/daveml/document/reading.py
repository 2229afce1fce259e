"""DAVE-ML 2.0.2 files, and the older forms that are about, to a `DaveModel`."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter

import numpy as np

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.model import (
    DaveFunction,
    DaveModel,
    DaveProvenance,
    DaveReference,
    DaveVariable,
    Header,
    Modification,
    Shot,
    Signal,
    Uncertainty,
)
from aerodb.exchange.daveml.document.tables import (
    EXTRAPOLATE,
    INTERPOLATE,
    MAX_AXES,
    FunctionAxis,
    Gridded,
    Scattered,
)
from aerodb.exchange.daveml.document.units import optional_number, parse_number, parse_numbers
from aerodb.exchange.xml_reader import Element, read_xml
from flightmech.errors import AeromatchWarning, ParseError, SchemaError

_DEPRECATED = (
    "fileCreationDate",
    "functionCreationDate",
    "signalID",
    "confidenceBound",
    "griddedTable",
    "ungriddedTable",
    "address",
)


def read(path: str | os.PathLike, checks: str = "raise") -> DaveModel:
    """Read a DAVE-ML file (ANSI/AIAA S-119) and run its check cases.

    Parameters
    ----------
    path : path
        The file.  No DTD, entity or network address in it is followed.
    checks : {"raise", "ignore"}
        What a check case that fails does.

    Raises
    ------
    ParseError
        No well-formed XML, or not what the DTD and the reference manual demand; with file and line.
    SchemaError
        A check case of the file fails; all of them are listed.

    Warns
    -----
    AeromatchWarning
        ``floor`` or ``ceiling`` at an ``independentVarRef``, which the DTD explains the wrong way
        round; ``quotient``.
    """
    if checks not in ("raise", "ignore"):
        raise ValueError(f"checks is {checks!r}; allowed: raise, ignore")
    model = _DaveReader(read_xml(path, doctype=True)).model()
    if checks == "raise":
        require_checks(model)
    return model


def require_checks(model: DaveModel) -> None:
    """Raise a `SchemaError` with every check value of a model that is not met."""
    table = model.check()
    failed = table[~table["passed"]]
    if len(failed):
        texts = [
            f"{row.shot}: {row.variable} is {row.found:.9g}, expected {row.expected:.9g} "
            f"within {row.tolerance:g} {row.note}".rstrip()
            if row.kind != "shot"
            else f"{row.shot}: {row.note}"
            for row in failed.itertuples()
        ]
        raise SchemaError(
            f"check cases of {model.file} that fail ({len(failed)} of {len(table)} values)", texts
        )


class _DaveReader:
    """One reading: the tables by name, the notes that come up."""

    def __init__(self, root: Element):
        if root.tag != "DAVEfunc":
            raise root.error(f"<{root.tag}> as root", "<DAVEfunc>, a DAVE-ML file")
        self.root = root
        self.notes: list[str] = []
        self.breakpoints = {e.attribute("bpID"): _breakpoints(e) for e in root.all("breakpointDef")}
        self.tables = _by_id(root.all("griddedTableDef"), "gtID") | _by_id(
            root.all("ungriddedTableDef"), "utID"
        )
        self.provenances: dict[str, DaveProvenance] = {}

    def model(self) -> DaveModel:
        self._note_dubious()
        header = self._header(self.root.need("fileHeader"))
        for element in self.root.need("fileHeader").all("provenance"):
            self._keep(element)
        variables: dict[str, DaveVariable] = {}
        for element in self.root.all("variableDef"):
            variable = self._variable(element)
            if variable.varID in variables:
                raise element.error(f"a second varID {variable.varID!r}", "each varID once")
            variables[variable.varID] = variable
        functions: dict[str, DaveFunction] = {}
        for place, element in enumerate(self.root.all("function")):
            function = self._function(element, place)
            if function.output in functions:
                raise element.error(
                    f"a second function for {function.output}", "one function per variable"
                )
            functions[function.output] = function
        file = self.root.file
        order = _order(file, variables, functions)
        shots = tuple(
            self._shot(element)
            for data in self.root.all("checkData")
            for element in data.all("staticShot")
        )
        return DaveModel(file, header, variables, functions, order, shots, tuple(self.notes))

    def _note_dubious(self) -> None:
        waiting, seen = [self.root], set()
        while waiting:
            element = waiting.pop()
            waiting += element.children
            if element.tag in _DEPRECATED:
                seen.add(element.tag)
            if element.tag == "quotient":
                self._warn(
                    element,
                    "<quotient> is taken as a plain division, as NASA's check cases have it; "
                    "MathML means its whole part",
                )
        self.notes += [
            f"<{tag}> is deprecated since DAVE-ML 2.0; read all the same" for tag in sorted(seen)
        ]

    def _header(self, element: Element) -> Header:
        return Header(
            element.attributes.get("name", "").strip(),
            _authors(element),
            _date(element),
            _text(element, "fileVersion"),
            _text(element, "description"),
            tuple(
                DaveReference(
                    e.attribute("refID"),
                    *(
                        e.attributes.get(key, "").strip()
                        for key in ("author", "title", "date", "accession")
                    ),
                )
                for e in element.all("reference")
            ),
            tuple(
                Modification(
                    e.attribute("modID"),
                    e.attributes.get("date", "").strip(),
                    _authors(e),
                    _text(e, "description"),
                )
                for e in element.all("modificationRecord")
            ),
        )

    def _variable(self, element: Element) -> DaveVariable:
        varID, calculation = element.attribute("varID"), element.first("calculation")
        is_input = any(element.first(tag) for tag in ("isInput", "isControl", "isDisturbance"))
        if calculation is not None and is_input:
            raise element.error(
                f"the input {varID} with a calculation", "either an input or a calculation"
            )
        low, high = (
            optional_number(element, "minValue", -np.inf),
            optional_number(element, "maxValue", np.inf),
        )
        if low > high:
            raise element.error(
                f"{varID} with minValue {low:g} over maxValue {high:g}", "minValue below maxValue"
            )
        initial = element.attributes.get("initialValue", "").strip()
        return DaveVariable(
            varID,
            element.attribute("name"),
            element.attributes.get("units", "").strip(),
            element.line,
            description=_text(element, "description"),
            sign=element.attributes.get("sign", "").strip(),
            axis_system=element.attributes.get("axisSystem", "").strip(),
            initial=parse_number(initial, element) if initial else None,
            low=low,
            high=high,
            calculation=None
            if calculation is None
            else mathml.read_mathml(calculation.need("math")),
            is_input=is_input,
            is_output=element.first("isOutput") is not None,
            is_standard=element.first("isStdAIAA") is not None,
            uncertainty=_uncertainty(element),
            provenance=self._provenance(element),
        )

    def _function(self, element: Element, place: int) -> DaveFunction:
        inputs = element.all("independentVarPts") or element.all("independentVarRef")
        if not inputs:
            raise element.error(
                "a function without inputs", "independentVarPts or independentVarRef"
            )
        if len(inputs) > MAX_AXES:
            raise element.error(
                f"a function of {len(inputs)} inputs", f"at most {MAX_AXES}; split the table"
            )
        if inputs[0].tag == "independentVarPts":
            simple, axes = (
                element.need("dependentVarPts"),
                tuple(self._axis(e, parse_numbers(e.text, e)) for e in inputs),
            )
            table: Gridded | Scattered = _gridded(parse_numbers(simple.text, simple), axes, simple)
            output, uncertainty, provenance = (
                simple.attribute("varID"),
                None,
                self._provenance(element),
            )
        else:
            output = element.need("dependentVarRef").attribute("varID")
            source = self._table(element.need("functionDefn"))
            table, axes = self._contents(source, inputs)
            uncertainty, provenance = (
                _uncertainty(source),
                self._provenance(element) or self._provenance(source),
            )
        names = tuple(e.attribute("varID") for e in inputs)
        text = _text(element, "description")
        name = element.attributes.get("name", "").strip()
        return DaveFunction(
            name, names, output, axes, table, element.line, place, text, uncertainty, provenance
        )

    def _table(self, definition: Element) -> Element:
        """Return the element that holds the table of a functionDefn, whether it is written there or
        referred to.
        """
        reference = definition.first("griddedTableRef", "ungriddedTableRef")
        if reference is None:
            return definition.need(
                "griddedTableDef", "griddedTable", "ungriddedTableDef", "ungriddedTable"
            )
        key = "gtID" if reference.tag == "griddedTableRef" else "utID"
        name = reference.attribute(
            key if key in reference.attributes else "gtID"
        )  # DAVE-ML 1.7 wrote gtID in both
        if name not in self.tables:
            raise reference.error(
                f"a reference to the table {name!r}", f"one of {', '.join(self.tables) or 'none'}"
            )
        if self.tables[name].tag.startswith("ungridded") != (reference.tag == "ungriddedTableRef"):
            self.notes.append(
                f"line {reference.line}: <{reference.tag}> points at a "
                f"<{self.tables[name].tag}>, which is taken"
            )
        return self.tables[name]

    def _contents(
        self, source: Element, inputs: list[Element]
    ) -> tuple[Gridded | Scattered, tuple[FunctionAxis, ...]]:
        if source.tag.startswith("ungridded"):
            return _scattered(source, len(inputs)), tuple(
                self._axis(e, np.zeros(1)) for e in inputs
            )
        references = source.need("breakpointRefs").all("bpRef")
        if len(references) != len(inputs):
            raise source.error(
                f"{len(references)} breakpoint sets for {len(inputs)} inputs",
                "one bpRef per independentVarRef, same order",
            )
        axes = tuple(
            self._axis(e, self._points(reference))
            for e, reference in zip(inputs, references, strict=True)
        )
        data = source.need("dataTable")
        return _gridded(parse_numbers(data.text, data), axes, data), axes

    def _points(self, reference: Element) -> np.ndarray:
        name = reference.attribute("bpID")
        if name not in self.breakpoints:
            raise reference.error(
                f"a reference to the breakpoints {name!r}",
                f"one of {', '.join(self.breakpoints) or 'none'}",
            )
        return self.breakpoints[name]

    def _axis(self, element: Element, points: np.ndarray) -> FunctionAxis:
        interpolate = element.attributes.get("interpolate", "linear").strip()
        extrapolate = element.attributes.get("extrapolate", "neither").strip()
        if interpolate not in INTERPOLATE:
            raise element.error(
                f"interpolate={interpolate!r}",
                f"{', '.join(INTERPOLATE)}; quadratic splines are not unique, tabulate it",
            )
        if extrapolate not in EXTRAPOLATE:
            raise element.error(f"extrapolate={extrapolate!r}", ", ".join(EXTRAPOLATE))
        _demand_rising(points, element)
        if interpolate in ("floor", "ceiling") and element.tag == "independentVarRef":
            self._warn_step(element, interpolate)
        low, high = (
            optional_number(element, "min", -np.inf),
            optional_number(element, "max", np.inf),
        )
        if low > high:
            raise element.error(f"min {low:g} over max {high:g}", "min below max")
        return FunctionAxis(points, interpolate, extrapolate, low, high)

    def _warn_step(self, element: Element, interpolate: str) -> None:
        side = "lower" if interpolate == "floor" else "upper"
        self._warn(
            element,
            f"interpolate={interpolate!r} is taken as the {side} breakpoint, as at "
            f"independentVarPts and in the figures of the manual; "
            "the DTD states the opposite for independentVarRef. Ask the author, or trust the "
            "check cases",
        )

    def _warn(self, element: Element, text: str) -> None:
        self.notes.append(f"line {element.line}: {text}")
        warnings.warn(f"{element.file}, {self.notes[-1]}", AeromatchWarning, stacklevel=5)

    def _provenance(self, parent: Element) -> DaveProvenance | None:
        reference = parent.first("provenanceRef")
        if reference is not None:
            name = reference.attribute("provID")
            if name not in self.provenances:
                raise reference.error(
                    f"a reference to the provenance {name!r}", "a provID that stands before it"
                )
            return self.provenances[name]
        element = parent.first("provenance")
        return None if element is None else self._keep(element)

    def _keep(self, element: Element) -> DaveProvenance:
        found = DaveProvenance(
            _authors(element),
            _date(element),
            tuple(
                e.attributes.get("refID", e.attributes.get("docID", "")).strip()
                for e in element.all("documentRef")
            ),
            tuple(e.attribute("modID") for e in element.all("modificationRef")),
            _text(element, "description"),
        )
        if "provID" in element.attributes:
            self.provenances[element.attribute("provID")] = found
        return found

    def _shot(self, element: Element) -> Shot:
        signals = [
            self._signals(element.first(tag))
            for tag in ("checkInputs", "internalValues", "checkOutputs")
        ]
        return Shot(element.attributes.get("name", "").strip(), *signals)

    def _signals(self, parent: Element | None) -> tuple[Signal, ...]:
        return (
            tuple(_signal(element) for element in parent.all("signal"))
            if parent is not None
            else ()
        )


def _signal(element: Element) -> Signal:
    key, value, tolerance = (
        element.need("signalName", "varID", "signalID"),
        element.need("signalValue"),
        element.first("tol"),
    )
    allowed = np.nan if tolerance is None else parse_number(tolerance.text, tolerance)
    return Signal(
        key.text,
        key.tag != "signalName",
        _text(element, "signalUnits"),
        parse_number(value.text, value),
        allowed,
    )


def _by_id(elements: Iterable[Element], key: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in elements:
        name = element.attribute(key)
        if name in found:
            raise element.error(f"a second table {name!r}", f"each {key} once")
        found[name] = element
    return found


def _breakpoints(element: Element) -> np.ndarray:
    values = element.need("bpVals")
    return parse_numbers(values.text, values)


def _demand_rising(points: np.ndarray, element: Element) -> None:
    if not len(points):
        raise element.error("no breakpoints", "at least one")
    fall = np.flatnonzero(np.diff(points) <= 0.0)
    if fall.size:
        at = int(fall[0])
        raise element.error(
            f"breakpoints that do not rise: {points[at]:g}, then {points[at + 1]:g}",
            "rising breakpoints",
        )


def _gridded(values: np.ndarray, axes: tuple[FunctionAxis, ...], element: Element) -> Gridded:
    shape = tuple(len(axis.points) for axis in axes)
    if values.size != int(np.prod(shape, dtype=float)):
        raise element.error(
            f"{values.size} values", f"{' x '.join(map(str, shape))}, as the breakpoints have it"
        )
    return Gridded(values.reshape(shape))


def _scattered(element: Element, axes: int) -> Scattered:
    rows = [parse_numbers(point.text, point) for point in element.all("dataPoint")]
    for row, point in zip(rows, element.all("dataPoint"), strict=True):
        if row.size != axes + 1:
            raise point.error(
                f"a data point of {row.size} numbers", f"{axes} coordinates and a value"
            )
    if len(rows) < axes + 1:
        raise element.error(f"{len(rows)} data points", f"at least {axes + 1} for {axes} inputs")
    data = np.array(rows)
    points, first = np.unique(data[:, :-1], axis=0, return_index=True)
    if len(points) != len(data):
        raise element.error("a data point twice", "each place once")
    if np.linalg.matrix_rank(points - points[0]) < axes:
        raise element.error(
            "data points on one line or plane", f"points that span all {axes} inputs"
        )
    return Scattered(points, data[first, -1])


def _uncertainty(parent: Element) -> Uncertainty | None:
    element = parent.first("uncertainty")
    if element is None:
        return None
    pdf = element.need("normalPDF", "uniformPDF")
    sigmas = parse_number(pdf.attribute("numSigmas"), pdf) if pdf.tag == "normalPDF" else 0.0
    if pdf.tag == "normalPDF" and sigmas <= 0.0:
        raise pdf.error(f"numSigmas {sigmas:g}", "a positive number")
    bounds = tuple(_bounds(bound) for bound in pdf.all("bounds"))
    if len(bounds) not in ((1,) if sigmas else (1, 2)):
        raise pdf.error(f"{len(bounds)} bounds", "one, or two for an uneven uniform distribution")
    return Uncertainty(element.attribute("effect"), sigmas, bounds)


def _bounds(element: Element) -> np.ndarray | str:
    inner = element.first("variableDef", "variableRef")
    if inner is not None:
        return inner.attribute("varID")
    table = element.first("dataTable") or element
    return parse_numbers(table.text, table)


def _authors(element: Element) -> tuple[str, ...]:
    return tuple(
        ", ".join(
            text for key in ("name", "org") if (text := author.attributes.get(key, "").strip())
        )
        for author in element.all("author")
    )


def _date(element: Element) -> str:
    date = element.first("creationDate", "fileCreationDate", "functionCreationDate")
    return "" if date is None else date.attributes.get("date", "").strip()


def _text(element: Element, tag: str) -> str:
    """Return the text of a child, its lines without indentation."""
    child = element.first(tag)
    return "" if child is None else "\n".join(line.strip() for line in child.text.splitlines())


def _order(
    file: str, variables: Mapping[str, DaveVariable], functions: Mapping[str, DaveFunction]
) -> tuple[str, ...]:
    """Return the varIDs so that each comes after what it is computed from."""
    needs: dict[str, set[str]] = {varID: set() for varID in variables}
    for varID, variable in variables.items():
        if variable.calculation is not None:
            needs[varID] = set(mathml.expression_variables(variable.calculation))
            if varID in functions:
                raise ParseError(
                    file,
                    functions[varID].line,
                    f"a function for {varID}, which has a calculation",
                    "one of them",
                )
        _demand_known(file, variable.line, needs[varID], variables)
    for varID, function in functions.items():
        _demand_known(file, function.line, {varID, *function.inputs}, variables)
        if variables[varID].is_input:
            raise ParseError(
                file,
                function.line,
                f"a function for the input {varID}",
                "an output that is no input",
            )
        needs[varID] = set(function.inputs)
    try:
        return tuple(TopologicalSorter(needs).static_order())
    except CycleError as error:
        loop = " <- ".join(error.args[1])
        raise ParseError(
            file,
            variables[error.args[1][0]].line,
            f"variables computed from each other: {loop}",
            "an order",
        ) from None


def _demand_known(
    file: str, line: int, names: Iterable[str], variables: Mapping[str, DaveVariable]
) -> None:
    unknown = sorted(set(names) - set(variables))
    if unknown:
        raise ParseError(
            file,
            line,
            f"a reference to {', '.join(unknown)}",
            "varIDs of variables that the file defines",
        )
