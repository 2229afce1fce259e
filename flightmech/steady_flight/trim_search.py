"""Steady states of a compiled model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE, Simulation
from flightmech.simulation.run import constant_inputs, initialise_run, output_attributes
from flightmech.steady_flight.trim_request import CLIMB, ON_GROUND, Request, make_trim_request

# remainder of a residual that counts as zero [m s-2]: 0.001 ft/s2, as the trim of JSBSim (FGTrim)
# has it
_DONE = 3e-4
_BANKED = (
    "level",
    "climb",
    "pull_up",
)  # kinds in which a steady bank may balance what a control without effect leaves
_AT_LIMIT = 1e-9  # of the size of an unknown
_NO_EFFECT = 1e-8  # slope, of the largest one
_SAME = 1e-6  # singular value of the normalised slopes, of the largest one
_PART = 0.1  # of a direction without effect: a component that is named
_STATE = (
    "V",
    "alpha",
    "beta",
    "theta",
    "p",
    "q",
    "r",
)  # what a trim sets without being among its unknowns


@dataclass(frozen=True)
class TrimResult:
    """The request and what the kernel gave back.

    Parameters
    ----------
    request : Request
        The trim requested.
    found : array (unknown,)
        Values of the unknowns. [SI]
    rest : array (residual,)
        Outputs less their wanted values. [SI]
    left : array (residual,)
        The same weighed as accelerations. [m s-2]
    jacobian : array (residual, unknown)
        Slopes of `left` over one size of each unknown. [m s-2]
    """

    request: Request
    found: np.ndarray
    rest: np.ndarray
    left: np.ndarray
    jacobian: np.ndarray

    def variables(self, sim: SimModel, run: Simulation) -> dict[str, tuple]:
        """Return the variables of the result; `run` stands in the state that was found."""
        request = self.request
        units = {
            row.name: row.units
            for kind in (OUTPUT, STATE, INPUT, PARAMETER)
            for row in sim.entries(kind)
        } | {CLIMB: "m s-2"}
        _, low, high, _ = request.search
        start = self._start(sim, run)
        return {
            "unknown": ("unknown", list(request.unknowns)),
            "unknown_units": ("unknown", [units[items[0]] for items in request.movers]),
            "found": ("unknown", self.found),
            "low": ("unknown", low),
            "high": ("unknown", high),
            "limit": ("unknown", self._limits()),
            "residual": ("residual", list(request.residuals)),
            "residual_units": ("residual", [units[name] for name in request.outputs]),
            "wanted": ("residual", request.wanted),
            "left": ("residual", self.rest),
            "quantity": ("quantity", list(start)),
            "start": ("quantity", np.array(list(start.values()))),
        }

    def attributes(self) -> dict[str, str | int]:
        """Return the attributes of the result: the findings one by one, and as a text."""
        request, limits = self.request, self._limits()
        converged = bool(np.abs(self.left).max() <= _DONE)
        idle, alike, rank = self._rank()
        _, low, high, _ = request.search
        stops = [
            f"{name} at its {'upper' if side > 0 else 'lower'} limit {b if side > 0 else a:.6g}"
            for name, side, a, b in zip(request.unknowns, limits, low, high, strict=True)
            if side
        ]
        over = [
            f"{name} {rest:.3g}"
            for name, rest, part in zip(request.residuals, self.rest, self.left, strict=True)
            if abs(part) > _DONE
        ]
        parts = ["trimmed" if converged else "not trimmed", *stops]
        for text, names in (
            ("left over", over),
            ("without effect", idle),
            ("only together", alike),
        ):
            parts += [f"{text}: {', '.join(names)}"] if names else []
        return {
            "kind": request.kind,
            "converged": int(converged),
            "at_limit": " ".join(
                name for name, side in zip(request.unknowns, limits, strict=True) if side
            ),
            "without_effect": " ".join(idle),
            "alike": " ".join(alike),
            "rank": rank,
            "verdict": "; ".join(parts),
            "advice": self._advice(idle, converged),
        }

    def _advice(self, idle: list[str], converged: bool) -> str:
        """Return what to do about unknowns without effect; empty where there are none."""
        if not idle:
            return ""
        moved = f"{', '.join(idle)}: nothing in database and aircraft depends on it here"
        if converged:
            return f"{moved}; the flight is steady without it"
        add = f"{moved}; add a term that has it, such as Cn/rudder for delta_r"
        if self.request.kind not in _BANKED or "phi" in self.request.unknowns:
            return add
        others = [name for name in self.request.unknowns if name not in idle]
        return (
            f"{add}, or leave it out and free the bank: "
            f"{' '.join(f'--free {name}' for name in (*others, 'phi'))}"
        )

    def _limits(self) -> np.ndarray:
        _, low, high, size = self.request.search
        near = _AT_LIMIT * size
        return np.where(self.found <= low + near, -1, np.where(self.found >= high - near, 1, 0))

    def _start(self, sim: SimModel, run: Simulation) -> dict[str, float]:
        """Return parameters and inputs that start a simulation here; on the ground the kernel
        stands up once more, with the tyres.
        """
        request = self.request
        found = {
            item: self.found[k]
            for k, items in enumerate(request.movers)
            for item in items
            if item in sim.parameters + sim.inputs
        }
        if request.path == ON_GROUND:
            return {**request.values, **found, "mode.trim": 3.0}
        held = {
            f"init.{name}": run.parameter(sim.parameters.index(f"init.{name}")) for name in _STATE
        }
        return {**request.values, **found, **held}

    def _rank(self) -> tuple[list[str], list[str], int]:
        """Return the unknowns without effect, those whose effects are not independent, and the
        number of independent ones.
        """
        names = np.array(self.request.unknowns)
        norm = np.linalg.norm(self.jacobian, axis=0)
        works = norm > _NO_EFFECT * norm.max(initial=0.0)
        idle, active = _texts(names[~works]), names[works]
        if not len(active):
            return idle, [], 0
        _, sizes, directions = np.linalg.svd(self.jacobian[:, works] / norm[works])
        rank = int((sizes > _SAME * sizes[0]).sum())
        if rank == len(active) or len(active) > len(self.jacobian):
            return idle, [], rank
        return idle, _texts(active[(np.abs(directions[rank:]) > _PART).any(axis=0)]), rank


def _texts(names: Sequence[str] | np.ndarray) -> list[str]:
    return [str(name) for name in names]


def trim(
    sim: SimModel,
    parameters: Mapping[str, float] | None = None,
    kind: str | None = None,
    unknowns: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    residuals: Sequence[str] | None = None,
) -> xr.Dataset:
    """Trim to a steady flight, or to rest on the ground.

    Called with parameters alone it is the trim that every run starts with (``mode.trim``): ``init.V
    gamma phi psi h p q r psi_dot`` are held, ``phi`` within ``init.phi_range`` (zero); angle of
    attack, sideslip, elevator, aileron, rudder and power are unknown, controls and power as biases
    on the inputs, so that the accelerations take the values ``init.u_dot ... init.r_dot`` (zero).

    With any other argument the flight is described by plain names.  Unknown in every kind in the
    air: alpha, the three surfaces and power (throttle or thrust, by ``mode.engine``); the six
    accelerations vanish.

    ========== ============ =============================== ==============================================
    kind       unknowns     give one of                     remarks
    ========== ============ =============================== ==============================================
    level      beta                                         gamma, phi, psi_dot are 0; beta given: phi unknown;
                                                            power given: V unknown
    climb      beta         gamma, hdot, theta, power       power given: gamma unknown
    turn       beta psi_dot phi, psi_dot, nz                ay vanishes; beta given: ay does not;
                                                            psi_dot or nz given: phi unknown
    sideslip   phi          beta, delta_r, phi              delta_r or phi given: beta unknown
    pull_up    beta q       nz, q                           lowest point of a loop, gamma 0
    engine_out phi          engine1.failed = 1 ...          beta is 0; phi or delta_r given: beta unknown
    ground     h theta phi  V (0 is rest)                   of accelerations only those upward and in pitch and
               (alone)                                      roll vanish; u_dot given: power unknown; at rest all
                                                            vanish, and the deflections of the tyres
                                                            are unknown
    ========== ============ =============================== ==============================================

    With ``mode.controls`` 1 the travel of a control circuit is unknown in place of its surface,
    with 2 also the force that holds it (without friction).  A given ``F_column``, ``F_wheel`` or
    ``F_pedal`` makes the trim tab unknown.  On the ground V is the speed over the ground along the
    heading, and the brakes are inputs like others.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    parameters : mapping of str to float, optional
        Parameters and inputs: ``{"init.V": 90.0, "init.h": 1500.0, "delta_f": 0.6}``. [SI]
    kind : str, optional
        As in the table; ``level`` unless given.
    unknowns : sequence of str, optional
        Solved for instead of the unknowns of the kind: ``alpha beta gamma theta phi psi V h p q r
        psi_dot``, any input, any parameter, ``throttle`` or ``thrust`` of all engines alike.
    fixed : mapping of str to float, optional
        What is held: the same names; an acceleration ``u_dot ... r_dot``; any output (``nz hdot
        V_cas mach`` ...), which becomes a residual; ``engine1.failed`` 1 takes the thrust of an
        engine away.  What is given is no longer unknown, and its partner in the table is. [SI]
    residuals : sequence of str, optional
        What vanishes instead of what the kind demands: ``u_dot ... r_dot`` and any output.

    Returns
    -------
    Dataset
        All outputs in the trimmed state, without dimension: ``alpha``, ``theta``,
        ``applied.delta_e``; ``trim.u_dot ... trim.r_dot`` is the remaining accelerations.

        Unless called with parameters alone also: ``found low high`` over ``unknown``, with
        ``limit`` -1 or 1 at the lower or upper one; ``wanted left`` over ``residual``; ``start``
        over ``quantity``, for `start_of`.  Attributes: ``converged`` (1 or 0), ``at_limit``,
        ``without_effect`` (unknowns that change no residual), ``alike`` (unknowns that cannot be
        distinguished), ``rank``, ``verdict``, a text that states all this, and ``advice``, what to
        do about unknowns without effect.  A trim that does not come about is a result: the
        residuals are as small as the limits allow.

    Raises
    ------
    UnknownName
        A kind, parameter, input or quantity that the model does not have.
    SchemaError
        A request that contradicts itself: more residuals than unknowns, a quantity fixed and
        unknown, nothing given of what the kind needs.
    SimulationError
        A parameter has no meaning, e.g. no speed.

    Notes
    -----
    Body rates follow from the turn: p = -psi_dot sin(theta), q = psi_dot sin(phi) cos(theta), r = psi_dot cos(phi) cos(theta), plus,
    over a round Earth, the rate of the horizon.  In a climb u_dot = 0 holds the true airspeed, not the calibrated one.
    Unknowns in surplus are shared out by the smallest norm, angles in rad, throttle in parts of its travel.

    References
    ----------
    .. [Stevens] Stevens and Lewis, Aircraft Control and Simulation, 1992, section 3.4: rate-of-climb and turn-coordination constraints.
    """
    if kind is None and unknowns is None and fixed is None and residuals is None:
        return _result(sim, trimmed_outputs(sim, parameters or {}))
    problem = make_trim_request(
        sim, parameters or {}, kind or "level", unknowns, residuals, fixed or {}
    )
    run = initialise_run(sim, problem.values, constant_inputs(sim, problem.values))
    places = {
        row.name: (kind, i)
        for kind in (STATE, PARAMETER, INPUT)
        for i, row in enumerate(sim.entries(kind))
    }
    movers = [
        (*places[item], unknown) for unknown, items in enumerate(problem.movers) for item in items
    ]
    goals = [-1 if name == CLIMB else sim.outputs.index(name) for name in problem.outputs]
    found, y, left, jacobian = run.trim_for(
        problem.path, movers, problem.search, goals, problem.wanted
    )
    rest = np.where(np.array(goals) < 0, left, y[goals] - problem.wanted)
    search = TrimResult(problem, found, rest, left, jacobian)
    return _result(sim, y, search.variables(sim, run), search.attributes())


def start_of(trimmed: xr.Dataset) -> dict[str, float]:
    """Return the parameters and inputs with which a simulation starts in a trimmed state.

    Parameters
    ----------
    trimmed : Dataset
        As from `trim` with a kind.

    Returns
    -------
    dict of str to float
        For the `parameters` of `simulate`, `linearize` or an FMU: what the trim was given, what it
        found, ``init.*`` of the state, and ``mode.trim`` 0. [SI]

    Raises
    ------
    SchemaError
        The trim was one without a kind, which puts biases on the inputs: give its parameters to
        `simulate` instead.
    """
    if "start" not in trimmed:
        raise SchemaError(
            "trimmed state", ["no variable start; trim with a kind, e.g. kind='level'"]
        )
    return dict(
        zip(map(str, trimmed["quantity"].values), map(float, trimmed["start"].values), strict=True)
    )


def trimmed_outputs(sim: SimModel, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the outputs (outputs,) of the trim at the start as the kernel gives them, for many
    trims in a row.
    """
    values = {"mode.trim": default_trim_mode(sim, parameters), **parameters}
    return initialise_run(sim, values, constant_inputs(sim, values)).outputs()


def default_trim_mode(sim: SimModel, parameters: Mapping[str, float]) -> float:
    """Return the ``mode.trim`` of a trim that does not give it: throttle where levers drive engines
    with tables, else thrust.
    """
    engines = any(name.startswith("engine1/") for name in sim.terms)
    mode = next(row.value for row in sim.entries(PARAMETER) if row.name == "mode.engine")
    return 2.0 if engines and parameters.get("mode.engine", mode) == 0.0 else 1.0


def _result(
    sim: SimModel,
    y: np.ndarray,
    search: Mapping = MappingProxyType({}),
    findings: Mapping = MappingProxyType({}),
) -> xr.Dataset:
    outputs = {
        row.name: ((), y[i], output_attributes(row)) for i, row in enumerate(sim.entries(OUTPUT))
    }
    return xr.Dataset({**outputs, **search}, attrs={"title": sim.title, **findings})
