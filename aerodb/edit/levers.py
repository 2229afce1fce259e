"""Levers of force coefficients for moment coefficients about another reference point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

MOMENTS = ("Cl", "Cm", "Cn")
_NO_LEVER = 1e-12  # lever arm relative to the distance of the points, below which it is rounding


@dataclass(frozen=True)
class Lever:
    """Lever of a force coefficient for a moment coefficient.

    Attributes
    ----------
    axes : str
        Force axes.
    force, moment : str
        Coefficients.
    arm : array (3,)
        Vector from the new point to the old one over the reference length, body axes.
    """

    axes: str
    force: str
    moment: str
    arm: np.ndarray

    def at(self, alpha: Any, beta: Any) -> np.ndarray:
        """Return the component of arm x e, with e the direction of the force in body axes."""
        sa, ca = np.sin(alpha), np.cos(alpha)
        sb, cb = 0.0, 1.0
        if self.axes == "wind":
            sb, cb = np.sin(beta), np.cos(beta)
        # Directions in body axes, x forward, z down.  Wind axes are also turned by beta.
        e = {
            "CL": (sa, 0.0, -ca),
            "CD": (-ca * cb, -sb, -sa * cb),
            "CY": (-ca * sb, cb, -sa * sb),
            "CX": (1.0, 0.0, 0.0),
            "CZ": (0.0, 0.0, 1.0),
        }[self.force]
        # Component i of a cross product, with j and k the next two axes.
        i = MOMENTS.index(self.moment)
        j, k = (i + 1) % 3, (i + 2) % 3
        return np.asarray(self.arm[j] * e[k] - self.arm[k] * e[j])

    def angles(self) -> list[str] | None:
        """Return the angles that the lever depends on, None if it is zero everywhere."""
        # The lever is a sum of sines: seven samples of each angle show every dependence.
        samples = np.linspace(-1.5, 1.5, 7)
        lever = np.broadcast_to(self.at(samples[:, None], samples), (7, 7))
        rounding = _NO_LEVER * float(np.linalg.norm(self.arm))
        if not (np.abs(lever) > rounding).any():
            return None
        angles = []
        for axis, angle in enumerate(("alpha", "beta")):
            if np.ptp(lever, axis=axis).max() > rounding:
                angles.append(angle)
        return angles
