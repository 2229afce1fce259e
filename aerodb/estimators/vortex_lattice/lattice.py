"""Coefficients of an aeroplane by a vortex lattice: AVL as the library OptVL, in a child process.

The forces of the library have no part of the vortex legs along the chord. The side wind on them
makes a part of the rolling moment due to sideslip that grows with lift; AVL 3.32 has it, OptVL has
not. `Cl_beta` is therefore that of dihedral, sweep and fin.

The surfaces are thin and the flow is attached and without friction: no stall, no friction drag, no
wave drag, no derivatives with respect to the rate of alpha. Mach number enters by Prandtl and
Glauert's rule.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from aerodb.estimators.coefficient_set import CoefficientSet, make_numbers
from aerodb.estimators.vortex_lattice.avl_text import PanelCounts, write_avl
from aerodb.estimators.vortex_lattice.geometry import ThinSurfaceModel
from flightmech.errors import AeromatchError, SchemaError, SimulationError
from flightmech.support.foreign_code.process import (
    RunLimits,
    module_command,
    run_foreign,
    sandbox_for,
)
from flightmech.support.foreign_code.sandbox import read_sandbox_mode, uses_sandbox
from flightmech.units import DEGREE

PROGRAM = "OptVL"
MOST_MACH = 0.6
"""Largest Mach number of the method, that of DATCOM's subsonic methods."""
_LEAST_ALPHA, _MOST_ALPHA = -10.0 * DEGREE, 10.0 * DEGREE
_BETA = 5.0 * DEGREE  # sideslip of the check that forces are straight over it
# Limits of the child: start [s], time of one condition [s], address space and reply [byte].
_SECONDS, _PER_CONDITION, _MEMORY, _MOST = 120.0, 30.0, 16_000_000_000, 50_000_000
_DRAG_LIFT = 0.3  # lift coefficient from which the two computations of the drag are compared
_LIFT_LIMIT = 10.0  # a larger lift coefficient is a run that did not converge
# Difference that the finer or other computation may show before it is a caution. [share]
_CONVERGED, _STRAIGHT, _SAME_DRAG = 0.05, 0.05, 0.1
_TOTALS = {"CL": "CL", "CD": "CD", "CY": "CY", "Cl'": "Cl", "Cm": "Cm", "Cn'": "Cn"}
_OF_VARIABLE = {"alpha": "alpha", "beta": "beta", "p'": "phat", "q'": "qhat", "r'": "rhat"}
_OF_CONTROL = ("CL", "CD", "CY", "Cl", "Cm", "Cn")


def compute_coefficients(
    model: ThinSurfaceModel, *, with_body: bool, panels: PanelCounts | None = None
) -> CoefficientSet:
    """Return totals and derivatives at the conditions of a model.

    Parameters
    ----------
    model : ThinSurfaceModel
    with_body : bool
        Whether the body is a line of sources and doublets by slender-body theory. Without it the
        body has no part in the coefficients.
    panels : PanelCounts, optional

    Returns
    -------
    CoefficientSet
        Forces, moments and rates in stability axes, moments of controls in body axes, with the
        controls and signs of the product.

    Raises
    ------
    AeromatchError
        The package optvl is not installed.
    SchemaError
        No condition of the model lies in the range of the method.
    SimulationError
        The child process failed, or a run did not converge.
    """
    if importlib.util.find_spec("optvl") is None:
        raise AeromatchError(
            "the second estimator needs the package optvl, which is under the GPL and not a part "
            "of aeromatch; install it with: pip install 'aeromatch[estimate]'"
        )
    panels = panels or PanelCounts()
    machs = [mach for mach in model.machs if mach <= MOST_MACH]
    alphas = [alpha for alpha in model.alphas if _LEAST_ALPHA <= alpha <= _MOST_ALPHA]
    if not machs or len(alphas) < 2:
        raise SchemaError(
            "deck",
            [
                f"no conditions for a vortex lattice; give Mach numbers up to {MOST_MACH:g} and "
                f"two or more angles of attack from {_LEAST_ALPHA / DEGREE:g} to "
                f"{_MOST_ALPHA / DEGREE:g} deg in FLTCON"
            ],
        )
    files = write_avl(model, panels, with_body=with_body)
    # One more condition with sideslip, and one run with half as many panels, check the results.
    conditions = [(mach, alpha, 0.0) for mach, alpha in product(machs, alphas)]
    middle = min(alphas, key=abs)
    checked = (machs[0], middle, _BETA)
    reply = _run_library(files, [*conditions, checked])
    coarse = _run_library(
        write_avl(model, panels.halved(), with_body=with_body), [(machs[0], middle, 0.0)]
    )
    results, slipping = reply["results"][:-1], reply["results"][-1]
    rows = []
    for number, (condition, result) in enumerate(zip(conditions, results, strict=True), 1):
        rows += _rows_of(condition, result, number)
    has_body = with_body and model.body is not None
    straight = results[conditions.index((machs[0], middle, 0.0))]
    remarks, cautions = _check(straight, coarse["results"][0], slipping, results, has_body)
    left_out = [mach for mach in model.machs if mach > MOST_MACH]
    if left_out:
        numbers = " ".join(f"{mach:g}" for mach in left_out)
        remarks.append(f"Mach {numbers} of the deck is beyond the method and left out")
    body = "the body by slender-body theory" if has_body else "no body"
    remarks.insert(
        0,
        f"{PROGRAM} {reply['version']} (AVL) computes thin surfaces in attached inviscid flow, "
        f"with {body}: no friction or wave drag, no stall, no derivatives with respect to the rate "
        f"of alpha, controls in proportion to their deflection",
    )
    remarks.insert(1, "Cl/beta has no part that grows with lift: OptVL leaves it out")
    controls = tuple(reply["controls"])
    return CoefficientSet(
        PROGRAM,
        (model.title,),
        force_axes="stability",
        moment_axes="stability",
        control_axes="body",
        reference=model.reference,
        controls=controls,
        numbers=make_numbers(rows, controls),
        unit_stated=True,
        remarks=(*remarks, *model.remarks),
        inviscid=True,
        cautions=tuple(cautions),
    )


def _run_library(
    files: Mapping[str, str], conditions: list[tuple[float, float, float]]
) -> dict[str, Any]:
    """Return the reply of the child process."""
    wanted = []
    for mach, alpha, beta in conditions:
        wanted.append({"mach": mach, "alpha": alpha / DEGREE, "beta": beta / DEGREE})
    request = json.dumps({"files": dict(files), "conditions": wanted}) + "\n"
    done = run_foreign(
        module_command(f"{__package__}.optvl_child"),
        request.encode("ascii"),
        timeout=_SECONDS + _PER_CONDITION * len(conditions),
        limits=RunLimits(memory=_MEMORY),
        most=_MOST,
        sandbox=sandbox_for(uses_sandbox(read_sandbox_mode())),
    )
    # The library ends its process with exit code 0 when it refuses a geometry.
    failure = done.failure or ("" if done.output else "it ended without a reply")
    if failure:
        raise SimulationError(f"{PROGRAM}: {failure}; it printed: {done.printed or 'nothing'}")
    reply: dict[str, Any] = json.loads(done.output)
    for condition, result in zip(conditions, reply["results"], strict=True):
        lift = result["totals"]["CL"]
        if not abs(lift) < _LIFT_LIMIT:
            raise SimulationError(
                f"{PROGRAM} did not converge at Mach {condition[0]:g}, alpha "
                f"{condition[1] / DEGREE:g} deg (CL {lift:g}); check the cards of the surfaces"
            )
    return reply


def _rows_of(
    condition: tuple[float, float, float], result: Mapping[str, Any], number: int
) -> list[dict[str, Any]]:
    """Return totals and derivatives of one condition as rows of the neutral form."""
    mach, alpha, beta = condition
    place = {"mach": mach, "alpha": alpha, "beta": beta, "file": PROGRAM, "line": number}
    totals, derivatives, of_controls = (
        result[name] for name in ("totals", "derivatives", "controls")
    )
    rows = []
    for key, coefficient in _TOTALS.items():
        value = totals[key]
        if coefficient == "CD":
            # The wake far behind gives a drag that depends less on the panels.
            value = totals["CDff"] + totals["CDv"]
        rows.append({**place, "coefficient": coefficient, "variable": "", "value": value})
    for key, value in derivatives.items():
        left, slash, right = key.partition("/d")
        coefficient = _TOTALS.get(left.removeprefix("d"), "")
        if slash and coefficient and right in _OF_VARIABLE:
            found = {"coefficient": coefficient, "variable": _OF_VARIABLE[right], "value": value}
            rows.append(place | found)
    for key, value in of_controls.items():
        left, _, control = key.partition("/d")
        coefficient = left.removeprefix("d")
        # Per degree in the library.
        if coefficient in _OF_CONTROL:
            found = {"coefficient": coefficient, "variable": control, "value": value / DEGREE}
            rows.append(place | found)
    return rows


def _check(
    straight: Mapping[str, Any],
    coarse: Mapping[str, Any],
    slipping: Mapping[str, Any],
    results: list[Mapping[str, Any]],
    with_body: bool,
) -> tuple[list[str], list[str]]:
    """Return remarks and cautions on panels, sideslip and the two computations of the drag."""
    remarks: list[str] = []
    cautions: list[str] = []
    fine, rough = straight["derivatives"], coarse["derivatives"]
    slope = abs(rough["dCL/dalpha"] / fine["dCL/dalpha"] - 1.0)
    rolling = abs(rough["dCl'/dp'"] / fine["dCl'/dp'"] - 1.0)
    centres = [one["dCm/dalpha"] / one["dCL/dalpha"] for one in (fine, rough)]
    shift = abs(centres[1] - centres[0])
    yawing = abs(rough["dCn'/dbeta"] - fine["dCn'/dbeta"])
    text = (
        f"half as many panels change CL_alpha by {100.0 * slope:.1f} %, Cl_p by "
        f"{100.0 * rolling:.1f} %, the neutral point by {shift:.3f} chord and Cn_beta by "
        f"{yawing:.4f}"
    )
    is_coarse = max(slope, rolling, shift, 10.0 * yawing) > _CONVERGED
    (cautions if is_coarse else remarks).append(text)
    bends = []
    for key in ("CY", "Cn'"):
        expected = straight["derivatives"][f"d{key}/dbeta"] * _BETA
        bends.append(abs(slipping["totals"][key] - expected) / max(abs(expected), 1e-3))
    if max(bends) > _STRAIGHT:
        cautions.append(
            f"side force and yawing moment at {_BETA / DEGREE:g} deg of sideslip differ by "
            f"{100.0 * max(bends):.0f} % from their slopes"
        )
    lifts = np.array([one["totals"]["CL"] for one in results])
    near = np.array([one["totals"]["CDi"] for one in results])
    far = np.array([one["totals"]["CDff"] for one in results])
    high = np.abs(lifts) > _DRAG_LIFT
    # The body has a drag of its own in the sum of the surfaces.
    if high.any() and not with_body:
        share = float(np.abs(near[high] / far[high] - 1.0).max())
        text = (
            f"induced drag of the surfaces and of the wake differ by up to {100.0 * share:.0f} % "
            f"above CL {_DRAG_LIFT:g}, and that of the wake is taken"
        )
        (cautions if share > _SAME_DRAG else remarks).append(text)
    return remarks, cautions
