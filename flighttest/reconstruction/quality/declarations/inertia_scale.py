"""What a record and statistics show of the moments of inertia, and what they do not.

Euler's equations hold ratios of the moments only: (Izz - Ixx)/Iyy in the pitching of fast rolls.
The aerodynamic moments, which would give the size, are unknown.
"""

from __future__ import annotations

from math import sqrt

from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import FOOT, SLUG
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.inertia import MAIN, fit_coupling, is_aeroplane
from flighttest.reconstruction.quality.finding import Finding

_SLUG = SLUG * FOOT**2
_APART, _AGREE = 4.0, 2.0  # standard errors off the file, and around the exchanged moments
_SHARPNESS = 0.25  # standard error over the difference of both coefficients
_EXCHANGE_ROW = ("inertia_exchange", "Ixx and Iyy not exchanged")
_SIZE_ROW = ("inertia_size", "moments of inertia: slug ft2 or kg m2")

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


def exchange_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the finding on exchanged Ixx and Iyy, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes, sensors at the c.g.
    aircraft : Aircraft
        Moments of inertia. [kg m2]
    """
    unchecked = _size_row(aircraft)
    # Euler: q_dot = M/Iyy + (Izz - Ixx)/Iyy p r. The motion shows this ratio.
    stated = (aircraft.Izz - aircraft.Ixx) / aircraft.Iyy
    exchanged = (aircraft.Izz - aircraft.Iyy) / aircraft.Ixx
    needed = abs(stated - exchanged)
    fit = fit_coupling(signals, aircraft)
    known = "not at all"
    if fit is not None:
        known = f"{fit.coefficient:.2f} (standard error {fit.coefficient_stderr:.2f})"
    if fit is None or fit.coefficient_stderr > _SHARPNESS * needed:
        reason = (
            f"the coupling of roll and yaw into pitch is {stated:.2f} by the aircraft file and "
            f"{exchanged:.2f} with the two exchanged; the motion shows it {known}"
        )
        return [], [(*_EXCHANGE_ROW, (), reason), *unchecked]
    error = fit.coefficient_stderr
    off, near = abs(fit.coefficient - stated), abs(fit.coefficient - exchanged)
    if off < _APART * error or near > _AGREE * error:
        return [], unchecked
    text = (
        f"rolling and yawing pitch the aeroplane by {known} of p r, which is the coefficient with "
        f"Ixx and Iyy exchanged ({exchanged:.2f}), and not that of the aircraft file ({stated:.2f})"
    )
    remedy = "exchange Ixx and Iyy in the aircraft file"
    evidence = {"coefficient": fit.coefficient, "stderr": error}
    return [
        Finding("warning", "inertia", ("Ixx", "Iyy"), text, remedy, evidence=evidence)
    ], unchecked


def _size_row(aircraft: Aircraft) -> Unchecked:
    """Return the row of units that the radii of gyration do not exclude."""
    moments = {name: float(getattr(aircraft, name)) for name in MAIN}
    radii = {name: sqrt(moments[name] / aircraft.mass) / (0.5 * aircraft.b) for name in MAIN}
    possible = []
    for text, factor in (("slug ft2 given as kg m2", _SLUG), ("the reverse", 1.0 / _SLUG)):
        if is_aeroplane(aircraft, {name: factor * moment for name, moment in moments.items()}):
            possible.append(text)
    if not possible:
        return []
    listed = ", ".join(f"{radius:.2f}" for radius in radii.values())
    reason = (
        f"{' and '.join(possible)} change all three by {_SLUG:.3g}, and the radii of gyration "
        f"({listed} of half the span) remain those of an aeroplane; motion shows ratios only: "
        f"compare with a pendulum test or a mass breakdown"
    )
    return [(*_SIZE_ROW, (), reason)]
