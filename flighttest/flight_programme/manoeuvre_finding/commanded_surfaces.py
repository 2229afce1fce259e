"""Part of a surface that the pilot moves, where a damper moves the surface too.

A yaw damper answers each rudder doublet with movements of its own.  They stand close to the steps
of the pilot, and the doublet no longer has rest before and after its steps.  The pedals show
it as it was flown.
"""

from __future__ import annotations

import numpy as np

from flighttest.reconstruction.quality.checks.signals import ResampledChannels

# Position of the pilot's control by surface.  Forces also hold the loads of the air.
_HANDS = {"delta_e": "column", "delta_a": "wheel", "delta_r": "pedal"}
# Correlation of surface and control below which the control does not command it: our number.
_COMMANDS = 0.1


def commanded_part(signals: ResampledChannels, surface: str) -> np.ndarray | None:
    """Return the deflection of a surface that the position of the pilot's control commands.

    Parameters
    ----------
    signals : ResampledChannels
        With the surface [rad], and ``column``, ``wheel`` or ``pedal`` [rad, m] if recorded.
    surface : str
        ``delta_e``, ``delta_a`` or ``delta_r``.

    Returns
    -------
    array (time,) or None
        Gearing, by least squares over the record, times the control, about their means. [rad]
        None if the control is not recorded or does not command the surface.
    """
    hand = _HANDS[surface]
    if hand not in signals:
        return None
    x, y = signals[hand], signals[surface]
    known = np.isfinite(x) & np.isfinite(y)
    if not known.all() or not np.ptp(x) > 0.0 or not np.ptp(y) > 0.0:
        return None
    x, y = x - x.mean(), y - y.mean()
    correlation = abs(float(x @ y)) / np.sqrt(float(x @ x) * float(y @ y))
    if correlation < _COMMANDS:
        return None
    return x * float(x @ y) / float(x @ x)
