"""Conversion of the XML elements of a DAVE-ML file to texts, tables, uncertainties and signals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter

import numpy as np

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.elements import (
    DaveFunction,
    DaveReference,
    DaveVariable,
    Header,
    Modification,
    Signal,
    Uncertainty,
)
from aerodb.exchange.daveml.document.tables import FunctionAxis, Gridded, Scattered
from aerodb.exchange.daveml.document.units import parse_number, parse_numbers
from aerodb.exchange.xml_reader import Element
from flightmech.errors import ParseError


def attribute_text(element: Element, name: str) -> str:
    """Return an attribute without blanks around it, or ``""`` if it is missing."""
    return element.attributes.get(name, "").strip()


def child_text(element: Element, tag: str) -> str:
    """Return the text of a child with its lines without indentation, or ``""``."""
    child = element.first(tag)
    if child is None:
        return ""
    return "\n".join(line.strip() for line in child.text.splitlines())


def author_texts(element: Element) -> tuple[str, ...]:
    """Return the authors of an item as ``name, organisation``."""
    authors = []
    for author in element.all("author"):
        parts = [attribute_text(author, "name"), attribute_text(author, "org")]
        authors.append(", ".join(filter(None, parts)))
    return tuple(authors)


def creation_date(element: Element) -> str:
    """Return the date of an item, or ``""``."""
    date = element.first("creationDate", "fileCreationDate", "functionCreationDate")
    return "" if date is None else attribute_text(date, "date")


def parse_header(element: Element) -> Header:
    """Return the content of a fileHeader."""
    # Only the identifier of a reference or a modification is mandatory.
    references = []
    for reference in element.all("reference"):
        references.append(
            DaveReference(
                refID=reference.attribute("refID"),
                author=attribute_text(reference, "author"),
                title=attribute_text(reference, "title"),
                date=attribute_text(reference, "date"),
                accession=attribute_text(reference, "accession"),
            )
        )
    modifications = []
    for record in element.all("modificationRecord"):
        modifications.append(
            Modification(
                modID=record.attribute("modID"),
                date=attribute_text(record, "date"),
                authors=author_texts(record),
                description=child_text(record, "description"),
            )
        )
    return Header(
        name=attribute_text(element, "name"),
        authors=author_texts(element),
        date=creation_date(element),
        version=child_text(element, "fileVersion"),
        description=child_text(element, "description"),
        references=tuple(references),
        modifications=tuple(modifications),
    )


def index_tables(elements: Iterable[Element], key: str) -> dict[str, Element]:
    """Return the table elements by the attribute `key`, which must be unique."""
    tables: dict[str, Element] = {}
    for element in elements:
        name = element.attribute(key)
        if name in tables:
            raise element.error(f"a second table {name!r}", f"each {key} once")
        tables[name] = element
    return tables


def parse_breakpoints(element: Element) -> np.ndarray:
    """Return the breakpoints of a breakpointDef."""
    values = element.need("bpVals")
    return parse_numbers(values.text, values)


def require_rising(points: np.ndarray, element: Element) -> None:
    """Raise `ParseError` at the element if the breakpoints do not rise."""
    if not len(points):
        raise element.error("no breakpoints", "at least one")
    falling = np.flatnonzero(np.diff(points) <= 0.0)
    if falling.size:
        index = int(falling[0])
        raise element.error(
            f"breakpoints that do not rise: {points[index]:g}, then {points[index + 1]:g}",
            "rising breakpoints",
        )


def parse_gridded(element: Element, axes: tuple[FunctionAxis, ...]) -> Gridded:
    """Return the values of an element as a table over the axes, in C order."""
    values = parse_numbers(element.text, element)
    shape = tuple(len(axis.points) for axis in axes)
    # The product is a float because that of many axes may exceed an integer.
    if values.size != int(np.prod(shape, dtype=float)):
        raise element.error(
            f"{values.size} values", f"{' x '.join(map(str, shape))}, as the breakpoints have it"
        )
    return Gridded(values.reshape(shape))


def parse_scattered(element: Element, axes: int) -> Scattered:
    """Return the data points of an ungridded table over a number of axes."""
    # All points are parsed before their lengths are compared.
    rows = []
    for point in element.all("dataPoint"):
        rows.append(parse_numbers(point.text, point))
    for row, point in zip(rows, element.all("dataPoint"), strict=True):
        if row.size != axes + 1:
            raise point.error(
                f"a data point of {row.size} numbers", f"{axes} coordinates and a value"
            )
    if len(rows) < axes + 1:
        raise element.error(f"{len(rows)} data points", f"at least {axes + 1} for {axes} inputs")
    # The last column is the value, the others are the coordinates.
    data = np.array(rows)
    points, first = np.unique(data[:, :-1], axis=0, return_index=True)
    if len(points) != len(data):
        raise element.error("a data point twice", "each place once")
    # A triangulation needs points that span the space of the inputs.
    if np.linalg.matrix_rank(points - points[0]) < axes:
        raise element.error(
            "data points on one line or plane", f"points that span all {axes} inputs"
        )
    return Scattered(points, data[first, -1])


def parse_uncertainty(parent: Element) -> Uncertainty | None:
    """Return the uncertainty of a variable or table, or None if it has none."""
    element = parent.first("uncertainty")
    if element is None:
        return None
    pdf = element.need("normalPDF", "uniformPDF")
    sigmas = 0.0
    # A uniform distribution may have a lower and an upper bound.
    counts: tuple[int, ...] = (1, 2)
    if pdf.tag == "normalPDF":
        sigmas = parse_number(pdf.attribute("numSigmas"), pdf)
        if sigmas <= 0.0:
            raise pdf.error(f"numSigmas {sigmas:g}", "a positive number")
        counts = (1,)
    bounds = tuple(_parse_bounds(bound) for bound in pdf.all("bounds"))
    if len(bounds) not in counts:
        raise pdf.error(f"{len(bounds)} bounds", "one, or two for an uneven uniform distribution")
    return Uncertainty(element.attribute("effect"), sigmas, bounds)


def _parse_bounds(element: Element) -> np.ndarray | str:
    """Return the numbers of a bound, or the varID of the variable that holds them."""
    variable = element.first("variableDef", "variableRef")
    if variable is not None:
        return variable.attribute("varID")
    table = element.first("dataTable") or element
    return parse_numbers(table.text, table)


def parse_signal(element: Element) -> Signal:
    """Return a signal of a check case."""
    # A signal has a name, or a varID; signalID is the deprecated form of it.
    key = element.need("signalName", "varID", "signalID")
    value, tolerance = element.need("signalValue"), element.first("tol")
    allowed = np.nan
    if tolerance is not None:
        allowed = parse_number(tolerance.text, tolerance)
    return Signal(
        key=key.text,
        is_varID=key.tag != "signalName",
        units=child_text(element, "signalUnits"),
        value=parse_number(value.text, value),
        tolerance=allowed,
    )


def computation_order(
    file: str, variables: Mapping[str, DaveVariable], functions: Mapping[str, DaveFunction]
) -> tuple[str, ...]:
    """Return the varIDs in an order in which each follows those it is computed from.

    Raises
    ------
    ParseError
        A reference to an undefined variable, a variable with two definitions, or variables that
        are computed from each other.
    """
    # By varID: the variables from which it is computed.
    sources: dict[str, set[str]] = {varID: set() for varID in variables}
    for varID, variable in variables.items():
        if variable.calculation is not None:
            sources[varID] = set(mathml.expression_variables(variable.calculation))
            if varID in functions:
                raise ParseError(
                    file,
                    functions[varID].line,
                    f"a function for {varID}, which has a calculation",
                    "one of them",
                )
        _require_defined(file, variable.line, sources[varID], variables=variables)
    for varID, function in functions.items():
        names = {varID, *function.inputs}
        _require_defined(file, function.line, names, variables=variables)
        if variables[varID].is_input:
            raise ParseError(
                file,
                function.line,
                f"a function for the input {varID}",
                "an output that is not an input",
            )
        sources[varID] = set(function.inputs)
    try:
        return tuple(TopologicalSorter(sources).static_order())
    except CycleError as error:
        cycle = error.args[1]
        raise ParseError(
            file,
            variables[cycle[0]].line,
            f"variables computed from each other: {' <- '.join(cycle)}",
            "an order",
        ) from None


def _require_defined(
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
