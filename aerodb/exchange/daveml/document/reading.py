"""Reader of DAVE-ML 2.0.2 files and of the older forms in use."""

from __future__ import annotations

import os
import warnings

import numpy as np

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.elements import (
    DaveFunction,
    DaveProvenance,
    DaveVariable,
    Shot,
    Signal,
)
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.document.parsing import (
    attribute_text,
    author_texts,
    child_text,
    computation_order,
    creation_date,
    index_tables,
    parse_breakpoints,
    parse_gridded,
    parse_header,
    parse_scattered,
    parse_signal,
    parse_uncertainty,
    require_rising,
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
from flightmech.errors import AeromatchWarning, SchemaError

_DEPRECATED = (
    "fileCreationDate",
    "functionCreationDate",
    "signalID",
    "confidenceBound",
    "griddedTable",
    "ungriddedTable",
    "address",
)


def read(path: str | os.PathLike[str], checks: str = "raise") -> DaveModel:
    """Read a DAVE-ML file (ANSI/AIAA S-119) and run its check cases.

    Parameters
    ----------
    path : path
        The file.  The reader loads no DTD, entity or network address.
    checks : {"raise", "ignore"}
        Action on a check case that fails.

    Raises
    ------
    ParseError
        The XML is not well-formed, or it violates the DTD or the reference manual; with file and
        line.
    SchemaError
        Check cases of the file fail; all of them are listed.

    Warns
    -----
    AeromatchWarning
        ``floor`` or ``ceiling`` at an ``independentVarRef``, whose meanings the DTD exchanges;
        ``quotient``.
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
    if not len(failed):
        return
    texts = []
    for row in failed.itertuples():
        if row.kind == "shot":
            texts.append(f"{row.shot}: {row.note}")
            continue
        text = (
            f"{row.shot}: {row.variable} is {row.found:.9g}, expected {row.expected:.9g} "
            f"within {row.tolerance:g} {row.note}"
        )
        texts.append(text.rstrip())
    raise SchemaError(
        f"check cases of {model.file} that fail ({len(failed)} of {len(table)} values)", texts
    )


class _DaveReader:
    """One reading of a file: its tables by name, and the notes on it."""

    def __init__(self, root: Element):
        if root.tag != "DAVEfunc":
            raise root.error(f"<{root.tag}> as root", "<DAVEfunc>, a DAVE-ML file")
        self.root = root
        self.notes: list[str] = []
        self.breakpoints: dict[str, np.ndarray] = {}
        for element in root.all("breakpointDef"):
            name = element.attribute("bpID")
            self.breakpoints[name] = parse_breakpoints(element)
        self.tables = index_tables(root.all("griddedTableDef"), "gtID")
        self.tables |= index_tables(root.all("ungriddedTableDef"), "utID")
        self.provenances: dict[str, DaveProvenance] = {}

    def model(self) -> DaveModel:
        """Return the model of the file."""
        self._note_doubtful_elements()
        header_element = self.root.need("fileHeader")
        header = parse_header(header_element)
        # Provenances of the header are stored first, because later elements refer to them.
        for element in header_element.all("provenance"):
            self._store_provenance(element)
        variables = self._read_variables()
        functions = self._read_functions()
        order = computation_order(self.root.file, variables, functions)
        shots = []
        for data in self.root.all("checkData"):
            for element in data.all("staticShot"):
                shots.append(self._read_shot(element))
        return DaveModel(
            file=self.root.file,
            header=header,
            variables=variables,
            functions=functions,
            order=order,
            shots=tuple(shots),
            notes=tuple(self.notes),
        )

    def _note_doubtful_elements(self) -> None:
        """Note deprecated elements, and warn of a quotient."""
        # The stack visits the elements in an order that determines the order of the warnings.
        stack, deprecated = [self.root], set()
        while stack:
            element = stack.pop()
            stack += element.children
            if element.tag in _DEPRECATED:
                deprecated.add(element.tag)
            if element.tag == "quotient":
                self._warn(
                    element,
                    "<quotient> is taken as a plain division, as NASA's check cases have it; "
                    "MathML means its whole part",
                )
        for tag in sorted(deprecated):
            self.notes.append(f"<{tag}> is deprecated since DAVE-ML 2.0; read all the same")

    def _read_variables(self) -> dict[str, DaveVariable]:
        variables: dict[str, DaveVariable] = {}
        for element in self.root.all("variableDef"):
            variable = self._read_variable(element)
            if variable.varID in variables:
                raise element.error(f"a second varID {variable.varID!r}", "each varID once")
            variables[variable.varID] = variable
        return variables

    def _read_variable(self, element: Element) -> DaveVariable:
        varID, calculation = element.attribute("varID"), element.first("calculation")
        is_input = element.first("isInput", "isControl", "isDisturbance") is not None
        if calculation is not None and is_input:
            raise element.error(
                f"the input {varID} with a calculation", "either an input or a calculation"
            )
        # Without limits the range is infinite.
        low = optional_number(element, "minValue", -np.inf)
        high = optional_number(element, "maxValue", np.inf)
        if low > high:
            raise element.error(
                f"{varID} with minValue {low:g} over maxValue {high:g}", "minValue below maxValue"
            )
        initial_text = attribute_text(element, "initialValue")
        initial = parse_number(initial_text, element) if initial_text else None
        expression = None
        if calculation is not None:
            expression = mathml.read_mathml(calculation.need("math"))
        return DaveVariable(
            varID=varID,
            name=element.attribute("name"),
            units=attribute_text(element, "units"),
            line=element.line,
            description=child_text(element, "description"),
            sign=attribute_text(element, "sign"),
            axis_system=attribute_text(element, "axisSystem"),
            initial=initial,
            low=low,
            high=high,
            calculation=expression,
            is_input=is_input,
            is_output=element.first("isOutput") is not None,
            is_standard=element.first("isStdAIAA") is not None,
            uncertainty=parse_uncertainty(element),
            provenance=self._provenance_of(element),
        )

    def _read_functions(self) -> dict[str, DaveFunction]:
        functions: dict[str, DaveFunction] = {}
        for index, element in enumerate(self.root.all("function")):
            function = self._read_function(element, index)
            if function.output in functions:
                raise element.error(
                    f"a second function for {function.output}", "one function per variable"
                )
            functions[function.output] = function
        return functions

    def _read_function(self, element: Element, index: int) -> DaveFunction:
        inputs = element.all("independentVarPts") or element.all("independentVarRef")
        if not inputs:
            raise element.error(
                "a function without inputs", "independentVarPts or independentVarRef"
            )
        if len(inputs) > MAX_AXES:
            raise element.error(
                f"a function of {len(inputs)} inputs", f"at most {MAX_AXES}; split the table"
            )
        table: Gridded | Scattered
        if inputs[0].tag == "independentVarPts":
            # The simple form: breakpoints and values stand in the function itself.
            values = element.need("dependentVarPts")
            axes = tuple(self._read_axis(e, parse_numbers(e.text, e)) for e in inputs)
            table = parse_gridded(values, axes)
            output, uncertainty = values.attribute("varID"), None
            provenance = self._provenance_of(element)
        else:
            # The table and its breakpoints stand elsewhere in the file.
            output = element.need("dependentVarRef").attribute("varID")
            source = self._table_element(element.need("functionDefn"))
            table, axes = self._read_table(source, inputs)
            uncertainty = parse_uncertainty(source)
            provenance = self._provenance_of(element) or self._provenance_of(source)
        return DaveFunction(
            name=attribute_text(element, "name"),
            inputs=tuple(e.attribute("varID") for e in inputs),
            output=output,
            axes=axes,
            table=table,
            line=element.line,
            index=index,
            description=child_text(element, "description"),
            uncertainty=uncertainty,
            provenance=provenance,
        )

    def _table_element(self, definition: Element) -> Element:
        """Return the table of a functionDefn: a child, or the target of a reference."""
        reference = definition.first("griddedTableRef", "ungriddedTableRef")
        if reference is None:
            return definition.need(
                "griddedTableDef", "griddedTable", "ungriddedTableDef", "ungriddedTable"
            )
        is_ungridded = reference.tag == "ungriddedTableRef"
        # DAVE-ML 1.7 has the attribute gtID in both kinds of reference.
        key = "utID" if is_ungridded and "utID" in reference.attributes else "gtID"
        name = reference.attribute(key)
        if name not in self.tables:
            raise reference.error(
                f"a reference to the table {name!r}", f"one of {', '.join(self.tables) or 'none'}"
            )
        # The kind of the table counts, not the kind of the reference.
        table = self.tables[name]
        if table.tag.startswith("ungridded") != is_ungridded:
            self.notes.append(
                f"line {reference.line}: <{reference.tag}> points at a <{table.tag}>, which is "
                f"taken"
            )
        return table

    def _read_table(
        self, source: Element, inputs: list[Element]
    ) -> tuple[Gridded | Scattered, tuple[FunctionAxis, ...]]:
        """Return the table of an element and its axes."""
        if source.tag.startswith("ungridded"):
            # An axis of scattered points has limits, but no breakpoints.
            scattered = parse_scattered(source, len(inputs))
            return scattered, tuple(self._read_axis(e, np.zeros(1)) for e in inputs)
        references = source.need("breakpointRefs").all("bpRef")
        if len(references) != len(inputs):
            raise source.error(
                f"{len(references)} breakpoint sets for {len(inputs)} inputs",
                "one bpRef per independentVarRef, same order",
            )
        axes = []
        for element, reference in zip(inputs, references, strict=True):
            axes.append(self._read_axis(element, self._breakpoints_of(reference)))
        return parse_gridded(source.need("dataTable"), tuple(axes)), tuple(axes)

    def _breakpoints_of(self, reference: Element) -> np.ndarray:
        name = reference.attribute("bpID")
        if name not in self.breakpoints:
            raise reference.error(
                f"a reference to the breakpoints {name!r}",
                f"one of {', '.join(self.breakpoints) or 'none'}",
            )
        return self.breakpoints[name]

    def _read_axis(self, element: Element, points: np.ndarray) -> FunctionAxis:
        interpolate = element.attributes.get("interpolate", "linear").strip()
        extrapolate = element.attributes.get("extrapolate", "neither").strip()
        if interpolate not in INTERPOLATE:
            raise element.error(
                f"interpolate={interpolate!r}",
                f"{', '.join(INTERPOLATE)}; quadratic splines are not unique, tabulate it",
            )
        if extrapolate not in EXTRAPOLATE:
            raise element.error(f"extrapolate={extrapolate!r}", ", ".join(EXTRAPOLATE))
        require_rising(points, element)
        if interpolate in ("floor", "ceiling") and element.tag == "independentVarRef":
            self._warn_of_step(element, interpolate)
        low = optional_number(element, "min", -np.inf)
        high = optional_number(element, "max", np.inf)
        if low > high:
            raise element.error(f"min {low:g} over max {high:g}", "min below max")
        return FunctionAxis(points, interpolate, extrapolate, low=low, high=high)

    def _warn_of_step(self, element: Element, interpolate: str) -> None:
        # The DTD and the figures of the reference manual contradict each other.
        side = "lower" if interpolate == "floor" else "upper"
        self._warn(
            element,
            f"interpolate={interpolate!r} is taken as the {side} breakpoint, as at "
            f"independentVarPts and in the figures of the manual; "
            "the DTD states the opposite for independentVarRef. Ask the author, or trust the "
            "check cases",
        )

    def _warn(self, element: Element, text: str) -> None:
        """Note a doubtful element, and warn the caller of `read`."""
        self.notes.append(f"line {element.line}: {text}")
        warnings.warn(f"{element.file}, {self.notes[-1]}", AeromatchWarning, stacklevel=5)

    def _provenance_of(self, parent: Element) -> DaveProvenance | None:
        """Return the provenance of an element: a child, or the target of a reference."""
        reference = parent.first("provenanceRef")
        if reference is not None:
            name = reference.attribute("provID")
            if name not in self.provenances:
                raise reference.error(
                    f"a reference to the provenance {name!r}", "a provID that stands before it"
                )
            return self.provenances[name]
        element = parent.first("provenance")
        return None if element is None else self._store_provenance(element)

    def _store_provenance(self, element: Element) -> DaveProvenance:
        """Return a provenance, stored under its provID if it has one."""
        references = []
        for document in element.all("documentRef"):
            # Some files have docID in place of refID.
            default = document.attributes.get("docID", "")
            references.append(document.attributes.get("refID", default).strip())
        provenance = DaveProvenance(
            authors=author_texts(element),
            date=creation_date(element),
            references=tuple(references),
            modifications=tuple(e.attribute("modID") for e in element.all("modificationRef")),
            description=child_text(element, "description"),
        )
        if "provID" in element.attributes:
            self.provenances[element.attribute("provID")] = provenance
        return provenance

    def _read_shot(self, element: Element) -> Shot:
        return Shot(
            name=attribute_text(element, "name"),
            inputs=self._read_signals(element.first("checkInputs")),
            internal=self._read_signals(element.first("internalValues")),
            outputs=self._read_signals(element.first("checkOutputs")),
        )

    def _read_signals(self, parent: Element | None) -> tuple[Signal, ...]:
        if parent is None:
            return ()
        return tuple(parse_signal(element) for element in parent.all("signal"))
