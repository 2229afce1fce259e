"""Constants of shaft, governor and lever of a propeller engine from chops and slams.

The unknowns are fitted by output error on the engine model of the kernel: one engine in an
aeroplane too heavy to move, whose lift carries the weight at every airspeed (see `bench`).  Each
unknown multiplies its a-priori value and has an a-priori standard error, so a constant that the
power changes do not show keeps its value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine, list_leaves
from flightmech.errors import IdentificationError
from flightmech.quantities import time_text
from flightmech.short_text import ShortText
from flightmech.terms import PowerFactor, make_term
from flightmech.units import G0
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.remarks import Remark
from flighttest.submodels.engine import bench
from flighttest.submodels.engine.records import moving_ranges
from flighttest.submodels.engine.schedule import SAME, find_lever_rest, remove_lever_noise

# Outputs that are fitted where they are recorded.
OUTPUTS = ("rpm", "manifold_pressure", "torque", "n1")
# A-priori standard error of the factor of a constant.
_CONSTANTS = {
    "inertia": 0.5,
    "governor_gain": 0.7,
    "governor_time": 0.7,
    "pitch_rate": 0.5,
    "rpm_high": 0.02,
    "rpm_low": 0.02,
    "power_time": 0.7,
    "map_time": 0.7,
    "intake_impedance": 0.7,
    "throttle_impedance": 0.7,
    "lever_delay": 0.7,
}
# A-priori standard error of the factor of a table. The level of power absorbs a difference of the
# steady states, so that the time constants do not.
_TABLES = {
    "n1_up_time": 0.7,
    "n1_down_time": 0.7,
    "n1_command": 0.03,
    "corrected_n1_command": 0.03,
    "power": 0.05,
    "corrected_power": 0.05,
    "shaft_power": 0.05,
    "corrected_shaft_power": 0.05,
}
# Names of the levels, which are not written: the points of steady power determine them.
_LEVELS = ("power", "corrected_power", "shaft_power", "corrected_shaft_power")
# Bounds of a factor.
_LOW, _HIGH = 0.05, 20.0
# Time at rest between two power changes, before and after one [s]; least range of the lever.
_REST, _BEFORE, _AFTER, _LEAST = 2.0, 1.0, 6.0, 0.2
# Part of an a-priori standard error up to which the records determine a constant.
_DETERMINED = 0.9
# Range of the angle of attack of the carrier [rad] and its nodes.
_ANGLES = np.linspace(-0.6, 0.6, 241)


@dataclass(frozen=True)
class ShaftDynamics(ShortText):
    """Identified constants of shaft, governor and lever.

    Attributes
    ----------
    values : dict of str to (value, standard error)
        Constants in SI units, and factors of tables. A value that the records do not show has the
        a-priori standard error.
    determined : dict of str to bool
        Whether the records determine a value.
    search : OutputError
        Fit with residuals.
    first : mapping of str to float
        The a-priori values: constants of the aircraft file in SI units, and 1 for factors.
    """

    values: dict[str, tuple[float, float]]
    determined: dict[str, bool]
    search: OutputError
    first: Mapping[str, float] = field(default_factory=dict)

    def constants(self) -> dict[str, float]:
        """Return the constants that the records determine, by name. [SI]"""
        return {
            name: pair[0]
            for name, pair in self.values.items()
            if name in _CONSTANTS and self.determined[name]
        }

    @property
    def remarks(self) -> list[Remark]:
        """Errors of the search."""
        return [remark for remark in self.search.remarks if remark.kind in ("convergence", "bound")]

    def report_lines(self) -> list[str]:
        """Return the values with their standard errors."""
        lines = [f"{'shaft, governor and lever':<34}{'estimate':>11}{'std. error':>12}"]
        for name, (value, stderr) in self.values.items():
            title = name if name in _CONSTANTS else f"factor of {name}"
            lines.append(f"{title:<34}{value:>11.4g}{stderr:>12.2g}{self.note_of(name)}")
        return lines + bench.search_lines(self.search)[1:]

    def note_of(self, name: str) -> str:
        """Return the words behind a value that the records do not determine, else nothing."""
        if self.determined[name]:
            return ""
        # the search ended at a bound, which has no standard error
        if not self.values[name][1] > 0.0 and name in self.first:
            return f"   at its bound and not used: {self.first[name]:.4g} of the file stays"
        return "   as a priori"

    def report(self) -> str:
        """Return the values as text."""
        return "\n".join(self.report_lines())

    def as_dict(self) -> dict:
        """Return the numbers for JSON."""
        return {
            name: {"value": pair[0], "stderr": pair[1], "determined": self.determined[name]}
            for name, pair in self.values.items()
        }


def shaft_changes(record: xr.Dataset, least: float = _LEAST) -> list[xr.Dataset]:
    """Return the power changes of a flight, each with the lever at rest before and after.

    Parameters
    ----------
    record : Dataset (time,)
        ``throttle`` on a uniform clock, as `engine_channels` returns it.
    least : float
        Smallest range of the throttle.

    Raises
    ------
    IdentificationError
        ``throttle`` is missing.
    """
    if "throttle" not in record:
        raise IdentificationError("power changes are found by the lever; map engineN.throttle")
    time = record["time"].values
    step = float(np.median(np.diff(time)))
    before, after = (round(x / step) for x in (_BEFORE, _AFTER))
    changes = []
    still = find_lever_rest(record, _REST, SAME)
    for begin, end in moving_ranges(still, before + after):
        if begin < before:
            continue
        part = record.isel(time=slice(begin - before, min(end + after, len(time))))
        if np.ptp(part["throttle"].values) < least:
            continue
        name = (
            f"{record.attrs.get('record', 'record')} from {time_text(float(part['time'][0]), 4)} s"
        )
        changes.append(part.assign_attrs(record=name))
    return changes


def identify_shaft(records: Sequence[xr.Dataset], aircraft: Aircraft) -> ShaftDynamics:
    """Identify the constants of shaft, governor and lever by output error on the kernel.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        Power changes that begin at rest, as `engine_channels` returns them, on a uniform clock:
        ``throttle``; ``rpm`` [rad/s] and what exists of ``manifold_pressure`` [Pa], ``torque``
        [N m], ``n1`` [1]; ``prop_command`` and ``mixture`` where they move; ``mach``, ``h`` [m],
        ``temperature`` [K].
    aircraft : Aircraft
        Its first engine has the tables, best those corrected from steady points, and the a-priori
        constants.

    Returns
    -------
    ShaftDynamics

    Raises
    ------
    IdentificationError
        The lever does not move, or the speed of the propeller is missing.
    """
    engine = aircraft.engines[0]
    records = [remove_lever_noise(record) for record in records]
    if not any(np.ptp(record["throttle"].values) >= _LEAST for record in records):
        raise IdentificationError(
            f"the lever moves by less than {_LEAST:g} in all power changes; add chops and slams"
        )
    outputs = _common_outputs(engine, records)
    names = _unknown_names(engine, records)
    unknowns = {
        name: Unknown(1.0, (_CONSTANTS | _TABLES)[name], low=_LOW, high=_HIGH) for name in names
    }
    first = {name: _first_value(engine, name) for name in names}

    def parameters(theta: np.ndarray) -> dict[str, float]:
        values = {}
        for name, factor in zip(names, theta):
            if name in _TABLES:
                values[f"term.engine1.{name}"] = float(factor)
            else:
                values[f"engine1.{name}"] = float(factor * first[name])
        return values

    search = bench.fit_engine(
        compile_shaft(engine), records, unknowns=unknowns, expand=parameters, outputs=outputs
    )
    theta, C = bench.theta_and_covariance(search)
    errors = np.sqrt(np.diag(C))
    values, determined = {}, {}
    for name, factor, error in zip(names, theta, errors):
        size = 1.0 if name in _TABLES else first[name]
        values[name] = float(factor * size), float(error * size)
        determined[name] = bool(0.0 < error < _DETERMINED * unknowns[name].sigma)
    return ShaftDynamics(values, determined, search, first)


def _common_outputs(engine: Engine, records: Sequence[xr.Dataset]) -> list[str]:
    """Return the outputs that all records have and the engine of the kernel gives."""
    outputs = []
    for name in OUTPUTS:
        if all(name in record for record in records):
            outputs.append(name)
    if "rpm" not in outputs:
        raise IdentificationError("the power changes lack engineN.rpm; map the tachometer")
    return [name for name in outputs if _is_output(name, engine)]


def _is_output(name: str, engine: Engine) -> bool:
    """Return whether the engine of the kernel has an output."""
    if name == "manifold_pressure":
        return engine.piston is not None
    return name != "n1" or engine.deck is not None


def _unknown_names(engine: Engine, records: Sequence[xr.Dataset]) -> list[str]:
    """Return the constants and tables that may change the response of an engine."""
    propeller, piston = engine.propeller, engine.piston
    names = ["inertia"]
    if propeller is not None and propeller.governed:
        names += ["governor_gain", "pitch_rate", "rpm_high"]
        if propeller.governor_time > 0.0:
            names.append("governor_time")
        moves = any(
            "prop_command" in one and np.ptp(one["prop_command"]) > _LEAST for one in records
        )
        if moves and propeller.rpm_low > 0.0:
            names.append("rpm_low")
    if propeller is not None and propeller.power_time > 0.0:
        names.append("power_time")
    if piston is not None and all("manifold_pressure" in record for record in records):
        names.append("map_time")
        if "map_ratio" not in piston.tables:
            names += [
                name
                for name in ("intake_impedance", "throttle_impedance")
                if getattr(piston, name) > 0.0
            ]
    if engine.deck is not None and engine.deck.lever_delay > 0.0:
        names.append("lever_delay")
    leaves = list_leaves(engine)
    return names + [name for name in _TABLES if name in leaves]


def _first_value(engine: Engine, name: str) -> float:
    for part in (engine.propeller, engine.piston, engine.deck):
        if part is not None and hasattr(part, name):
            return float(getattr(part, name))
    return 1.0


def compile_shaft(engine: Engine) -> flightmech.SimModel:
    """Return the kernel's model of one engine with a propeller in an aeroplane too heavy to move.

    Lift and drag carry the weight as a force along body z at every angle of attack and airspeed:
    CL = N cos(alpha) / qbar, CD = N sin(alpha) / qbar.
    """
    weight = bench.HEAVY * G0
    per_qbar = PowerFactor("qbar", -1.0, 1.0)
    tables: Mapping[str, xr.Dataset] = {
        "/CL/basic": make_term(weight * np.cos(_ANGLES), {"alpha": _ANGLES}, power=per_qbar),
        "/CD/basic": make_term(weight * np.sin(_ANGLES), {"alpha": _ANGLES}, power=per_qbar),
    }
    alone = Engine(
        (0.0, 0.0, 0.0),
        propeller=engine.propeller,
        piston=engine.piston,
        deck=engine.deck,
        motor=engine.motor,
    )
    mass = bench.HEAVY
    craft = flightmech.Aircraft(
        name="engine",
        S=1.0,
        cbar=1.0,
        b=1.0,
        mass=mass,
        Ixx=mass,
        Iyy=mass,
        Izz=mass,
        engines=(alone,),
    )
    return flightmech.compile(craft, xr.DataTree.from_dict(dict(tables)))
