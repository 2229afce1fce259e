"""Likelihood of the records of a circuit, with the kinks at which an end begins to slide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flightmech.simulation.estimation.circuit_response import CircuitSlopes
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses.driven_rows import DrivenPiece, DrivenRows
from flighttest.submodels.control_loading.responses.free_response import (
    SURFACE,
    TRAVEL,
    FreeWindow,
)
from flighttest.submodels.control_loading.responses.kinked_search import Sides
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    SimulatedPiece,
    count_sub_steps,
)

# Start of each end, and the friction that holds it.
_HELD_BY = ((TRAVEL, "friction"), (SURFACE, "hinge_friction"))
# Most Newton steps that place a start on a kink.
_PLACINGS = 20
# Largest distance of a ratio from its kink once it is placed.
_PLACED = 1e-12
# Distance from a kink within which the motion of a start that slides is below the rounding of the
# integration, and distance outside at which its derivatives are taken instead.
_ROUNDED, _OUTSIDE = 1e-5, 1e-5


class CircuitLikelihood(Likelihood):
    """Likelihood of the windows of free motion, then of the driven rows.

    `start` are the first constants, by which each window gets the sub-steps of its own steps.
    """

    def __init__(
        self,
        loading: ControlLoading,
        windows: Sequence[FreeWindow],
        rows: Sequence[DrivenRows],
        layout: UnknownVector,
        start: Mapping[str, float],
    ):
        self.loading, self.windows, self.rows = loading, list(windows), list(rows)
        self.start = start
        # A window whose force is recorded too coarsely differs from its simulation by more than
        # noise, so each has a variance of its own. All driven stretches have one.
        groups = np.r_[np.arange(len(windows)), np.full(len(rows), len(windows))]
        count = len(self.windows)
        simulated = []
        for window, names in zip(self.windows, layout.bases[:count]):
            parts = count_sub_steps(start, loading.gearing, window.step)
            simulated.append(SimulatedPiece(loading, window, names, parts))
        pieces: list[Any] = list(simulated)
        for piece, names in zip(self.rows, layout.bases[count:]):
            pieces.append(DrivenPiece(piece, names))
        super().__init__(pieces, layout, groups)
        self.simulated = simulated
        self.kinks = self._kinked()

    def with_records(
        self, windows: Sequence[FreeWindow], rows: Sequence[DrivenRows]
    ) -> CircuitLikelihood:
        """Return the likelihood of other records with the same unknowns."""
        return CircuitLikelihood(self.loading, windows, rows, self.layout, self.start)

    def _kinked(self) -> list[tuple[int, int, int]]:
        """Return piece, end and own start of every kink."""
        kinks = []
        for number, piece in enumerate(self.simulated):
            names = piece.names
            for end, (start, friction) in enumerate(_HELD_BY):
                if BRISTLE_TRAVEL in names and friction in names and start in names:
                    kinks.append((number, end, names.index(start)))
        return kinks

    def sides(self, theta: np.ndarray) -> Sides:
        """Return the derivatives on both sides of all kinks: loads at rest over friction."""
        both: list[Any] = []
        for number, (piece, columns) in enumerate(zip(self.pieces, self.layout.columns)):
            values = theta[columns]
            if isinstance(piece, SimulatedPiece):
                both.append(self._slopes_of_both_sides(number, theta))
            else:
                both.append(piece.slopes(values, values, central=True))
        ratio, by_unknown = np.zeros(len(self.kinks)), np.zeros((len(self.kinks), len(theta)))
        for k, (number, end, _) in enumerate(self.kinks):
            ratio[k] = both[number].ratio[end]
            by_unknown[k, self.layout.columns[number]] = both[number].by_unknown[end]
        return Sides(ratio, by_unknown, both)

    def _slopes_of_both_sides(self, number: int, theta: np.ndarray) -> CircuitSlopes:
        """Return the slopes of a window; those outside of a kink are taken a little further out.

        At a kink, an end slides by nothing, so that rounding decides on which way its bristle
        bends.  Near it, the motion of the end is proportional to the distance: its derivatives
        further out are those at the kink.  Inside, both ways give the same.
        """
        columns = self.layout.columns[number]
        at = self.simulated[number].one_sided_slopes(theta[columns])
        outside = {}
        for k, (piece, end, _) in enumerate(self.kinks):
            if piece == number and abs(abs(at.ratio[end]) - 1.0) < _ROUNDED:
                outside[k] = float(np.copysign(1.0 + _OUTSIDE, at.ratio[end]))
        moved = self.place(theta, outside)[columns]
        if not outside or not np.isfinite(moved).all():
            return at
        away = self.simulated[number].one_sided_slopes(moved)
        ends = [self.kinks[k][1] for k in outside]
        # inside, sliding + bends by_unknown, is kept
        sliding, bends = at.sliding.copy(), at.bends.copy()
        bends[:, :, ends] = away.bends[:, :, ends]
        sliding += (at.bends - bends)[:, :, ends] @ at.by_unknown[ends]
        return at._replace(sliding=sliding, bends=bends)

    def join_sides(self, sides: Sides, inside: np.ndarray) -> list[np.ndarray]:
        """Return the slopes on one side of each kink; inside, friction holds the control."""
        slopes = []
        for both in sides.pieces:
            slopes.append(both.sliding.copy() if isinstance(both, CircuitSlopes) else both)
        for k, (number, end, _) in enumerate(self.kinks):
            if inside[k]:
                both = sides.pieces[number]
                slopes[number] += both.bends[:, :, end, None] * both.by_unknown[end]
        for S, mask in zip(slopes, self.has_reading):
            S[~mask] = 0.0
        return slopes

    def pushes(self, sides: Sides, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return the downhill derivative of the cost by the bend of each kink, (kink,)."""
        noise = self.noise(residuals)
        pushes = np.zeros(len(self.kinks))
        for k, (number, end, _) in enumerate(self.kinks):
            weighted = residuals[number] / noise[self.groups[number]]
            pushes[k] = float((sides.pieces[number].bends[:, :, end] * weighted).sum())
        return pushes

    def place(self, theta: np.ndarray, held: Mapping[int, float]) -> np.ndarray:
        """Return unknowns whose starts give these ratios of load and friction; NaN without any."""
        theta = theta.copy()
        by_piece: dict[int, list[int]] = {}
        for k in held:
            by_piece.setdefault(self.kinks[k][0], []).append(k)
        for number, kinks in by_piece.items():
            columns = self.layout.columns[number]
            ends = [self.kinks[k][1] for k in kinks]
            starts = [self.kinks[k][2] for k in kinks]
            wanted = np.array([held[k] for k in kinks])
            for _ in range(_PLACINGS):
                ratio, by_unknown = self.simulated[number].load_ratios(theta[columns])
                slope = by_unknown[np.ix_(ends, starts)]
                miss = wanted - ratio[ends]
                if np.abs(miss).max() < _PLACED:
                    break
                if not abs(np.linalg.det(slope)) > 0.0:
                    return np.full_like(theta, np.nan)
                theta[columns[starts]] += np.linalg.solve(slope, miss)
            else:
                return np.full_like(theta, np.nan)
        return theta
