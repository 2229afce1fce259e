"""Values of the drawings of a control circuit, for the regressions and for the output error."""

from __future__ import annotations

from typing import NamedTuple

from flightmech.aircraft.controls import Circuit
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.result import SHARED, IdentifiedLoading


def drawn_constants(
    identified: IdentifiedLoading, drawings: Circuit | None, error: float
) -> dict[str, tuple[float, float]]:
    """Return positive constants of the drawings with their standard errors."""
    if drawings is None:
        return {}
    return {name: (value, error * value) for name, value in identified.drawn(drawings).items()}


class DrawnValues(NamedTuple):
    """Values of the drawings for the regressions.

    Attributes
    ----------
    mass : dict of str to (float, float)
        Mass of both ends and its standard error.
    shares : dict of str to float
        First values of the shares of the surface in friction, damping and mass.
    cable : (float, float, float) or None
        Inertia of the surface, stiffness of the cables, and the error of the inertia.
    """

    mass: dict[str, tuple[float, float]]
    shares: dict[str, float]
    cable: tuple[float, float, float] | None

    @classmethod
    def of_circuit(
        cls, loading: ControlLoading, drawings: Circuit | None, error: float
    ) -> DrawnValues:
        """Return the values of a circuit with the relative error of its constants."""
        if drawings is None:
            return cls({}, {}, None)
        return cls(
            _drawn_mass(loading, drawings, error),
            _drawn_shares(loading, drawings),
            _drawn_cable(loading, drawings, error),
        )


def _drawn_mass(
    loading: ControlLoading, drawings: Circuit, error: float
) -> dict[str, tuple[float, float]]:
    """Return the mass of both ends by the drawings, and its standard error."""
    total = drawings.mass + drawings.inertia * loading.gearing**2
    return {"mass": (total, error * total)} if total > 0.0 else {}


def _drawn_shares(loading: ControlLoading, drawings: Circuit) -> dict[str, float]:
    """Return first values of the shares of the surface in friction, damping and mass."""
    shares = {}
    for total, (aft, power) in SHARED.items():
        cockpit = getattr(drawings, total)
        surface = getattr(drawings, aft) * abs(loading.gearing) ** power
        if cockpit + surface > 0.0 and total in loading.names:
            shares[total] = surface / (cockpit + surface)
    return shares


def _drawn_cable(
    loading: ControlLoading, drawings: Circuit, error: float
) -> tuple[float, float, float] | None:
    """Return inertia of the surface, stiffness of the cables, and the error of the inertia.

    The drawings give the values. They are reduced to the travel.
    """
    if not (drawings.inertia > 0.0 and drawings.cable_stiffness > 0.0):
        return None
    # Order 6 has two cables side by side.
    cables = 2.0 if drawings.order == 6 else 1.0
    return drawings.inertia * loading.gearing**2, drawings.cable_stiffness * cables, error
