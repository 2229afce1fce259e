"""Records of whole test points divided into what the hand drives and what moves freely."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import xarray as xr

from flightmech.errors import UnknownName

LEAD = 0.5  # s of rest before a pulse or release
_SHORTEST = 1.0  # s of a driven stretch


def driven_and_free(states: xr.Dataset, manoeuvres: pd.DataFrame, free: Sequence[str]) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    """Return the stretches of a record in which the hand drives the control, and its pulses and releases.

    Parameters
    ----------
    states : Dataset (time,)
        States with the channels of the cockpit, see `identify_control_loading`.
    manoeuvres : DataFrame
        ``manoeuvre start end`` of the record, see `flighttest.manoeuvres`.
    free : sequence of str
        Names of the manoeuvres that are pulses and releases of this control.

    Raises
    ------
    UnknownName
        None of the names is among the manoeuvres.

    Examples
    --------
    >>> import numpy as np, pandas as pd, xarray as xr
    >>> time = np.arange(0.0, 10.0, 0.02)
    >>> states = xr.Dataset({"column": ("time", 0.0 * time)}, {"time": time})
    >>> listed = pd.DataFrame({"manoeuvre": ["sweep", "release"], "start": [0.0, 5.0], "end": [5.0, 8.0]})
    >>> driven, free = driven_and_free(states, listed, ["release"])
    >>> [(float(one.time[0]), float(one.time[-1])) for one in driven]
    [(0.0, 5.0), (8.0, 9.98)]
    """
    known = list(dict.fromkeys(manoeuvres["manoeuvre"]))
    if not set(free) & set(known):
        raise UnknownName(", ".join(free), known, "manoeuvre", "the record has none of them")
    chosen = manoeuvres[manoeuvres["manoeuvre"].isin(list(free))].sort_values("start")
    first, end = float(states["time"].values[0]), float(states["time"].values[-1])
    starts, ends = (chosen[name].to_numpy(float).tolist() for name in ("start", "end"))
    edges = [first, *(x for pair in zip(starts, ends) for x in pair), end]
    driven = [states.sel(time=slice(a, b)) for a, b in zip(edges[::2], edges[1::2]) if b - a > _SHORTEST]
    return driven, [states.sel(time=slice(max(a - LEAD, first), b)) for a, b in zip(starts, ends)]
