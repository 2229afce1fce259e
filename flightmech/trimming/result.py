"""What a search for a steady flight came to: limits that were hit, remaining residuals, unknowns without effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE, Simulation
from .kinds import CLIMB, ON_GROUND
from .request import Request

if TYPE_CHECKING:
    from ..simulation.compiler import SimModel

_DONE = 3e-4  # remainder of a residual that counts as zero [m s-2]: 0.001 ft/s2, as the trim of JSBSim (FGTrim) has it
_BANKED = ("level", "climb", "pull_up")  # kinds in which a steady bank may balance what a control without effect leaves
_AT_LIMIT = 1e-9  # of the size of an unknown
_NO_EFFECT = 1e-8  # slope, of the largest one
_SAME = 1e-6  # singular value of the normalised slopes, of the largest one
_PART = 0.1  # of a direction without effect: a component that is named
_STATE = ("V", "alpha", "beta", "theta", "p", "q", "r")  # what a trim sets without being among its unknowns


@dataclass(frozen=True)
class Search:
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
        units = {row.name: row.units for kind in (OUTPUT, STATE, INPUT, PARAMETER) for row in sim.entries(kind)} | {CLIMB: "m s-2"}
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
        over = [f"{name} {rest:.3g}" for name, rest, part in zip(request.residuals, self.rest, self.left, strict=True) if abs(part) > _DONE]
        parts = ["trimmed" if converged else "not trimmed", *stops]
        for text, names in (("left over", over), ("without effect", idle), ("only together", alike)):
            parts += [f"{text}: {', '.join(names)}"] if names else []
        return {
            "kind": request.kind,
            "converged": int(converged),
            "at_limit": " ".join(name for name, side in zip(request.unknowns, limits, strict=True) if side),
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
        return f"{add}, or leave it out and free the bank: {' '.join(f'--free {name}' for name in (*others, 'phi'))}"

    def _limits(self) -> np.ndarray:
        _, low, high, size = self.request.search
        near = _AT_LIMIT * size
        return np.where(self.found <= low + near, -1, np.where(self.found >= high - near, 1, 0))

    def _start(self, sim: SimModel, run: Simulation) -> dict[str, float]:
        """Return parameters and inputs that start a simulation here; on the ground the kernel stands up once more, with the tyres."""
        request = self.request
        found = {item: self.found[k] for k, items in enumerate(request.movers) for item in items if item in sim.parameters + sim.inputs}
        if request.path == ON_GROUND:
            return {**request.values, **found, "mode.trim": 3.0}
        held = {f"init.{name}": run.parameter(sim.parameters.index(f"init.{name}")) for name in _STATE}
        return {**request.values, **found, **held}

    def _rank(self) -> tuple[list[str], list[str], int]:
        """Return the unknowns without effect, those whose effects are not independent, and the number of independent ones."""
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
