"""An FMU is a stranger: what it offers is read from its description and compared with what a case needs, both ways."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import parse


@dataclass(frozen=True)
class Fmu:
    """Interface of an FMU: names and units (empty: not declared) of inputs, outputs (scalar numbers) and parameters.

    Attributes
    ----------
    path : Path
    version : str
        FMI version.
    sha256 : str
        Of the file.
    inputs, outputs, parameters : dict of str to str
        Name to unit.
    """

    path: Path
    version: str
    sha256: str
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    parameters: Mapping[str, str]


def read_fmu(path: str | Path) -> Fmu:
    """Read the description of a co-simulation FMU; its code is not run.

    Raises
    ------
    ParseError
        No FMU, a broken description, or one without co-simulation of FMI 2.0 or 3.0.
    FileNotFoundError
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no FMU {path}")
    from fmpy import read_model_description

    try:
        description = read_model_description(str(path), validate=False)
    except Exception as error:  # FMPy raises what its parser raised
        raise ParseError(str(path), 0, str(error).split("\n")[0], "an FMU (zip file with modelDescription.xml)") from error
    if description.coSimulation is None or description.fmiVersion[:1] not in "23":
        kinds = "co-simulation" if description.coSimulation else "no co-simulation"
        raise ParseError(str(path), 0, f"FMI {description.fmiVersion} with {kinds}", "co-simulation of FMI 2.0 or 3.0")
    found: dict[str, dict[str, str]] = {"input": {}, "output": {}, "parameter": {}}
    for variable in description.modelVariables:
        number = variable.type in ("Real", "Float64") and not getattr(variable, "dimensions", None)
        if variable.causality == "parameter" or (variable.causality in found and number):
            found[variable.causality][variable.name] = variable.unit or ""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Fmu(path, description.fmiVersion, digest, found["input"], found["output"], found["parameter"])


def check(fmu: Fmu, inputs: Iterable[str], outputs: Iterable[str], parameters: Iterable[str]) -> None:
    """Check that an FMU offers what a case needs, in the units of the house where it declares any.

    Raises
    ------
    SchemaError
        With every missing name, the near ones, and every foreign unit.
    """
    problems: list[str] = []
    wanted = (("input", inputs, fmu.inputs), ("output", outputs, fmu.outputs), ("parameter", parameters, fmu.parameters))
    for what, names, offered in wanted:
        for name in names:
            if name not in offered:
                problems.append(str(UnknownName(name, offered, what, "the case needs it and the FMU does not offer it")))
            else:
                problems += _unit_problem(what, name, offered[name])
    if problems:
        raise SchemaError(f"FMU {fmu.path}", problems)


def _unit_problem(what: str, name: str, unit: str) -> list[str]:
    """Compare a declared unit with that of the house: same quantity, same size."""
    try:
        expected = lookup(_bare(name)).units
    except UnknownName:
        return []
    try:
        same = not unit or parse(unit) == parse(expected)
    except UnitError as error:
        return [f"{what} {name}: {error}"]
    return [] if same else [f"{what} {name} is in {unit!r}; this house needs {expected!r}, write the FMU in SI"]


def _bare(name: str) -> str:
    """Return the quantity of a grouped name: ``init.theta`` is theta, ``engine1.thrust_drive`` a thrust."""
    if name.endswith(".thrust_drive"):
        return "thrust"
    head, _, tail = name.partition(".")
    return tail if head in ("init", "mass", "env", "trim", "applied") else name
