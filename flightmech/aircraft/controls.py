"""Control circuits: column, wheel and pedals with their masses, cables, springs and friction.

They are the sections ``[circuit.*]`` of the aircraft file::

    [control.delta_e]                    # hinge geometry and gearing, flightmech.aircraft.aircraft
    S_hinge = 1.5
    c_hinge = 0.35
    gearing = "-1.2 rad/m"
    [circuit.column]
    order = 4
    stops = ["-15 cm", "20 cm"]
    mass = 6.0
    inertia = 1.1
    cable_stiffness = "12e3 N/m"
    friction = "20 N"
    stiction = "5 N"

The travel of column and pedals is in m with forces in N. The travel of the wheel is in rad with
moments in N m. The model is that of [LR743] 3.4 and 4.5.3. Equations, signs and assumptions are in
docs/explanation/simulation/control-system.md and ``kernel/src/controls``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, NamedTuple

from pydantic import Field, create_model

from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits

CONTROLS = (
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "delta_f",
    "delta_s",
    "delta_d",
    "gear",
    "speedbrake",
    "throttle",
)
DEVICE = "device."
"""Prefix of a control that only the tables of a database use, ``device.body_flap.deflection``."""
ICE = "device.ice.setting"
"""Setting of the ice of a database with differences by ice: 0 clean, 1 that ice."""

# by control: cockpit control that moves it, and unit of its gearing
TRAVEL = {
    "delta_e": ("column", "m-1"),
    "delta_a": ("wheel", "1"),
    "delta_r": ("pedal", "m-1"),
}


@dataclass(frozen=True)
class ControlGeometry:
    """Hinge geometry of a control, for the hinge moment H = qbar S_hinge c_hinge Ch.

    The moment is positive in the sense of a positive deflection.

    Parameters
    ----------
    S_hinge : float
        Area behind the hinge line of all surfaces that the control moves together. [m2]
    c_hinge : float
        Mean chord behind the hinge line. [m]
    gearing : float, optional
        Deflection per travel of column, wheel or pedal. It is negative in an ordinary aeroplane,
        where aft column raises the elevator. The pilot force that balances the hinge moment is
        F = -gearing H. [rad m-1 for elevator and rudder, rad per rad of the wheel for the ailerons]
    """

    S_hinge: float
    c_hinge: float
    gearing: float | None = None


# largest double, the bound of a limit that does not act
MOST = sys.float_info.max
# by cockpit control: control that it moves, in the order of the blocks of the kernel
MOVES = {
    "column": "delta_e",
    "wheel": "delta_a",
    "pedal": "delta_r",
}
ORDERS = {"column": (2, 4), "wheel": (2, 4, 6), "pedal": (2, 4)}
# travel of a surface that has no limits [rad]
RIGHT_ANGLE = math.pi / 2.0
# [s]
_LONGEST_STEP = 1e-3
# Phase of the fastest mode in a sub-step. The relative error of its frequency is below
# _PHASE^2 / 12. [rad]
_PHASE = 0.2


@dataclass(frozen=True)
class Circuit:
    """One control circuit, [N] and [m] for column and pedals, [N m] and [rad] for the wheel.

    Parameters
    ----------
    stops : tuple of float (2,)
        Travel between the stops in the cockpit, aft, right and right foot positive. [m or rad]
    mass : float
        Moving mass in the cockpit, reduced to the travel. [kg or kg m2]
    order : int
        2: one rigid circuit. 4: cockpit and surface are two masses on a cable. 6, wheel only: each
        aileron has its own cable.
    inertia : float
        Moment of inertia of the surface about its hinge, of both ailerons together. [kg m2]
    damping, hinge_damping : float
        Viscous friction in the cockpit and at the hinge. [N s m-1 or N m s; N m s]
    stiffness, neutral, neutral_trim : float
        Centring spring, travel at which its force is zero, and change of this travel per deflection
        of the trim input ``delta_t``, ``delta_ta`` or ``delta_tr`` (a spring trim). [N m-1 or N m;
        m or rad; m rad-1 or 1]
    preload : float
        Force of the spring just outside its neutral. [N or N m]
    friction, stiction : float
        Coulomb friction in the cockpit, and additional friction at rest. [N or N m]
    hinge_friction : float
        Coulomb friction at the hinge, of both ailerons together. [N m]
    restitution : float
        Speed after over speed before a stop. [1]
    cable_stiffness, cable_damping : float
        Cable between cockpit and surface, reduced to the travel. With order 6 it is the cable to
        each aileron. [N m-1 or N m; N s m-1 or N m s]
    gearing_slope : float
        Change of the gearing per travel, for ailerons the differential. [rad m-2 or rad rad-2]
    rigging : float
        Deflection at zero travel, for ailerons of both downwards. [rad]
    bob_weight : float
        Force per specific force at the c.g. An upward specific force pushes the column forward. A
        specific force to the right pushes wheel and pedals to the left. [kg or kg m]
    unbalance : float
        Mass of the surface times distance of its centre behind the hinge, of both ailerons
        together. [kg m]
    arm : float
        Position of the hinge of elevator or rudder forward of the moment reference point, which is
        negative. For ailerons: distance from the plane of symmetry. [m]
    tab_left, tab_right : float
        Fraction of ``delta_ta`` on the tab of each aileron, for the wheel only. [1]
    nose_spring : float
        Spring between the cockpit control and a steered wheel that is on the ground. Steering that
        follows the rudder (``steering.rudder``) has a separate spring. [N m-1 or N m]
    trim_limit : float
        Largest force that is added at the start of a run with recorded forces. [N or N m]
    trim_friction : float
        Fraction of the dry friction that holds the control at the start of such a run before a
        force is added. At 0 the start is in the middle of the friction band. [1]
    step : float, optional
        Sub-step. The default is 1 ms, or less if the fastest mode requires it. [s]
    """

    stops: tuple[float, float]
    mass: float
    order: int = 2
    inertia: float = 0.0
    damping: float = 0.0
    hinge_damping: float = 0.0
    stiffness: float = 0.0
    neutral: float = 0.0
    neutral_trim: float = 0.0
    preload: float = 0.0
    friction: float = 0.0
    stiction: float = 0.0
    hinge_friction: float = 0.0
    restitution: float = 0.0
    cable_stiffness: float = 0.0
    cable_damping: float = 0.0
    gearing_slope: float = 0.0
    rigging: float = 0.0
    bob_weight: float = 0.0
    unbalance: float = 0.0
    arm: float = 0.0
    tab_left: float = 0.0
    tab_right: float = 1.0
    nose_spring: float = 0.0
    trim_limit: float = MOST
    trim_friction: float = 0.0
    step: float | None = None

    def sub_step(self, gearing: float) -> float:
        """Return the sub-step for a gearing of the surface. [s]

        It is `step`, if defined. Otherwise it is 1 ms, or 0.2 rad of the fastest mode if this is
        shorter.
        """
        if self.step is not None:
            return self.step
        # inertia of the surface, reduced to the travel
        reduced = self.inertia * gearing**2
        # bound of the square of the highest natural frequency
        omega_2 = self.stiffness / self.mass
        if self.order > 2:
            cables = self.order // 2 - 1
            omega_2 += self.cable_stiffness * cables * (1.0 / self.mass + 1.0 / reduced)
        if omega_2 <= 0.0:
            return _LONGEST_STEP
        return min(_LONGEST_STEP, _PHASE / math.sqrt(omega_2))


class _Constant(NamedTuple):
    """Description of one constant of a circuit.

    `linear` is its unit for a travel in m, `rotary` for a travel in rad. The examples are in the
    same order.
    """

    linear: str
    rotary: str
    least: float
    text: str
    examples: tuple[float | str, float | str]


_CONSTANTS = {
    "mass": _Constant(
        "kg", "kg m2", 0.0, "mass in the cockpit, reduced to the travel", ("6 kg", 0.4)
    ),
    "inertia": _Constant(
        "kg m2", "kg m2", 0.0, "inertia of the surface about its hinge", (1.1, 1.1)
    ),
    "damping": _Constant("N s m-1", "N m s", 0.0, "viscous friction in the cockpit", (20.0, 1.5)),
    "hinge_damping": _Constant("N m s", "N m s", 0.0, "viscous friction at the hinge", (2.0, 2.0)),
    "stiffness": _Constant("N m-1", "N m", 0.0, "centring spring", ("400 N/m", 8.0)),
    "neutral": _Constant(
        "m", "rad", -MOST, "travel at which the centring spring is free", ("2 cm", "1 deg")
    ),
    "neutral_trim": _Constant(
        "m", "1", -MOST, "neutral travel per deflection of the trim input", (0.1, 0.5)
    ),
    "preload": _Constant(
        "N", "N m", 0.0, "force with which the centring spring leaves neutral", ("10 N", 1.0)
    ),
    "friction": _Constant("N", "N m", 0.0, "Coulomb friction in the cockpit", ("20 N", 1.5)),
    "stiction": _Constant(
        "N", "N m", 0.0, "friction at rest beyond the Coulomb friction", ("5 N", 0.5)
    ),
    "hinge_friction": _Constant("N m", "N m", 0.0, "Coulomb friction at the hinge", (1.0, 1.0)),
    "restitution": _Constant("1", "1", 0.0, "speed after over speed before a stop", (0.2, 0.2)),
    "cable_stiffness": _Constant(
        "N m-1", "N m", 0.0, "stiffness of the cable, reduced to the travel", ("12e3 N/m", 600.0)
    ),
    "cable_damping": _Constant(
        "N s m-1", "N m s", 0.0, "damping of the cable, reduced to the travel", (30.0, 2.0)
    ),
    "gearing_slope": _Constant("m-2", "1", -MOST, "change of the gearing per travel", (0.3, 0.05)),
    "rigging": _Constant(
        "rad", "rad", -MOST, "deflection of the surface at zero travel", ("0.5 deg", "1 deg")
    ),
    "bob_weight": _Constant(
        "kg", "kg m", -MOST, "force of the bob weight per specific force", ("1.5 kg", 0.2)
    ),
    "unbalance": _Constant(
        "kg m", "kg m", -MOST, "static unbalance of the surface, positive tail-heavy", (0.4, 0.4)
    ),
    "arm": _Constant(
        "m",
        "m",
        -MOST,
        "hinge of elevator and rudder forward of the reference point; ailerons from the "
        "plane of symmetry",
        ("-4.2 m", "3.4 m"),
    ),
    "tab_left": _Constant("1", "1", -MOST, "part of delta_ta on the left aileron", (0.0, -1.0)),
    "tab_right": _Constant("1", "1", -MOST, "part of delta_ta on the right aileron", (1.0, 1.0)),
    "nose_spring": _Constant(
        "N m-1",
        "N m",
        0.0,
        "spring of the cockpit's end to a steered wheel on the ground",
        (2000.0, 100.0),
    ),
    "trim_limit": _Constant(
        "N", "N m", 0.0, "largest force that the start of a run may add", ("20 N", 2.0)
    ),
    "trim_friction": _Constant(
        "1",
        "1",
        0.0,
        "share of dry friction that holds the control at the start before a force is added",
        (0.5, 0.5),
    ),
}


def _units(item: str, constant: _Constant) -> str:
    return constant.rotary if item == "wheel" else constant.linear


_Angles = tuple[Annotated[float, InUnits("rad")], Annotated[float, InUnits("rad")]]
_Lengths = tuple[Annotated[float, InUnits("m")], Annotated[float, InUnits("m")]]


class _CircuitTable(Strict):
    """Common base of the tables of circuits. `circuit_table` adds the constants."""

    order: int = Field(
        default=2,
        description="2: all moves together; 4: cockpit and surface are two masses on a cable; 6, "
        "wheel only: a cable each.",
    )


def circuit_table(item: str) -> type[Strict]:
    """Return the model of ``[circuit.<item>]``, with the units of this circuit."""
    defaults: dict[str, Any] = {field.name: field.default for field in fields(Circuit)}
    # the only constant that must be given
    defaults["mass"] = ...
    columns: dict[str, Any] = {}
    for name, constant in _CONSTANTS.items():
        definition = Field(
            defaults[name],
            description=_sentence(constant.text),
            examples=[constant.examples[item == "wheel"]],
        )
        columns[name] = Annotated[float, InUnits(_units(item, constant))], definition
    stops = Field(
        description="Travel between the stops in the cockpit, aft, right and right foot positive."
    )
    step = Field(
        default=None,
        examples=["0.5 ms"],
        description="Sub-step of the simulation; without it at most 1 ms, by the fastest mode.",
    )
    travel: Any = _Angles if item == "wheel" else _Lengths
    columns |= {"stops": (travel, stops), "step": (Annotated[float, InUnits("s")] | None, step)}
    return create_model(f"{item.capitalize()}Table", __base__=_CircuitTable, **columns)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _circuits_table() -> type[Strict]:
    """Return the model of ``[circuit]``, which has a different model for each item."""
    items: dict[str, Any] = {}
    for item, control in MOVES.items():
        text = f"What moves with the {item}, needs [control.{control}]."
        items[item] = circuit_table(item) | None, Field(None, description=text)
    return create_model("CircuitsTable", __base__=Strict, **items)


CircuitsTable: Any = _circuits_table()


def circuits_of(
    tables: Strict, controls: Mapping[str, ControlGeometry], problems: list[str]
) -> dict[str, Circuit]:
    """Return the circuits of an aircraft file, in the order of `MOVES`.

    Their problems are appended to `problems`.
    """
    circuits = {item: Circuit(**dict(table)) for item, table in tables if table is not None}
    for item, circuit in circuits.items():
        texts = check_circuit(item, circuit, controls.get(MOVES[item]))
        problems += [f"circuit.{item}: {text}" for text in texts]
    return circuits


def check_circuit(item: str, circuit: Circuit, control: ControlGeometry | None) -> list[str]:
    """Return all faults of a circuit as texts.

    Parameters
    ----------
    item : {"column", "wheel", "pedal"}
        Name of the circuit.
    circuit : Circuit
    control : ControlGeometry or None
        Hinge geometry of the surface that the circuit moves.
    """
    problems = []
    if control is None or control.gearing is None:
        problems.append(
            f"[control.{MOVES[item]}] with a gearing is missing; give S_hinge, c_hinge and gearing"
        )
    if circuit.order not in ORDERS[item]:
        problems.append(f"order is {circuit.order}; allowed: {', '.join(map(str, ORDERS[item]))}")
    for name, constant in _CONSTANTS.items():
        value = getattr(circuit, name)
        if not math.isfinite(value) or value < constant.least:
            # the least value is 0, or -MOST for a constant of either sign
            allowed = "finite" if constant.least else "zero or positive"
            problems.append(f"{name} is {value:g}; it must be {allowed}")
    if not circuit.mass > 0.0:
        problems.append(f"mass is {circuit.mass:g}; it must be positive")
    if circuit.restitution > 1.0:
        problems.append(f"restitution is {circuit.restitution:g}; a stop gives at most 1 back")
    if not -math.inf < circuit.stops[0] < circuit.stops[1] < math.inf:
        problems.append(
            f"stops are {circuit.stops[0]:g} and {circuit.stops[1]:g}; the first must lie "
            f"below the second"
        )
    if circuit.trim_friction > 1.0:
        problems.append(
            f"trim_friction is {circuit.trim_friction:g}; it is a share of the friction, at most 1"
        )
    if circuit.order > 2:
        for name in ("inertia", "cable_stiffness"):
            if not getattr(circuit, name) > 0.0:
                problems.append(f"{name} is 0; order {circuit.order} needs it")
    if circuit.step is not None and not 1e-6 <= circuit.step <= 1.0:
        problems.append(f"step is {circuit.step:g} s; allowed: 1e-6 ... 1 s")
    return problems
