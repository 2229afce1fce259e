"""Power changes cut out of a flight: from rest to rest."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from .schedule import SAME, resting

SETTLED = 2.0  # time over which lever and speeds must have rested [s]
STEADY = 0.01  # range of a spool's speed that counts as rest
WINDOW_MARGIN = 1.0  # at rest, kept at both ends [s]
LEAST = 0.3  # range of the throttle that counts as a power change


def power_changes(record: xr.Dataset, least: float = LEAST, longest: float = 90.0) -> list[xr.Dataset]:
    """Return the power changes of a flight, each from one settled state of the engine to another.

    Parameters
    ----------
    record : Dataset (time,)
        ``throttle`` and ``n2`` [1] on a uniform clock, as `engine_channels` returns them.  It counts as begun with the engine settled:
        where the lever moves in its first second, the first sample is held before.
    least : float
        Smallest range of the throttle.
    longest : float
        Changes that last longer are left out: a lever that moves on and on. [s]

    Returns
    -------
    list of Dataset (time,)
        Attribute ``record`` with the time at which it begins; empty when there is none.

    Raises
    ------
    IdentificationError
        ``throttle`` or ``n2`` is missing.
    """
    missing = [name for name in ("throttle", "n2") if name not in record]
    if missing:
        raise IdentificationError(f"power changes are found by throttle and n2; the record lacks {' '.join(missing)}")
    time = record["time"].values
    step = float(np.median(np.diff(time)))
    still = resting(record, SETTLED, SAME)
    for name in ("n1", "n2"):
        if name in record:
            still &= resting(record.assign(throttle=record[name]), SETTLED, STEADY)
    margin = round(WINDOW_MARGIN / step)
    found = []
    for begin, end in _moving(still, 2 * margin):
        part = np.arange(begin - margin, min(end + margin, len(time)))
        change = record.isel(time=np.maximum(part, 0)).assign_coords(time=time[0] + step * part)
        if np.ptp(change["throttle"].values) < least or len(part) * step > longest:
            continue
        name = f"{record.attrs.get('record', 'record')} from {time[max(part[0], 0)]:.4g} s"
        found.append(change.assign_attrs(record=name))
    return found


def _moving(still: np.ndarray, least: int) -> list[tuple[int, int]]:
    """Begin and end of what is not at rest; a rest of fewer than `least` samples does not count."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], still, [True]]).astype(int))).reshape(-1, 2)
    joined: list[tuple[int, int]] = []
    for begin, end in edges.tolist():
        if joined and begin - joined[-1][1] < least:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((begin, end))
    return joined
