"""Records over the ground, the terms that the ground may change, and heights of tables.

References
----------
.. [LR743] Report LR-743, 1993, section 4.5.1, eq. (11), (13), (14).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.ground_effect.laws import HEIGHT

# Height of a record without a height. [m]
FREE_AIR = 1e4
# Regressor of [LR743] eq. (14).
BANK = "CL*phi"
# Coefficients of which the ground may change all terms.
_LONGITUDINAL = ("CL", "CD", "Cm", "CX", "CZ")
LOW = 2.0
"""Height over span above which a record shows no ground effect; at 1 span it is some per cent."""


def height_breakpoints(
    h: np.ndarray, ratio: float = 1.5, least: int = 25, highest: float = 60.0
) -> np.ndarray:
    """Return breakpoints from the lowest height of the samples up to free air. [m]

    Parameters
    ----------
    h : array (samples,)
        Heights. [m]
    ratio : float
        Smallest ratio of neighbouring breakpoints.
    least : int
        Smallest number of samples between breakpoints. With fewer samples a breakpoint is omitted.
    highest : float
        Largest ratio of the last breakpoint to the first one.

    Raises
    ------
    IdentificationError
        Fewer than `least` samples near the ground.
    """
    lowest = float(h.min())
    breakpoints = [lowest]
    count = int(np.log(highest) / np.log(ratio))
    for height in lowest * ratio ** np.arange(1, count + 1):
        if np.count_nonzero((h >= breakpoints[-1]) & (h < height)) >= least:
            breakpoints.append(float(height))
    if len(breakpoints) < 2:
        raise IdentificationError(
            f"fewer than {least} samples between {lowest:.3g} and {highest * lowest:.3g} m"
        )
    return np.array(breakpoints)


def ground_terms(model: RegressionModel) -> tuple[str, ...]:
    """Return the terms that the ground may change.

    These are all terms of CL, CD and Cm, [LR743] eq. (13), and the bank angle of Cl, eq. (14).

    Raises
    ------
    IdentificationError
        A coefficient for which the report has no form.
    """
    if model.coefficient in _LONGITUDINAL:
        return tuple(model.terms)
    if model.coefficient == "Cl":
        return (BANK,)
    raise IdentificationError(
        f"no form of ground effect for {model.coefficient}; name its terms in `ground`, as "
        f"{{'CY': ['beta']}}"
    )


def demand_low_flight(data: Sequence[xr.Dataset], b: float) -> None:
    """Raise if no manoeuvre comes near the ground.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        Manoeuvres; those without a height are in free air.
    b : float
        Span. [m]

    Raises
    ------
    IdentificationError
        The least height over the runway is more than `LOW` spans.
    """
    heights = [np.asarray(item[HEIGHT].values, float) for item in data if HEIGHT in item]
    least = min((float(np.nanmin(h)) for h in heights), default=np.nan)
    if least > LOW * b:
        raise IdentificationError(
            f"the least height over the runway is {least:.4g} m, {least / b:.3g} spans; above "
            f"{LOW:g} spans the ground has no effect that flight shows: give landings or low "
            f"passes, and check the elevation of the runway"
        )


def with_heights(data: Sequence[xr.Dataset], names: Sequence[str]) -> list[xr.Dataset]:
    """Return manoeuvres that all have a height; one without it is in free air.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        Manoeuvres, some of them with a height over the runway.
    names : sequence of str
        Names of the manoeuvres, for messages.

    Raises
    ------
    IdentificationError
        No manoeuvre with a height, or a height that is not positive.
    """
    if not any(HEIGHT in manoeuvre for manoeuvre in data):
        raise IdentificationError(
            f"no manoeuvre has {HEIGHT}; reconstruct with runway_elevation, so that heights "
            f"over the runway are known"
        )
    records = []
    for manoeuvre, name in zip(data, names):
        if HEIGHT not in manoeuvre:
            records.append(manoeuvre.assign({HEIGHT: FREE_AIR}))
            continue
        h = np.asarray(manoeuvre[HEIGHT].values, float)
        if (h <= 0.0).any():
            raise IdentificationError(
                f"{name}: {HEIGHT} falls to {np.nanmin(h):.3g} m; h^s needs heights above "
                f"zero: cut it at the touch-down"
            )
        records.append(manoeuvre)
    return records
