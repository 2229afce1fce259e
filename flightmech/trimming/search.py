"""Steady states of a compiled model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..errors import SchemaError
from ..simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE
from ..simulation.run import attributes, constant_inputs, prepared
from .kinds import CLIMB
from .request import request
from .result import Search

if TYPE_CHECKING:
    from ..simulation.compiler import SimModel


def trim(
    sim: SimModel,
    parameters: Mapping[str, float] | None = None,
    kind: str | None = None,
    unknowns: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    residuals: Sequence[str] | None = None,
) -> xr.Dataset:
    """Trim to a steady flight, or to rest on the ground.

    Called with parameters alone it is the trim that every run starts with (``mode.trim``): ``init.V gamma phi psi h p q r psi_dot`` are
    held, ``phi`` within ``init.phi_range`` (zero); angle of attack, sideslip, elevator, aileron, rudder and power are unknown,
    controls and power as biases on the inputs, so that the accelerations take the values ``init.u_dot ... init.r_dot`` (zero).

    With any other argument the flight is described by plain names.  Unknown in every kind in the air: alpha, the three surfaces and
    power (throttle or thrust, by ``mode.engine``); the six accelerations vanish.

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
                                                            vanish, and the deflections of the tyres are unknown
    ========== ============ =============================== ==============================================

    With ``mode.controls`` 1 the travel of a control circuit is unknown in place of its surface, with 2 also the force that holds it
    (without friction).  A given ``F_column``, ``F_wheel`` or ``F_pedal`` makes the trim tab unknown.  On the ground V is the speed over the
    ground along the heading, and the brakes are inputs like others.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    parameters : mapping of str to float, optional
        Parameters and inputs: ``{"init.V": 90.0, "init.h": 1500.0, "delta_f": 0.6}``. [SI]
    kind : str, optional
        As in the table; ``level`` unless given.
    unknowns : sequence of str, optional
        Solved for instead of the unknowns of the kind: ``alpha beta gamma theta phi psi V h p q r psi_dot``, any input, any parameter,
        ``throttle`` or ``thrust`` of all engines alike.
    fixed : mapping of str to float, optional
        What is held: the same names; an acceleration ``u_dot ... r_dot``; any output (``nz hdot V_cas mach`` ...), which becomes a
        residual; ``engine1.failed`` 1 takes the thrust of an engine away.  What is given is no longer unknown, and its partner in the
        table is. [SI]
    residuals : sequence of str, optional
        What vanishes instead of what the kind demands: ``u_dot ... r_dot`` and any output.

    Returns
    -------
    Dataset
        All outputs in the trimmed state, without dimension: ``alpha``, ``theta``, ``applied.delta_e``; ``trim.u_dot ... trim.r_dot`` is
        the remaining accelerations.

        Unless called with parameters alone also: ``found low high`` over ``unknown``, with ``limit`` -1 or 1 at the lower or upper
        one; ``wanted left`` over ``residual``; ``start`` over ``quantity``, for `start_of`.  Attributes: ``converged`` (1 or 0),
        ``at_limit``, ``without_effect`` (unknowns that change no residual), ``alike`` (unknowns that cannot be distinguished), ``rank``,
        ``verdict``, a text that states all this, and ``advice``, what to do about unknowns without effect.  A trim that does not come
        about is a result: the residuals are as small as the limits allow.

    Raises
    ------
    UnknownName
        A kind, parameter, input or quantity that the model does not have.
    SchemaError
        A request that contradicts itself: more residuals than unknowns, a quantity fixed and unknown, nothing given of what the kind needs.
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
    problem = request(sim, parameters or {}, kind or "level", unknowns, residuals, fixed or {})
    run = prepared(sim, problem.values, constant_inputs(sim, problem.values))
    places = {row.name: (kind, i) for kind in (STATE, PARAMETER, INPUT) for i, row in enumerate(sim.entries(kind))}
    movers = [(*places[item], unknown) for unknown, items in enumerate(problem.movers) for item in items]
    goals = [-1 if name == CLIMB else sim.outputs.index(name) for name in problem.outputs]
    found, y, left, jacobian = run.trim_for(problem.path, movers, problem.search, goals, problem.wanted)
    rest = np.where(np.array(goals) < 0, left, y[goals] - problem.wanted)
    search = Search(problem, found, rest, left, jacobian)
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
        For the `parameters` of `simulate`, `linearize` or an FMU: what the trim was given, what it found, ``init.*`` of the state, and
        ``mode.trim`` 0. [SI]

    Raises
    ------
    SchemaError
        The trim was one without a kind, which puts biases on the inputs: give its parameters to `simulate` instead.
    """
    if "start" not in trimmed:
        raise SchemaError("trimmed state", ["no variable start; trim with a kind, e.g. kind='level'"])
    return dict(zip(map(str, trimmed["quantity"].values), map(float, trimmed["start"].values), strict=True))


def trimmed_outputs(sim: SimModel, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the outputs (outputs,) of the trim at the start as the kernel gives them, for many trims in a row."""
    values = {"mode.trim": default_trim_mode(sim, parameters), **parameters}
    return prepared(sim, values, constant_inputs(sim, values)).outputs()


def default_trim_mode(sim: SimModel, parameters: Mapping[str, float]) -> float:
    """Return the ``mode.trim`` of a trim that does not give it: throttle where levers drive engines with tables, else thrust."""
    engines = any(name.startswith("engine1/") for name in sim.terms)
    mode = next(row.value for row in sim.entries(PARAMETER) if row.name == "mode.engine")
    return 2.0 if engines and parameters.get("mode.engine", mode) == 0.0 else 1.0


def _result(sim: SimModel, y: np.ndarray, search: Mapping = MappingProxyType({}), findings: Mapping = MappingProxyType({})) -> xr.Dataset:
    outputs = {row.name: ((), y[i], attributes(row)) for i, row in enumerate(sim.entries(OUTPUT))}
    return xr.Dataset({**outputs, **search}, attrs={"title": sim.title, **findings})
