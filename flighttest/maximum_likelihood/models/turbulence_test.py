"""Whether the residuals of an output-error fit are noise of instruments or a disturbance of the motion."""

from __future__ import annotations

import warnings

import xarray as xr

from flightmech.errors import AeromatchWarning

LOUD = 2.0  # disturbance over the noise from sample to sample
FELT = 1e-3  # part of the motion below which a disturbance does not matter
BLOCKS = 2.0  # and blocks: a recorder below 12 Hz has one sample per block, and its white noise lasts as long as that
LASTING = 0.25  # correlation time from which a disturbance is one of the motion [s]
OUTPUTS = 2  # so many outputs show it: a gust moves more than one


def turbulence(noise: xr.Dataset) -> tuple[str, ...]:
    """Return a warning when open-loop fitting will fail, as texts; empty when the residuals are noise of instruments.

    Parameters
    ----------
    noise : Dataset (output,)
        ``slow``, ``fast``, ``time``, ``motion`` and ``block`` as in `OutputError`.

    Notes
    -----
    Noise of instruments is nearly white and belongs to one output.  What moves the aeroplane lasts as long as its modes and
    shows in several outputs at once.  It is called turbulence when two outputs carry a disturbance of more than twice the noise
    between neighbouring samples, correlated over 0.25 s and two blocks and more, and above a thousandth of the motion.  A term that the
    model lacks looks the same: the residuals over the inputs show which.
    """
    loud = []
    columns = [noise[key].values for key in ("output", "slow", "fast", "time", "motion", "block")]
    for name, slow, fast, time, motion, block in zip(*columns):
        if slow > LOUD * fast and time > max(LASTING, BLOCKS * block) and slow > FELT * motion:
            loud.append(f"{name} ({slow / max(fast, 1e-300):.1f} times its noise, {time:.2g} s)")
    if len(loud) < OUTPUTS:
        return ()
    return (
        f"turbulence or a missing term: residuals of {', '.join(loud)} are a disturbance of the motion; fitted open loop the estimates are "
        "biased and scatter more than they determine. "
        "Use flighttest.maximum_likelihood.filter_error, equation error, or a record in calm air",
    )


def warned(noise: xr.Dataset) -> tuple[str, ...]:
    """Return what `turbulence` finds, after a warning to the caller of the fit."""
    found = turbulence(noise)
    for text in found:
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return found
