"""Surfaces and pilot's controls that a recorder samples slowly and holds: staircases.

A value held for a second is half a second late on average.  It looks like a late clock, which a
delay in the name map would correct, but the movements between the samples are lost.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flighttest.reconstruction.quality.finding import Finding

_CHANNELS = ("delta_e", "delta_a", "delta_r", "column", "wheel", "pedal")
_LONGEST = 0.19  # s of a hold that leaves the movements of a control
_FEWEST_STEPS, _FEWEST_SAMPLES = 20, 3  # steps of a channel, and samples of a hold
_ON_TIME = 0.95  # share of the steps at whole multiples of the hold


def staircase_findings(record: xr.DataTree) -> list[Finding]:
    """Return the warnings on controls that change at every n-th sample only.

    Parameters
    ----------
    record : DataTree
        On a clock in seconds.

    Returns
    -------
    list of Finding
        Of kind ``staircase``, from a hold of 0.2 s on.
    """
    findings = []
    for leaf in record.children.values():
        data = leaf.to_dataset()
        for name in filter(data.data_vars.__contains__, _CHANNELS):
            count = held_samples(data[name].values.astype(float))
            hold = count * float(np.median(np.diff(data["time"].values)))
            if count < _FEWEST_SAMPLES or hold < _LONGEST:
                continue
            text = (
                f"{name} changes at every {count}th sample only: it is recorded at "
                f"{1.0 / hold:.3g} Hz and held, {0.5 * hold:.2g} s late on average, and its "
                f"movements between are lost"
            )
            remedy = (
                f"map a column of {name} that is recorded at 10 Hz or more; a delay in the name "
                f"map does not bring the lost movements back"
            )
            evidence = {"hold": hold}
            findings.append(
                Finding("warning", "staircase", (name,), text, remedy, evidence=evidence)
            )
    return findings


def held_samples(x: np.ndarray) -> int:
    """Return the number of samples for which a channel is held; 1 if it is not held regularly.

    Parameters
    ----------
    x : array (time,)

    Notes
    -----
    Coarse steps of a slow channel come at any sample, those of a hold at whole multiples of it.
    """
    steps = np.flatnonzero(np.diff(x) != 0.0)
    if steps.size < _FEWEST_STEPS:
        return 1
    lengths, counts = np.unique(np.diff(steps), return_counts=True)
    # A value may stay the same over a step, so that the usual length may be a multiple of the hold.
    for length in lengths[counts > 0.02 * steps.size].tolist():
        if length < _FEWEST_SAMPLES:
            return 1
        phases = np.bincount(steps % length)
        if phases.max() > _ON_TIME * steps.size:
            return int(length)
    return 1
