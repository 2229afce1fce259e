"""Data compatibility: table, report and figure of the channels of a path ([Gresham] figure 5).

Every channel has three signals at its readings. ``raw`` is as recorded. ``corrected`` has no errors
of the instrument (offset, factor, latency, position error). ``reconstructed`` is the reading of an
ideal instrument on the reconstructed path. The vanes keep their position on the boom and their lag,
which are not errors.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, figure 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as File

import numpy as np
import pandas as pd
import scipy

from flightmech.support.figures import write_figure
from flighttest.reconstruction.channel_signals import compatibility_figure
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.regression.uncertainty.prediction_errors import theil

LAGS = 20  # of the Ljung-Box test


def compatibility_table(path: FlightPath) -> pd.DataFrame:
    """Return one row per channel.

    Returns
    -------
    DataFrame
        ``unit readings noise before after`` (rms against the reconstructed signal, raw and
        corrected), ``theil`` (inequality coefficient of the corrected signal), ``ljung_box`` (p
        value of 20 lags of the residual; small for coloured residuals), ``verdict``.
    """
    rows = []
    for name, row in path.fit.iterrows():
        # The assumption of zero sideslip has a residual, but no signals.
        if name not in path.compatibility:
            continue
        signals = path.compatibility[name]
        corrected = signals.sel(version="corrected").values
        reconstructed = signals.sel(version="reconstructed").values
        # NaN where the channel has no reading
        residuals = path.residuals[name].values
        residuals = residuals[np.isfinite(residuals)]
        rows.append(
            {
                "channel": name,
                "unit": signals.attrs.get("units", ""),
                "readings": row.readings,
                "noise": row.noise,
                "before": signals.attrs["rms_raw"],
                "after": signals.attrs["rms_corrected"],
                "theil": theil(corrected, reconstructed),
                "ljung_box": ljung_box(residuals),
                "verdict": row.verdict,
            }
        )
    return pd.DataFrame(rows).set_index("channel")


def compatibility_report(path: FlightPath) -> str:
    """Return the table of `compatibility_table` as text."""
    head = (
        f"{'channel':12s}{'unit':>8s}{'readings':>9s}{'noise':>10s}{'rms before':>12s}"
        f"{'rms after':>11s}{'Theil':>8s}{'L-B p':>7s}  verdict"
    )
    lines = [f"Data compatibility: {path.states.attrs['record']}", head]
    for name, row in compatibility_table(path).iterrows():
        numbers = (
            f"{row.readings:9d}{row.noise:10.3g}{row.before:12.4g}{row.after:11.4g}"
            f"{row.theil:8.4f}{row.ljung_box:7.2f}"
        )
        lines.append(f"{name:12s}{row.unit:>8s}{numbers}  {row.verdict}")
    return "\n".join(lines)


def ljung_box(residuals: np.ndarray, lags: int = LAGS) -> float:
    """Return the p value of the Ljung-Box test of white residuals.

    Parameters
    ----------
    residuals : array (N,)
    lags : int
        Number of autocorrelations in the test.

    Returns
    -------
    float
        NaN for constant residuals, and for fewer than lags + 2 of them.

    Notes
    -----
    The test quantity N (N + 2) sum rho_k^2/(N - k) has a chi-square distribution of `lags` degrees
    of freedom.

    References
    ----------
    .. [LjungBox] Ljung, Box, Biometrika 65, 1978.
    """
    N = len(residuals)
    deviations = residuals - residuals.mean()
    power = float(deviations @ deviations)
    if lags + 1 >= N or power == 0.0:
        return float("nan")
    k = np.arange(1, lags + 1)
    rho = np.array([float(deviations[lag:] @ deviations[:-lag]) / power for lag in k])
    return float(scipy.stats.chi2.sf(N * (N + 2) * np.sum(rho**2 / (N - k)), lags))


def draw_compatibility(
    path: FlightPath, target: str | File, channels: Sequence[str] | None = None
) -> None:
    """Draw raw, corrected and reconstructed signal of each channel over time ([Gresham] figure 5).

    Parameters
    ----------
    path : FlightPath
    target : path
        File to write; its ending names the format (png, svg, pdf).
    channels : sequence of str, optional
        Channels to draw; all measured channels by default.

    Raises
    ------
    UnknownName
        A channel was not measured.
    SchemaError
        The format is not supported.
    AeromatchError
        matplotlib is not installed.
    """
    figure = compatibility_figure(path.compatibility, str(path.states.attrs["record"]), channels)
    write_figure(figure, target, dpi=150)
