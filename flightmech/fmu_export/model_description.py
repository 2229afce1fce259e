"""modelDescription.xml of FMI 2.0 and FMI 3.0.

References
----------
.. [FMI2] Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0, 2014, sections 2.2,
   3.3 and 4.3.
.. [FMI3] Functional Mock-up Interface 3.0, 2022, sections 2.4, 3.3 and 4.3.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET

from flightmech.errors import SchemaError
from flightmech.fmu_export.description import CHOICES, REPLAY, TIME, Description, FmuVariable
from flightmech.units import parse_unit

# Relative tolerance for the importer's solver.  Importers such as FMPy hold the inputs over an
# output interval: at its end q_dot jumps, and a multistep method that is not started afresh there
# has to shrink its step until the jump is within the tolerance. CVode gives up after 7 reductions.
# 1e-6 is the smallest power of ten at which it never does with full steps of the controls; 1e-7
# fails.
TOLERANCE = 1e-6
# Largest integers of the two standards.
_INT32_MAX, _INT64_MAX = 2**31 - 1, 2**63 - 1
_PARTIAL = ("providesDirectionalDerivatives", "providesAdjointDerivatives")
_INTERFACES: dict[str, dict[str, tuple[str, ...]]] = {
    "2.0": {
        "ModelExchange": (
            "canNotUseMemoryManagementFunctions",
            "canGetAndSetFMUstate",
            "canSerializeFMUstate",
            "providesDirectionalDerivative",
        ),
        "CoSimulation": (
            "canHandleVariableCommunicationStepSize",
            "canInterpolateInputs",
            "canNotUseMemoryManagementFunctions",
            "canGetAndSetFMUstate",
            "canSerializeFMUstate",
            "providesDirectionalDerivative",
        ),
    },
    "3.0": {
        "ModelExchange": (
            "canGetAndSetFMUState",
            "canSerializeFMUState",
            "needsCompletedIntegratorStep",
            *_PARTIAL,
        ),
        "CoSimulation": (
            "canHandleVariableCommunicationStepSize",
            "canGetAndSetFMUState",
            "canSerializeFMUState",
            *_PARTIAL,
        ),
    },
}
_LOCAL = ("state", "derivative")


def render_model_description(description: Description, version: str) -> bytes:
    """Return modelDescription.xml for FMI `version` ``"2.0"`` or ``"3.0"``."""
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": description.title,
            "guid" if version == "2.0" else "instantiationToken": description.token,
            "description": f"Flight simulation model of {description.title}",
            "generationTool": description.tool,
            "variableNamingConvention": "structured",
        },
    )
    if version == "2.0":
        root.set("numberOfEventIndicators", "0")
    for kind, names in _INTERFACES[version].items():
        ET.SubElement(
            root, kind, {"modelIdentifier": description.identifier, **dict.fromkeys(names, "true")}
        )
    _add_units(root, description.variables)
    if version == "2.0":
        _add_fmi2_variables(root, description)
    else:
        _add_fmi3_variables(root, description)
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _add_fmi2_variables(root: ET.Element, description: Description) -> None:
    """Add the variables and the model structure of FMI 2.0."""
    _add_experiment(root, description)
    variables = ET.SubElement(root, "ModelVariables")
    # FMI 2.0 refers to a variable by its number in the file, from 1.
    numbers = {}
    for number, variable in enumerate(description.variables, 1):
        numbers[variable.reference] = str(number)
    for variable in description.variables:
        scalar = ET.SubElement(variables, "ScalarVariable", _common_attributes(variable))
        if variable.name in CHOICES:
            # Some importers, such as libcosim, do not support enumerations but integers.
            text = _describe_choices(variable.description, CHOICES[variable.name])
            scalar.set("description", text)
        if variable.name in CHOICES or variable.integer:
            ET.SubElement(scalar, "Integer", _integer_attributes(variable, _INT32_MAX))
        else:
            attributes = _real_attributes(variable)
            if variable.state:
                attributes["derivative"] = numbers[variable.state]
            ET.SubElement(scalar, "Real", attributes)

    structure = ET.SubElement(root, "ModelStructure")
    for part, unknowns in _structure_parts(
        description, ("Outputs", "Derivatives", "InitialUnknowns")
    ):
        if not unknowns:
            continue
        element = ET.SubElement(structure, part)
        for variable in unknowns:
            attributes = {"index": numbers[variable.reference]}
            attributes |= _dependency_attributes(part, variable, numbers)
            ET.SubElement(element, "Unknown", attributes)


def _add_fmi3_variables(root: ET.Element, description: Description) -> None:
    """Add the types, the variables and the model structure of FMI 3.0."""
    types = ET.SubElement(root, "TypeDefinitions")
    for variable in description.variables:
        if variable.name in CHOICES:
            parent = ET.SubElement(types, "EnumerationType", name=variable.name)
            for name, value in CHOICES[variable.name].items():
                ET.SubElement(parent, "Item", name=name, value=str(value))
    _add_experiment(root, description)
    variables = ET.SubElement(root, "ModelVariables")
    time = {
        "name": "time",
        "valueReference": str(TIME),
        "causality": "independent",
        "variability": "continuous",
        "unit": "s",
        "description": "simulated time",
    }
    ET.SubElement(variables, "Float64", time)
    for variable in description.variables:
        attributes = _common_attributes(variable)
        if variable.name in CHOICES:
            attributes |= {"declaredType": variable.name, "start": _integer_start(variable)}
            ET.SubElement(variables, "Enumeration", attributes)
        elif variable.integer:
            attributes |= _integer_attributes(variable, _INT64_MAX)
            ET.SubElement(variables, "Int64", attributes)
        else:
            attributes |= _real_attributes(variable)
            if variable.state:
                attributes["derivative"] = str(variable.state)
            ET.SubElement(variables, "Float64", attributes)
    _add_replay(variables, description)

    # FMI 3.0 refers to a variable by its value reference.
    references = {v.reference: str(v.reference) for v in description.variables}
    structure = ET.SubElement(root, "ModelStructure")
    for part, unknowns in _structure_parts(
        description, ("Output", "ContinuousStateDerivative", "InitialUnknown")
    ):
        for variable in unknowns:
            attributes = {"valueReference": references[variable.reference]}
            attributes |= _dependency_attributes(part, variable, references)
            ET.SubElement(structure, part, attributes)
        if part in ("Output", "InitialUnknown"):
            ET.SubElement(structure, part, valueReference=str(REPLAY["replay.y"]))


def _add_replay(variables: ET.Element, description: Description) -> None:
    """Add the arrays with which one step replays a complete record."""
    inputs, outputs = description.of("input"), description.of("output")
    # A structural parameter is the first dimension of all arrays.
    sample_count = {
        "name": "replay.n",
        "valueReference": str(REPLAY["replay.n"]),
        "causality": "structuralParameter",
        "variability": "fixed",
        "description": "samples of a replay; 1: no replay",
        "min": "1",
        "start": "1",
    }
    ET.SubElement(variables, "UInt64", sample_count)
    tunable = {"causality": "parameter", "variability": "tunable"}
    # One step reads times and inputs of all samples, and writes all outputs.
    times = {
        **tunable,
        "unit": "s",
        "start": "0.0",
        "description": "times of the samples, rising; one step goes from the first to the last",
    }
    _add_replay_array(variables, "replay.t", times, columns=0)
    samples = {
        **tunable,
        "start": " ".join(repr(variable.start) for variable in inputs),
        "description": "inputs of every sample, linear between them, SI; columns are the inputs in "
        "the order of this file",
    }
    _add_replay_array(variables, "replay.u", samples, columns=len(inputs))
    results = {
        "causality": "output",
        "variability": "discrete",
        "initial": "calculated",
        "description": "outputs of every sample, SI; columns are the other outputs in the order of "
        "this file",
    }
    _add_replay_array(variables, "replay.y", results, columns=len(outputs))


def _add_replay_array(
    variables: ET.Element, name: str, attributes: dict[str, str], columns: int
) -> None:
    """Add an array (sample, column), or (sample,) without columns."""
    head = {"name": name, "valueReference": str(REPLAY[name])}
    array = ET.SubElement(variables, "Float64", {**head, **attributes})
    ET.SubElement(array, "Dimension", valueReference=str(REPLAY["replay.n"]))
    if columns:
        ET.SubElement(array, "Dimension", start=str(columns))


def _common_attributes(variable: FmuVariable) -> dict[str, str]:
    """Return the attributes that variables of all types have."""
    # states and derivatives are local variables in both standards
    local = variable.causality in _LOCAL
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.description,
        "causality": "local" if local else variable.causality,
        "variability": variable.variability,
    }
    if local:
        attributes["initial"] = "calculated"
    return attributes


def _real_attributes(variable: FmuVariable) -> dict[str, str]:
    attributes = {"unit": variable.units}
    if variable.display_units != variable.units:
        attributes["displayUnit"] = variable.display_units
    numbers = {
        "min": variable.low,
        "max": variable.high,
        "nominal": variable.nominal,
        "start": variable.start,
    }
    for key, value in numbers.items():
        if value is not None:
            attributes[key] = repr(value)
    return attributes


def _integer_start(variable: FmuVariable) -> str:
    return str(int(variable.start or 0.0))


def _integer_attributes(variable: FmuVariable, largest: int) -> dict[str, str]:
    """Return limits and start of an integer; `largest` is that of the type."""
    attributes = {}
    for key, value in (("min", variable.low), ("max", variable.high)):
        if value is not None:
            attributes[key] = str(int(min(value, largest)))
    attributes["start"] = _integer_start(variable)
    return attributes


def _structure_parts(
    description: Description, names: Sequence[str]
) -> Iterable[tuple[str, list[FmuVariable]]]:
    """Return the unknowns of each part of the model structure: outputs, derivatives, initial."""
    outputs, derivatives = description.of("output"), description.of("derivative")
    initial = [*outputs, *description.of("state"), *derivatives]
    return zip(names, (outputs, derivatives, initial), strict=True)


def _dependency_attributes(
    part: str, variable: FmuVariable, indices: dict[int, str]
) -> dict[str, str]:
    """Return the dependencies of an unknown, or no attribute if it depends on all variables."""
    # at the start a trim makes every unknown depend on every variable
    if variable.dependencies is None or part.startswith("Initial"):
        return {}
    return {"dependencies": " ".join(indices[reference] for reference in variable.dependencies)}


def _describe_choices(text: str, choices: dict[str, int]) -> str:
    """Return the description of a choice with its values."""
    values = ", ".join(f"{value} {name}" for name, value in choices.items())
    return "; ".join(filter(None, [text, values]))


def _add_experiment(root: ET.Element, description: Description) -> None:
    """Add the log category and the default experiment."""
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(
        categories,
        "Category",
        name="logStatusError",
        description="why a call was refused or failed",
    )
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        tolerance=repr(TOLERANCE),
        stepSize=repr(description.step),
    )


def _add_units(root: ET.Element, variables: Sequence[FmuVariable]) -> None:
    """Add every unit with its base units, and its display units with their factors."""
    display_units: dict[str, set[str]] = {"s": set()}
    for variable in variables:
        display_units.setdefault(variable.units, set()).add(variable.display_units)
    definitions = ET.SubElement(root, "UnitDefinitions")
    for units, displays in sorted(display_units.items()):
        unit = ET.SubElement(definitions, "Unit", name=units)
        ET.SubElement(unit, "BaseUnit", base_units(units))
        for display in sorted(displays - {units}):
            # units module: SI = value * factor + offset; FMI: display = SI * factor + offset
            _, factor, offset = parse_unit(display)
            attributes = {"name": display, "factor": repr(1.0 / factor)}
            if offset:
                attributes["offset"] = repr(-offset / factor)
            ET.SubElement(unit, "DisplayUnit", attributes)


def _count_powers(name: str, units: str) -> int:
    """Return the sum of the exponents of a unit in a text, where no number means 1."""
    return sum(int(power or 1) for power in re.findall(rf"\b{name}\^?(-?\d*)(?![A-Za-z])", units))


def base_units(units: str) -> dict[str, str]:
    """Return the exponents of an SI unit with the names of FMI, without zeros.

    Examples
    --------
    >>> base_units("rad s-1")
    {'s': '-1', 'rad': '1'}
    """
    dimension, factor, offset = parse_unit(units)
    if factor != 1.0 or offset:
        raise SchemaError(
            "model description",
            [f"{units!r} is not an SI unit; the catalogue of the kernel holds SI units only"],
        )
    # the dimension has no angle: its exponent comes from the text
    names = ("m", "kg", "s", "K", "A", "rad")
    exponents = dict(zip(names, (*dimension, _count_powers("rad", units)), strict=True))
    return {name: str(power) for name, power in exponents.items() if power}
