"""Steady states of a compiled model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE
from flightmech.simulation.run import (
    Stated,
    constant_inputs,
    initialise_run,
    output_attributes,
    values_in_si,
)
from flightmech.simulation.stated_values.odd_values import warn_of_odd_values
from flightmech.steady_flight.stated_speeds.odd_speeds import warn_of_odd_flight
from flightmech.steady_flight.trim_findings import describe_tables_left
from flightmech.steady_flight.trim_kinds import CLIMB
from flightmech.steady_flight.trim_request import make_trim_request
from flightmech.steady_flight.trim_result import TrimResult


def trim(
    sim: SimModel,
    parameters: Mapping[str, Stated] | None = None,
    kind: str | None = None,
    unknowns: Sequence[str] | None = None,
    fixed: Mapping[str, Stated] | None = None,
    residuals: Sequence[str] | None = None,
    **quantities: Stated,
) -> xr.Dataset:
    """Trim to a steady flight, or to rest on the ground.

    With parameters alone, this is the trim at the start of every run (``mode.trim``).  ``init.V
    gamma phi psi h p q r psi_dot`` are fixed, ``phi`` within ``init.phi_range`` (zero).  Angle of
    attack, sideslip, elevator, aileron, rudder and power are unknown; controls and power are biases
    on the inputs.  The accelerations take the values ``init.u_dot ... init.r_dot`` (zero).

    With any other argument, plain names describe the flight.  Unknown in every kind in the air are
    alpha, the three surfaces and power (throttle or thrust, by ``mode.engine``).  The six
    accelerations vanish.

    ========== ============ =============================== ====================================
    kind       unknowns     give one of                     remarks
    ========== ============ =============================== ====================================
    level      beta                                         gamma, phi, psi_dot are 0;
                                                            beta given: phi unknown;
                                                            power given: V unknown
    climb      beta         gamma, hdot, theta, power       power given: gamma unknown
    turn       beta psi_dot phi, psi_dot, nz                ay vanishes;
                                                            beta given: ay does not;
                                                            psi_dot or nz given: phi unknown
    sideslip   phi          beta, delta_r, phi              delta_r or phi given: beta unknown
    pull_up    beta q       nz, q                           lowest point of a loop, gamma 0
    engine_out phi          engine1.failed = 1 ...          beta is 0;
                                                            phi or delta_r given: beta unknown
    ground     h theta phi  V (0 is rest)                   only the accelerations upward and in
               (alone)                                      pitch and roll vanish;
                                                            u_dot given: power unknown;
                                                            at rest all vanish, and the
                                                            deflections of the tyres are unknown
    ========== ============ =============================== ====================================

    With ``mode.controls`` 1 the travel of a control circuit is unknown in place of its surface.
    With 2 the force on the circuit is unknown, too (without friction).  A given ``F_column``,
    ``F_wheel`` or ``F_pedal`` makes the trim tab unknown.  On the ground V is the speed over the
    ground along the heading, and the brakes are inputs like others.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    parameters : mapping of str to float, optional
        Parameters and inputs: ``{"init.V": 90.0, "init.h": 1500.0, "delta_f": 0.6}``. [SI]
    kind : str, optional
        As in the table. Default: ``level``.
    unknowns : sequence of str, optional
        Unknowns in place of those of the kind: ``alpha beta gamma theta phi psi V h p q r
        psi_dot``, any input, any parameter, ``throttle`` or ``thrust`` of all engines alike.
    fixed : mapping of str to float, optional
        Fixed quantities: the same names, an acceleration ``u_dot ... r_dot``, or any output (``nz
        hdot V_cas mach`` ...), which becomes a residual.  ``engine1.failed`` 1 removes the thrust
        of an engine, or cuts off its fuel; with ``mode.engine`` 3 to 5 its drive must be given,
        because the drag of its propeller depends on it.  A fixed quantity is not unknown, and its
        partner in the table is. [SI]
    residuals : sequence of str, optional
        Residuals in place of those of the kind: ``u_dot ... r_dot`` and any output.
    **quantities : float or str
        Fixed quantities whose names are words of Python: ``V_cas="240 kt", h="5000 ft"``. Here and
        in `parameters` and `fixed`, a text has its unit, and a number is SI.

    Returns
    -------
    Dataset
        All outputs in the trimmed state, without dimension: ``alpha``, ``theta``,
        ``applied.delta_e``. ``trim.u_dot ... trim.r_dot`` are the remaining accelerations.
        Attribute ``tables_left`` names the variables beyond their tables.

        With more than parameters also: ``found low high`` over ``unknown``, with ``limit`` -1 or 1
        at the lower or upper limit; ``wanted left`` over ``residual``; ``start`` over
        ``quantity``, for `start_of`.  Attributes: ``converged`` (1 or 0), ``at_limit``,
        ``without_effect`` (unknowns that change no residual), ``alike`` (unknowns that cannot be
        distinguished), ``rank``, ``verdict``, a text that states all this, and ``advice`` for
        unknowns without effect.  A trim that does not converge is a result: its residuals are as
        small as the limits allow.

    Raises
    ------
    UnknownName
        A kind, parameter, input or quantity that the model does not have.
    SchemaError
        A contradiction in the request: more residuals than unknowns, a quantity both fixed and
        unknown or fixed twice, or no value of a quantity that the kind needs.
    UnitError
        A text without a unit, or with a unit of another dimension.
    SimulationError
        A parameter has no meaning, e.g. no speed.

    Warns
    -----
    AeromatchWarning
        A value that no aeroplane has, an input beyond its limits, or a speed far outside of the
        tables: mostly a number without its unit.

    Notes
    -----
    Body rates follow from the turn: p = -psi_dot sin(theta), q = psi_dot sin(phi) cos(theta), r =
    psi_dot cos(phi) cos(theta), plus, over a round Earth, the rate of the horizon.  In a climb
    u_dot = 0 means a constant true airspeed, not a constant calibrated airspeed.  With more
    unknowns than residuals the solution has the smallest norm, angles in rad, throttle in parts of
    its travel.

    References
    ----------
    .. [Stevens] Stevens and Lewis, Aircraft Control and Simulation, 1992, section 3.4:
       rate-of-climb and turn-coordination constraints.
    """
    twice = sorted(set(fixed or {}) & set(quantities))
    if twice:
        raise SchemaError(
            "trim", [f"{name} stands in fixed and as an argument; give it once" for name in twice]
        )
    parameters = values_in_si(sim, parameters)
    if fixed is not None or quantities:
        fixed = values_in_si(sim, {**(fixed or {}), **quantities})
    stated = {**(parameters or {}), **(fixed or {})}
    if fixed is not None:
        # the verdict names the inputs beyond their limits
        stated = {name: value for name, value in stated.items() if name not in sim.inputs}
    if kind == "ground":
        # wheels carry the weight: no speed is too small
        warn_of_odd_values(sim, stated)
    else:
        warn_of_odd_flight(sim, stated)
    return find_trim(sim, parameters, kind, unknowns, fixed=fixed, residuals=residuals)


def find_trim(
    sim: SimModel,
    parameters: Mapping[str, float] | None,
    kind: str | None,
    unknowns: Sequence[str] | None = None,
    *,
    fixed: Mapping[str, float] | None = None,
    residuals: Sequence[str] | None = None,
) -> xr.Dataset:
    """Return the steady flight of `trim` from numbers in SI, without a look at their sizes.

    A search over speeds goes beyond the tables on purpose.
    """
    if kind is None and unknowns is None and fixed is None and residuals is None:
        y = trimmed_outputs(sim, parameters or {})
        state = dict(zip(sim.outputs, map(float, y), strict=True))
        texts = describe_tables_left(sim, state).values()
        return _make_dataset(sim, y, attrs={"tables_left": "; ".join(texts)})
    request = make_trim_request(
        sim,
        parameters=parameters or {},
        kind=kind or "level",
        unknowns=unknowns,
        residuals=residuals,
        fixed=fixed or {},
    )
    # the search of the kernel starts from these values
    run = initialise_run(sim, request.values, constant_inputs(sim, request.values))
    # The kernel has the upward acceleration as residual -1: it is not an output.
    goals = []
    for name in request.outputs:
        goals.append(-1 if name == CLIMB else sim.outputs.index(name))
    solution, y, weighted, jacobian = run.trim_for(
        request.path,
        _list_movers(sim, request.movers),
        search=request.search,
        goals=goals,
        targets=request.targets,
    )
    residual = np.where(np.array(goals) < 0, weighted, y[goals] - request.targets)
    result = TrimResult(request, solution, residual, weighted=weighted, jacobian=jacobian)
    return _make_dataset(
        sim, y, variables=result.variables(sim, run), attrs=result.attributes(sim, run)
    )


def _list_movers(sim: SimModel, movers: Sequence[Sequence[str]]) -> list[tuple[int, int, int]]:
    """Return (kind of entry, index, unknown) of everything that the unknowns move."""
    entries = {}
    for kind in (STATE, PARAMETER, INPUT):
        for index, row in enumerate(sim.entries(kind)):
            entries[row.name] = (kind, index)
    rows = []
    for unknown, names in enumerate(movers):
        for name in names:
            rows.append((*entries[name], unknown))
    return rows


def start_of(trimmed: xr.Dataset) -> dict[str, float]:
    """Return the parameters and inputs with which a simulation starts in a trimmed state.

    Parameters
    ----------
    trimmed : Dataset
        As from `trim` with a kind.

    Returns
    -------
    dict of str to float
        For the `parameters` of `simulate`, `linearize` or an FMU: the parameters of the trim, its
        solution, ``init.*`` of the state, and ``mode.trim`` 0. [SI]

    Raises
    ------
    SchemaError
        The trim has no kind. Its result is biases on the inputs. Pass its parameters to `simulate`
        instead.
    """
    if "start" not in trimmed:
        raise SchemaError(
            "trimmed state", ["no variable start; trim with a kind, e.g. kind='level'"]
        )
    names, values = trimmed["quantity"].values, trimmed["start"].values
    return dict(zip(map(str, names), map(float, values), strict=True))


def trimmed_outputs(sim: SimModel, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the outputs (outputs,) of the trim at the start, for many trims in a row. [SI]"""
    # a `mode.trim` of the parameters replaces the default
    values = {"mode.trim": default_trim_mode(sim, parameters), **parameters}
    return initialise_run(sim, values, constant_inputs(sim, values)).outputs()


def default_trim_mode(sim: SimModel, parameters: Mapping[str, float]) -> float:
    """Return the default of ``mode.trim``: 2 if levers drive engines with a deck, else 1.

    The trim of mode 2 computes the throttle, that of mode 1 the thrust. Slipstream, normal force
    and torque of a propeller depend on its power, so that its thrust must come from the lever.
    """
    has_deck = any(name.startswith("engine1/") for name in sim.terms)
    default = next(row.value for row in sim.entries(PARAMETER) if row.name == "mode.engine")
    if has_deck and parameters.get("mode.engine", default) == 0.0:
        return 2.0
    return 1.0


def _make_dataset(
    sim: SimModel,
    y: np.ndarray,
    variables: Mapping[str, Any] = MappingProxyType({}),
    attrs: Mapping[str, Any] = MappingProxyType({}),
) -> xr.Dataset:
    """Return all outputs, with the variables and attributes of a search."""
    # a scalar variable per output
    outputs = {}
    for i, row in enumerate(sim.entries(OUTPUT)):
        outputs[row.name] = ((), y[i], output_attributes(row))
    return xr.Dataset({**outputs, **variables}, attrs={"title": sim.title, **attrs})
