"""What the readings of a flight can determine, before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from .normal_equations import Equations

RANK = 1e-10  # of the largest eigenvalue of the information scaled to unit diagonal
PART = 0.2  # of the largest component: smaller ones are left out of the words


@dataclass(frozen=True)
class Visibility:
    """What the readings determine of the constants, the starts of the path unknown.

    Attributes
    ----------
    directions : Dataset (direction, parameter)
        ``weight`` (direction): sum of the squared changes of all readings, in units of their noise, when the constants move
        together by ``move`` (direction, parameter), which is one standard deviation of their prior.  Below one the readings
        are less informative than the specification of the instruments.  Smallest first.
    rank, constants : int
        Numerical rank of the information on the constants, and how many there are.
    condition : float
        Condition number of the information scaled to unit diagonal.
    """

    directions: xr.Dataset
    rank: int
    constants: int
    condition: float

    def hidden(self, limit: float = 1.0) -> list[str]:
        """Return in words the combinations that weigh less than `limit`."""
        weights = self.directions["weight"].values
        return [self._words(i) for i in np.flatnonzero(weights < limit).tolist()]

    def report(self) -> str:
        """Return rank, condition and hidden combinations as text."""
        head = f"before the fit: rank {self.rank} of {self.constants} constants, condition number {self.condition:.3g}"
        words = [f"  ! {word}" for word in self.hidden()]
        return "\n".join([head, *(words or ["  every constant is seen"])])

    def _words(self, i: int) -> str:
        row = self.directions.isel(direction=i)
        move, share = row["move"].values, np.abs(row["component"].values)
        large = np.flatnonzero(share > PART * share.max())
        large = large[np.argsort(-share[large])]
        names, units = row["parameter"].values, row["unit"].values
        sign = np.sign(move[large[0]])
        parts = [f"{names[j]} {sign * move[j]:+.3g} {units[j]}".removesuffix(" 1") for j in large]
        noise = np.sqrt(max(float(row["weight"]), 0.0))
        if len(parts) == 1:
            return f"not seen: {parts[0]} changes all readings together by {noise:.2g} of their noise; it rests on its prior"
        return (
            f"not seen apart: {', '.join(parts)} together change all readings by {noise:.2g} of their noise; "
            "give one of them a prior from elsewhere, or fly a manoeuvre that separates them"
        )


def visibility(equations: Equations) -> Visibility:
    """Return what the readings determine of the free constants.

    Parameters
    ----------
    equations : Equations
        At the start.
    """
    layout = equations.layout
    nc = len(layout.names)
    free = np.flatnonzero(layout.free)
    rest = np.arange(nc, layout.size)
    normal = equations.normal.copy()
    normal[:nc, :nc] -= layout.prior_information()
    starts = normal[np.ix_(rest, rest)]
    scale = 1.0 / np.sqrt(np.diag(starts))
    root = np.linalg.cholesky(starts * np.outer(scale, scale))
    half = np.linalg.solve(root, scale[:, None] * normal[np.ix_(rest, free)])
    information = normal[np.ix_(free, free)] - half.T @ half
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    own = np.linalg.eigvalsh(information / np.outer(size, size))
    sigma = np.sqrt(np.diag(layout.covariance))[free]
    weight, component = np.linalg.eigh(information * np.outer(sigma, sigma))
    directions = xr.Dataset(
        {
            "weight": ("direction", weight),
            "component": (("direction", "parameter"), component.T),
            "move": (("direction", "parameter"), component.T * sigma),
            "unit": ("parameter", [layout.units[i] for i in free]),
        },
        coords={"parameter": [layout.names[i] for i in free]},
    )
    rank = int((own > RANK * own[-1]).sum())
    return Visibility(directions, rank, len(free), float(own[-1] / own[0]) if own[0] > 0.0 else np.inf)


def demand_sight(found: Visibility) -> None:
    """Refuse to estimate from the readings alone what they do not show.

    Raises
    ------
    IdentificationError
        With all combinations of which the readings are less informative than the specification of the instruments.
    """
    blind = found.hidden()
    if blind:
        raise IdentificationError(
            "the readings do not determine these constants (leave `free` out, and their priors take part):\n  - " + "\n  - ".join(blind)
        )
