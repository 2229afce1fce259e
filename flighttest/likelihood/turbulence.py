"""Whether the residuals of an output-error fit are noise of instruments or a disturbance of the motion."""

from __future__ import annotations

import warnings

import xarray as xr

from flightmech.errors import AeromatchWarning

LOUD = 2.0  # disturbance over the noise from sample to sample
LASTING = 0.25  # correlation time from which a disturbance is one of the motion [s]
OUTPUTS = 2  # so many outputs show it: a gust moves more than one


def turbulence(noise: xr.Dataset) -> tuple[str, ...]:
    """Return a warning when open-loop fitting will fail, as texts; empty when the residuals are noise of instruments.

    Parameters
    ----------
    noise : Dataset (output,)
        ``slow``, ``fast`` and ``time`` as in `OutputError`.

    Notes
    -----
    Noise of instruments is nearly white and belongs to one output.  What moves the aeroplane lasts as long as its modes and shows in
    several outputs at once.  It is called turbulence when two outputs carry a disturbance of more than twice the noise between neighbouring
    samples, correlated over 0.25 s and more.  A term that the model lacks looks the same: the residuals over the inputs tell which.
    """
    loud = [
        f"{name} ({float(noise['slow'].sel(output=name)) / max(float(noise['fast'].sel(output=name)), 1e-300):.1f} times its noise, "
        f"{float(noise['time'].sel(output=name)):.2g} s)"
        for name in noise["output"].values
        if float(noise["slow"].sel(output=name)) > LOUD * float(noise["fast"].sel(output=name))
        and float(noise["time"].sel(output=name)) > LASTING
    ]
    if len(loud) < OUTPUTS:
        return ()
    return (
        f"turbulence or a missing term: residuals of {', '.join(loud)} are a disturbance of the motion; fitted open loop the estimates are "
        "biased and scatter more than they tell. Use flighttest.filter_error, equation error, or a record in calm air",
    )


def warned(noise: xr.Dataset) -> tuple[str, ...]:
    """Return what `turbulence` finds, after a warning to the caller of the fit."""
    found = turbulence(noise)
    for text in found:
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return found
