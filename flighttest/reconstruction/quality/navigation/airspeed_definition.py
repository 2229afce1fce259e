"""Calibrated airspeed in place of true airspeed, and the reverse.

At height both differ by a factor that pressure and temperature give.  A channel that is wrong by
just this factor has the name of the other airspeed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.headings import matching_words
from flighttest.reconstruction.quality.finding import Finding, map_entry_of
from flighttest.records.readers.channel_correction import line_of

_SIGMAS, _SAME_RATIO = 3.0, 0.02  # standard errors, and the least difference of two factors


def definition_finding(
    channel: str, scale: float, stderr: float, *, signals: ResampledChannels, record: xr.DataTree
) -> Finding | None:
    """Return the error that V holds calibrated airspeed, or V_cas true airspeed; None if neither.

    Parameters
    ----------
    channel : str
        ``V`` or ``V_cas``, the only airspeed of the record.
    scale, stderr : float
        Airspeed that follows from the channel over the one of accelerations and ground velocity,
        with its standard error. [1]
    signals : ResampledChannels
        With a pressure or a height, which give calibrated over true airspeed.
    record : DataTree
        Its name map gives the remedy.

    Returns
    -------
    Finding or None
        Its evidence ``heading`` is true if the heading of the column names the other airspeed.
    """
    other = {"V": "V_cas", "V_cas": "V"}.get(channel)
    if other is None or other in signals or "q_c" in signals:
        return None
    read = signals.values[channel]
    as_cas = signals.without((channel,)).with_values({"V_cas": read})
    as_cas = replace(as_cas, good={**as_cas.good, "V_cas": signals.good[channel]})
    formed = as_cas.completed(("V",))
    if "V" not in formed:
        return None
    mask = formed.mask(("V",)) & (read > 0.0)
    if not mask.any():
        return None
    # calibrated over true airspeed, of the level at which the record flies
    ratio = float(np.median(read[mask] / formed["V"][mask]))
    expected = ratio if channel == "V" else 1.0 / ratio
    within = max(_SIGMAS * stderr, _SAME_RATIO)
    if abs(scale - expected) > within or abs(1.0 - expected) < within:
        return None
    what = {"V": "true airspeed", "V_cas": "calibrated airspeed"}
    text = (
        f"{channel} ({what[channel]}) holds {what[other]}: it shows {scale:.3f} of the airspeed "
        f"that accelerations and ground velocity give (standard error {stderr:.3f}), and "
        f"{what[other]} would show {expected:.3f} at this pressure and temperature"
    )
    heading = ""
    remedy = f"call the column {other} in place of {channel} in the name map"
    leaf, entry, _ = map_entry_of(record, channel)
    if entry is not None:
        heading = str(record[leaf][channel].attrs.get("column", "")).rpartition("/")[2]
        remedy = f"{line_of(other, entry)}   # in [{leaf}] of the name map, in place of {channel}"
    evidence: dict[str, Any] = {"slope": scale, "stderr": stderr, "expected": expected}
    evidence["heading"] = matching_words(heading, other) == "own"
    return Finding("error", "definition", (channel,), text, remedy, evidence=evidence)
