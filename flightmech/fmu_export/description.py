"""Variables of an FMU, in the terms of FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from flightmech.errors import SchemaError
from flightmech.simulation.kernel import (
    FIXED,
    INPUT,
    INTEGER,
    OUTPUT,
    PARAMETER,
    STATE,
    CatalogueEntry,
)

if TYPE_CHECKING:
    from flightmech.simulation.compiler import SimModel

# Value reference = base of the causality + index in the catalogue, as in kernel/shell/fmu.h.
BASE = {"input": 1000, "output": 10000, "state": 50000, "derivative": 60000, "parameter": 100000}
TIME = 0
REPLAY = {"replay.n": 70000, "replay.t": 70001, "replay.u": 70002, "replay.y": 70003}

# Values of the enumerations of the kernel, with the names that importers show.
CHOICES = {
    "mode.earth": {"flat": 0, "WGS84_rotating": 1, "sphere_at_rest": 2, "sphere_rotating": 3},
    "mode.engine": {
        "lever": 0,
        "N1": 1,
        "thrust": 2,
        "torque": 3,
        "rpm": 4,
        "manifold_pressure": 5,
    },
    "mode.controls": {"surfaces": 0, "cockpit_positions": 1, "pilot_forces": 2},
    "mode.rates": {"inertial": 0, "relative_to_Earth": 1},
    "mode.trim": {"none": 0, "trim_thrust": 1, "trim_throttle": 2, "stand_on_ground": 3},
    "turbulence.mode": {"none": 0, "Dryden": 1},
    "runway.condition": {"dry": 0, "wet": 1, "icy": 2},
}

# Typical sizes by unit, for the tolerances of an importer's solver, as in kernel/shell/exchange.c.
NOMINAL = {"m": 1000.0, "m s-1": 100.0, "rad s-1": 0.1, "rad": 0.1, "N": 1e4, "kg": 1000.0}

# States 0 ... 12 of every model, in the order of kernel.h.
_POSITION, _VELOCITY, _ATTITUDE, _RATES = range(3), range(3, 6), range(6, 10), range(10, 13)

# Outputs that depend on the kinematics alone, whatever the submodels are: their states.
_KINEMATIC = {
    **dict.fromkeys(("lat", "lon", "h", "rho", "p_static", "temperature"), (*_POSITION,)),
    **dict.fromkeys(("vn", "ve", "vd", "hdot", "gamma"), (*_POSITION, *_VELOCITY)),
    **dict.fromkeys(("phi", "theta", "psi"), (*_POSITION, *_ATTITUDE)),
    **dict.fromkeys(("p", "q", "r"), (*_RATES,)),
}

_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True)
class FmuVariable:
    """One scalar of the interface.

    Attributes
    ----------
    causality : str
        ``input``, ``output``, ``parameter``, or ``state`` and ``derivative``, which are local
        variables in the standards.
    reference : int
        Value reference.
    start, low, high, nominal : float or None
        Start value of inputs and parameters, limits and typical size; None if there is none.
        [units]
    fixed : bool
        Whether a parameter acts at initialisation only.
    integer : bool
        Whether the values are integers, as those of an enumeration.
    state : int or None
        Reference of the state, for a derivative.
    dependencies : tuple of int or None
        References of the states and inputs that an output or derivative depends on. None means all
        of them.
    """

    name: str
    causality: str
    reference: int
    units: str
    display_units: str
    description: str
    start: float | None = None
    low: float | None = None
    high: float | None = None
    fixed: bool = False
    integer: bool = False
    nominal: float | None = None
    state: int | None = None
    dependencies: tuple[int, ...] | None = None

    @property
    def variability(self) -> str:
        """FMI term for when the value may change."""
        if self.causality == "parameter":
            return "fixed" if self.fixed else "tunable"
        return "continuous"


@dataclass(frozen=True)
class Description:
    """Contents of a model description.

    `token` is the hash of ``resources/model.bin``, `step` the default step of the model [s].
    """

    title: str
    identifier: str
    token: str
    tool: str
    step: float
    variables: tuple[FmuVariable, ...]

    def __post_init__(self) -> None:
        problems = []
        for variable in self.variables:
            # the name of a derivative, der(...), is made from that of its state
            if variable.causality == "derivative" or _STRUCTURED.fullmatch(variable.name):
                continue
            problems.append(
                f"{variable.name!r} is not an FMI variable name: letters, digits and underscores, "
                f"parts joined by dots; rename the term"
            )
        if problems:
            raise SchemaError("model description", problems)

    def of(self, causality: str) -> list[FmuVariable]:
        """Return the variables of one causality, in the order of the kernel."""
        return [v for v in self.variables if v.causality == causality]


def describe_model(sim: SimModel, token: str, tool: str) -> Description:
    """Return the interface of a model: all inputs, outputs, parameters and states."""
    parameters = sim.entries(PARAMETER)
    step = next(row.value for row in parameters if row.name == "mode.step")
    rows = {"input": sim.entries(INPUT), "output": sim.entries(OUTPUT), "parameter": parameters}
    variables = []
    for causality, entries in rows.items():
        for index, entry in enumerate(entries):
            variables.append(_make_variable(causality, index, entry))
    variables += _make_states(sim.entries(STATE))
    return Description(
        title=sim.title,
        identifier=to_c_identifier(sim.title),
        token=token,
        tool=tool,
        step=step,
        variables=tuple(variables),
    )


def to_c_identifier(title: str) -> str:
    """Return a title as a C identifier, the file name of the libraries.

    Examples
    --------
    >>> to_c_identifier("T-37B (final)")
    'T_37B_final'
    """
    name = re.sub(r"\W+", "_", title, flags=re.ASCII).strip("_")
    return name if name[:1].isalpha() else f"model_{name}".rstrip("_")


def rate_units(units: str) -> str:
    """Return the unit of a rate of change.

    Examples
    --------
    >>> rate_units("m s-1"), rate_units("N"), rate_units("1")
    ('m s-2', 'N s-1', 's-1')
    """
    head, seconds, power = units.partition("s-")
    if seconds and power.isdigit():
        return f"{head}s-{int(power) + 1}"
    return "s-1" if units == "1" else f"{units} s-1"


def _make_variable(causality: str, index: int, row: CatalogueEntry) -> FmuVariable:
    """Return the variable of a row of the catalogue."""
    variable = FmuVariable(
        name=row.name,
        causality=causality,
        reference=BASE[causality] + index,
        units=row.units,
        display_units=row.display_units,
        description=row.description,
        start=row.value,
        low=_to_limit(row.low),
        high=_to_limit(row.high),
        fixed=bool(row.flags & FIXED),
        integer=bool(row.flags & INTEGER),
        nominal=NOMINAL.get(row.units),
    )
    if causality == "output":
        dependencies = _to_references(_KINEMATIC.get(row.name))
        return replace(variable, start=None, dependencies=dependencies)
    if causality == "parameter":
        return replace(variable, nominal=None)
    return variable


def _to_limit(value: float) -> float | None:
    """Return a limit of the catalogue; the largest float of the kernel means no limit."""
    return None if abs(value) >= sys.float_info.max else value


def _make_states(rows: Sequence[CatalogueEntry]) -> list[FmuVariable]:
    """Return the states, then their derivatives in the same order."""
    states, derivatives = [], []
    for i, row in enumerate(rows):
        # A state may have the name of an output. The prefix makes the names different.
        name = f"state.{row.name.removeprefix('state.')}"
        state = replace(_make_variable("state", i, row), name=name, start=None)
        states.append(state)
        units = rate_units(row.units)
        derivatives.append(
            FmuVariable(
                name=f"der({name})",
                causality="derivative",
                reference=BASE["derivative"] + i,
                units=units,
                display_units=units,
                description=f"time derivative of {row.description}",
                state=state.reference,
                dependencies=_to_references(_rate_dependencies(i)),
            )
        )
    return [*states, *derivatives]


def _rate_dependencies(state: int) -> tuple[int, ...] | None:
    """Return the states that the rate of a state depends on; None means all of them."""
    # Position and attitude follow from the kinematics. Submodels act on all other rates.
    if state in _POSITION:
        return (_VELOCITY[state],)
    if state in _ATTITUDE:
        return (*_ATTITUDE, *_RATES)
    return None


def _to_references(states: tuple[int, ...] | None) -> tuple[int, ...] | None:
    if states is None:
        return None
    return tuple(BASE["state"] + state for state in states)
