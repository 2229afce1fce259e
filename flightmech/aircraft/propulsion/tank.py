"""A tank of an aircraft."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tank:
    """A tank as a mass point.

    Parameters
    ----------
    position : tuple of float (3,)
        Body axes, from the moment reference point. [m]
    capacity : float
        Greatest mass of fuel. [kg]
    order : int
        Tanks with the lowest number are emptied first. Tanks with the same number are emptied in
        proportion to their capacity.
    name : str
        Name by which engines state what feeds them: small letters, digits and ``_``.
    content : float
        Fuel in the tank at the start, for tanks that feed engines. [kg]
    """

    position: tuple[float, float, float]
    capacity: float
    order: int = 1
    name: str = ""
    content: float = 0.0
