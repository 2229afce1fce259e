"""An FMU is untrusted: what it offers is read from its description and compared with what a case
needs, both ways.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.support.input_files import file_kind
from flightmech.units import parse_unit
from pom.fmu.run_cache import FileState
from pom.fmu.variable_map import Fmu, Link, Links, canonical_unit
from pom.fmu.worker.model import platform_problem, read_description

_ABSENT = (
    "the case needs it and the FMU does not offer it; name it in a table of names, or "
    "waive an input or parameter there"
)
_TEXTS = ("String", "Binary", "Clock")


def read_fmu_interface(path: str | Path) -> Fmu:
    """Read the description of an FMU; its code is not run.

    Parameters
    ----------
    path : path
        FMU of FMI 1.0, 2.0 or 3.0.  Where it offers co-simulation, that is used; else model
        exchange.

    Raises
    ------
    ParseError
        No FMU, a broken description, or one with scheduled execution only.
    FileNotFoundError
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"no file {str(path)!r}; give the FMU of a model, as `aeromatch fmu write` writes it"
        )
    state = FileState.of(path)
    try:
        description = read_description(path)
    except Exception as error:  # FMPy raises what its parser raised
        content = file_kind(path)
        reason = str(error).split("\n")[0] if content.startswith("a zip") else content
        raise ParseError(
            str(path), 0, reason, "an FMU (zip file with modelDescription.xml)"
        ) from error
    kind = description.coSimulation or description.modelExchange
    if kind is None:
        raise ParseError(
            str(path),
            0,
            f"FMI {description.fmiVersion} without co-simulation and model exchange",
            "an FMU that offers one of them",
        )
    found: dict[str, dict[str, str]] = {"input": {}, "output": {}, "parameter": {}, "start": {}}
    for variable in description.modelVariables:
        if variable.type in _TEXTS or getattr(variable, "dimensions", None):
            continue
        if variable.causality in found:
            found[variable.causality][variable.name] = _unit(variable)
        if variable.causality in ("output", "local") and _takes_start(
            variable, description.fmiVersion
        ):
            found["start"][variable.name] = _unit(variable)
    even, step = _steps(description)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if FileState.of(path) != state:
        raise ParseError(
            str(path), 0, "the file changed while it was read", "an FMU that stays as it is"
        )
    return Fmu(
        path.resolve(),
        description.fmiVersion,
        digest,
        found["input"],
        found["output"],
        found["parameter"],
        found["start"],
        exchange=description.coSimulation is None,
        even=even,
        step=step,
        once=bool(kind.canBeInstantiatedOnlyOncePerProcess),
        state=state,
    )


def demand_platform(fmu: Fmu) -> None:
    """Raise if an FMU has no library for this platform.

    Raises
    ------
    SchemaError
        With the platforms that it has a library for, and this one.
    """
    problem = platform_problem(fmu.path, read_description(fmu.path))
    if problem:
        raise SchemaError(f"FMU {fmu.path}", [f"{fmu.path.name}: {problem}"])


def _unit(variable: Any) -> str:
    return (
        variable.unit
        or (variable.declaredType.unit if variable.declaredType is not None else "")
        or ""
    )


def _takes_start(variable: Any, version: str) -> bool:
    if variable.start is None or variable.variability == "constant":
        return False
    return version.startswith("1") or variable.initial in ("exact", "approx")


def _steps(description: Any) -> tuple[bool, float]:
    """Return whether an FMU takes steps of one length only, and that length, 0 when it does not
    state it. [s]
    """
    kind, experiment = description.coSimulation, description.defaultExperiment
    if kind is None:
        return False, 0.0
    if kind.fixedInternalStepSize:
        return True, float(kind.fixedInternalStepSize)
    if kind.canHandleVariableCommunicationStepSize:
        return False, 0.0
    return True, float(
        experiment.stepSize
    ) if experiment is not None and experiment.stepSize else 0.0


def check_interface(
    fmu: Fmu, links: Links, inputs: Iterable[str], outputs: Iterable[str], parameters: Iterable[str]
) -> None:
    """Check that an FMU offers what a case needs, in units that can be converted.

    Parameters
    ----------
    fmu : Fmu
    links : Links
        From `links_of`.
    inputs, outputs, parameters : iterable of str
        Canonical names.

    Raises
    ------
    SchemaError
        With every missing name, the near ones, and every foreign unit.
    """
    problems: list[str] = []
    wanted = (
        ("input", inputs, links.inputs, fmu.inputs),
        ("output", outputs, links.outputs, fmu.outputs),
        ("parameter", parameters, links.parameters, fmu.parameters),
    )
    for what, names, linked, offered in wanted:
        for name in names:
            if name not in linked:
                problems.append(str(UnknownName(name, [*linked], what, _ABSENT)))
            elif linked[name] == Link(name):
                problems += _unit_problem(what, name, offered[name])
    if problems:
        raise SchemaError(f"FMU {fmu.path}", problems)


@cache
def _unit_problem(what: str, name: str, unit: str) -> tuple[str, ...]:
    """Compare the declared unit of a variable that no table converts with the canonical one: same
    quantity, same size.
    """
    try:
        expected = canonical_unit(name)
    except UnknownName:
        return ()
    try:
        same = not unit or parse_unit(unit) == parse_unit(expected)
    except UnitError as error:
        return (f"{what} {name}: {error}",)
    if same:
        return ()
    return (
        f"{what} {name} is in {unit!r}; needed is {expected!r}, write the FMU in SI or give "
        f"its unit in a table of names (--names)",
    )
