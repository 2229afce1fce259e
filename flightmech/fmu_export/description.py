"""What an FMU describes of a model: its variables, as both standards see them."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
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

# value references: base of the kind + index in the catalogue, as in kernel/shell/fmu.h
BASE = {"input": 1000, "output": 10000, "state": 50000, "derivative": 60000, "parameter": 100000}
TIME = 0
REPLAY = {"replay.n": 70000, "replay.t": 70001, "replay.u": 70002, "replay.y": 70003}

# the values that an enumeration of the kernel can take; names as importers show them
CHOICES = {
    "mode.earth": {"flat": 0, "WGS84_rotating": 1, "sphere_at_rest": 2, "sphere_rotating": 3},
    "mode.engine": {"lever": 0, "N1": 1, "thrust": 2},
    "mode.controls": {"surfaces": 0, "cockpit_positions": 1, "pilot_forces": 2},
    "mode.rates": {"inertial": 0, "relative_to_Earth": 1},
    "mode.trim": {"none": 0, "trim_thrust": 1, "trim_throttle": 2, "stand_on_ground": 3},
    "turbulence.mode": {"none": 0, "Dryden": 1},
    "runway.condition": {"dry": 0, "wet": 1, "icy": 2},
}

# typical sizes by unit, for the tolerances of an importer's solver, as in kernel/shell/exchange.c
NOMINAL = {"m": 1000.0, "m s-1": 100.0, "rad s-1": 0.1, "rad": 0.1, "N": 1e4, "kg": 1000.0}

# states 0 ... 12 of every model, in the order of kernel.h
_POSITION, _VELOCITY, _ATTITUDE, _RATES = range(3), range(3, 6), range(6, 10), range(10, 13)

# what the kinematics alone fix, no submodel can change it: output to the states it depends on
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
        ``input``, ``output``, ``parameter``, or ``state`` and ``derivative``, which the standards
        call local.
    reference : int
        Value reference.
    start, low, high, nominal : float or None
        Start value of inputs and parameters; limits and typical size where there are any. [units]
    fixed : bool
        A parameter that acts at initialisation only.
    integer : bool
        An enumeration, or a whole number.
    state : int or None
        Of a derivative: the reference of its state.
    dependencies : tuple of int or None
        References of the states and inputs that an output or derivative depends on; None: on all of
        them.
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
    """What both standards describe of a model; `token` ties the description to
    ``resources/model.bin``.
    """

    title: str
    identifier: str
    token: str
    tool: str
    step: float
    variables: tuple[FmuVariable, ...]

    def __post_init__(self) -> None:
        bad = [
            v.name
            for v in self.variables
            if v.causality != "derivative" and not _STRUCTURED.fullmatch(v.name)
        ]
        if bad:
            hint = "letters, digits and underscores, parts joined by dots; rename the term"
            raise SchemaError(
                "model description", [f"{name!r} is no FMI variable name: {hint}" for name in bad]
            )

    def of(self, causality: str) -> list[FmuVariable]:
        """Return the variables of one causality, in the order of the kernel."""
        return [v for v in self.variables if v.causality == causality]


def describe_model(sim: SimModel, token: str, tool: str) -> Description:
    """Return the interface of a model: all inputs, outputs, parameters and states of its catalogue."""
    parameters = sim.entries(PARAMETER)
    step = next(row.value for row in parameters if row.name == "mode.step")
    variables = (
        *(_scalar("input", i, row) for i, row in enumerate(sim.entries(INPUT))),
        *(_scalar("output", i, row) for i, row in enumerate(sim.entries(OUTPUT))),
        *(_scalar("parameter", i, row) for i, row in enumerate(parameters)),
        *_states(sim.entries(STATE)),
    )
    return Description(sim.title, to_c_identifier(sim.title), token, tool, step, variables)


def to_c_identifier(title: str) -> str:
    """Return a title as a C identifier, the file name of the libraries.

    Examples
    --------
    >>> identifier("T-37B (final)")
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


def _scalar(causality: str, index: int, row: CatalogueEntry) -> FmuVariable:
    low, high = (
        None if abs(limit) >= sys.float_info.max else limit for limit in (row.low, row.high)
    )
    return FmuVariable(
        row.name,
        causality,
        BASE[causality] + index,
        row.units,
        row.display_units,
        row.description,
        None if causality == "output" else row.value,
        low,
        high,
        bool(row.flags & FIXED),
        bool(row.flags & INTEGER),
        None if causality == "parameter" else NOMINAL.get(row.units),
        dependencies=_references(_KINEMATIC.get(row.name)) if causality == "output" else None,
    )


def _states(rows: Sequence[CatalogueEntry]) -> Iterator[FmuVariable]:
    names = [
        f"state.{row.name.removeprefix('state.')}" for row in rows
    ]  # a state may be called like an output
    for i, row in enumerate(rows):
        yield replace(_scalar("state", i, row), name=names[i], start=None)
    for i, row in enumerate(rows):
        units, text = rate_units(row.units), f"time derivative of {row.description}"
        reference, state = BASE["derivative"] + i, BASE["state"] + i
        yield FmuVariable(
            f"der({names[i]})",
            "derivative",
            reference,
            units,
            units,
            text,
            state=state,
            dependencies=_references(_rate_of(i)),
        )


def _rate_of(state: int) -> tuple[int, ...] | None:
    if state in _POSITION:
        return (_VELOCITY[state],)
    return (*_ATTITUDE, *_RATES) if state in _ATTITUDE else None


def _references(states: tuple[int, ...] | None) -> tuple[int, ...] | None:
    return None if states is None else tuple(BASE["state"] + i for i in states)
