"""The solution of a trim, with its limits, its rank and a verdict in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE, Simulation
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.steady_flight.trim_findings import (
    TRIMMED,
    alpha_grid,
    describe_greatest_lift,
    describe_inputs_beyond_limits,
    describe_tables_left,
)
from flightmech.steady_flight.trim_kinds import CLIMB, ON_GROUND
from flightmech.steady_flight.trim_request import Request

# Kinds in which a steady bank may balance what a control without effect leaves.
_BANKED = ("level", "climb", "pull_up")
_LIMIT_DISTANCE = 1e-9  # distance from a limit that counts as at the limit, of the size
_NO_EFFECT = 1e-8  # slope of an unknown without effect, of the largest slope
_SINGULAR = 1e-6  # singular value that counts as zero, of the largest one
_NAMED_COMPONENT = 0.1  # smallest component of a singular direction that the result names
# Start values that a trim changes, also if they are not among its unknowns.
_STATE = ("V", "alpha", "beta", "theta", "p", "q", "r")
_GROUND_START = 3.0  # mode.trim: standing on the runway


@dataclass(frozen=True)
class TrimResult:
    """A request and the solution of the kernel.

    Parameters
    ----------
    request : Request
        The request.
    solution : array (unknown,)
        Values of the unknowns. [SI]
    residual : array (residual,)
        Outputs minus their requested values. [SI]
    weighted : array (residual,)
        The same, weighted as accelerations. [m s-2]
    jacobian : array (residual, unknown)
        Slopes of `weighted` over one size of each unknown. [m s-2]
    """

    request: Request
    solution: np.ndarray
    residual: np.ndarray
    weighted: np.ndarray
    jacobian: np.ndarray

    def variables(self, sim: SimModel, run: Simulation) -> dict[str, tuple[Any, ...]]:
        """Return the variables of the result; `run` is in the state of the solution."""
        request = self.request
        units = {CLIMB: "m s-2"}
        for kind in (OUTPUT, STATE, INPUT, PARAMETER):
            for row in sim.entries(kind):
                units[row.name] = row.units
        _, low, high, _ = request.search
        start = self._start_values(sim, run)
        return {
            "unknown": ("unknown", list(request.unknowns)),
            "unknown_units": ("unknown", [units[names[0]] for names in request.movers]),
            "found": ("unknown", self.solution),
            "low": ("unknown", low),
            "high": ("unknown", high),
            "limit": ("unknown", self._limit_signs()),
            "residual": ("residual", list(request.residuals)),
            "residual_units": ("residual", [units[name] for name in request.outputs]),
            "wanted": ("residual", request.targets),
            "left": ("residual", self.residual),
            "quantity": ("quantity", list(start)),
            "start": ("quantity", np.array(list(start.values()))),
        }

    def attributes(self, sim: SimModel, run: Simulation) -> dict[str, str | int]:
        """Return the attributes of the result: each finding, and all of them as a text.

        `run` is in the state of the solution.
        """
        state = dict(zip(sim.outputs, map(float, run.outputs()), strict=True))
        tables_left = describe_tables_left(sim, state)
        converged = bool(np.abs(self.weighted).max() <= TRIMMED)
        idle, alike, rank = self._rank_effects()
        at_limit = []
        for name, side in zip(self.request.unknowns, self._limit_signs(), strict=True):
            if side:
                at_limit.append(name)
        verdict = ["trimmed" if converged else "not trimmed", *self._describe_limits()]
        findings = {
            "left over": self._describe_residuals(),
            "without effect": idle,
            "only together": alike,
        }
        for text, names in findings.items():
            if names:
                verdict.append(f"{text}: {', '.join(names)}")
        verdict += tables_left.values()
        verdict += describe_inputs_beyond_limits(sim, self._start_values(sim, run))
        if not converged:
            verdict += self._describe_lift(sim, run, state)
        return {
            "kind": self.request.kind,
            "converged": int(converged),
            "at_limit": " ".join(at_limit),
            "without_effect": " ".join(idle),
            "alike": " ".join(alike),
            "rank": rank,
            "tables_left": "; ".join(tables_left.values()),
            "verdict": "; ".join(verdict),
            "advice": self._advise(idle, converged, tables_left),
        }

    def _describe_lift(self, sim: SimModel, run: Simulation, state: dict[str, float]) -> list[str]:
        """Return a text if the lift coefficient is at its maximum, from flights over alpha."""
        angles = alpha_grid(sim)
        if self.request.path == ON_GROUND or not angles.size:
            return []
        start = self._start_values(sim, run) | {"mode.trim": 0.0}
        inputs = constant_inputs(sim, start)
        index = sim.outputs.index("CL")
        lift = []
        for angle in angles:
            flight = initialise_run(sim, start | {"init.alpha": float(angle)}, inputs)
            lift.append(flight.outputs()[index])
        text = describe_greatest_lift(state["CL"], state["alpha"], (angles, np.array(lift)))
        return [text] if text else []

    def _describe_limits(self) -> list[str]:
        """Return a text for each unknown at a limit."""
        _, low, high, _ = self.request.search
        texts = []
        for k, side in enumerate(self._limit_signs()):
            name = self.request.unknowns[k]
            if side > 0:
                texts.append(f"{name} at its upper limit {high[k]:.6g}")
            elif side < 0:
                texts.append(f"{name} at its lower limit {low[k]:.6g}")
        return texts

    def _describe_residuals(self) -> list[str]:
        """Return name and value of each residual that did not vanish."""
        texts = []
        for k, name in enumerate(self.request.residuals):
            if abs(self.weighted[k]) > TRIMMED:
                texts.append(f"{name} {self.residual[k]:.3g}")
        return texts

    def _advise(self, idle: list[str], converged: bool, tables_left: Mapping[str, str]) -> str:
        """Return what to do about unknowns without effect; empty if there are none."""
        beyond = [name for name in idle if name in tables_left]
        rest = [name for name in idle if name not in tables_left]
        texts = []
        if beyond:
            texts.append(
                f"{', '.join(beyond)}: held at the end of its table, where it has no effect; "
                f"narrow its limit in the aircraft file, or give a table up to the limit"
            )
        if rest:
            texts.append(self._advise_absent(rest, idle, converged))
        return "; ".join(texts)

    def _advise_absent(self, absent: list[str], idle: list[str], converged: bool) -> str:
        """Return what to do about unknowns that nothing depends on."""
        problem = f"{', '.join(absent)}: nothing in database and aircraft depends on it here"
        if converged:
            return f"{problem}; the flight is steady without it"
        advice = f"{problem}; add a term that has it, such as Cn/rudder for delta_r"
        if self.request.kind not in _BANKED or "phi" in self.request.unknowns:
            return advice
        unknowns = [name for name in self.request.unknowns if name not in idle]
        options = [f"--free {name}" for name in (*unknowns, "phi")]
        return f"{advice}, or leave it out and free the bank: {' '.join(options)}"

    def _limit_signs(self) -> np.ndarray:
        """Return -1, 0 or 1 (unknown,): at the lower limit, between the limits, at the upper."""
        _, low, high, size = self.request.search
        near = _LIMIT_DISTANCE * size
        upper = np.where(self.solution >= high - near, 1, 0)
        return np.where(self.solution <= low + near, -1, upper)

    def _start_values(self, sim: SimModel, run: Simulation) -> dict[str, float]:
        """Return parameters and inputs that start a simulation in the solution.

        On the ground the kernel trims the tyres again.
        """
        request = self.request
        solved = {}
        for k, names in enumerate(request.movers):
            for name in names:
                if name in sim.parameters or name in sim.inputs:
                    solved[name] = self.solution[k]
        if request.path == ON_GROUND:
            return {**request.values, **solved, "mode.trim": _GROUND_START}
        state = {}
        for name in _STATE:
            state[f"init.{name}"] = run.parameter(sim.parameters.index(f"init.{name}"))
        return {**request.values, **solved, **state}

    def _rank_effects(self) -> tuple[list[str], list[str], int]:
        """Return unknowns without effect, those with dependent effects, and the rank."""
        names = np.array(self.request.unknowns)
        norm = np.linalg.norm(self.jacobian, axis=0)
        has_effect = norm > _NO_EFFECT * norm.max(initial=0.0)
        idle, active = _to_texts(names[~has_effect]), names[has_effect]
        if not len(active):
            return idle, [], 0
        # Columns are normalised, so that the singular values compare directions, not sizes. The
        # right singular vectors beyond the rank are combinations without effect.
        normalised = self.jacobian[:, has_effect] / norm[has_effect]
        _, singular_values, directions = np.linalg.svd(normalised)
        rank = int((singular_values > _SINGULAR * singular_values[0]).sum())
        if rank == len(active) or len(active) > len(self.jacobian):
            return idle, [], rank
        dependent = (np.abs(directions[rank:]) > _NAMED_COMPONENT).any(axis=0)
        return idle, _to_texts(active[dependent]), rank


def _to_texts(names: Sequence[str] | np.ndarray) -> list[str]:
    return [str(name) for name in names]
