"""Data compatibility: what each instrument showed, what it should have shown, and the residual
([Gresham] figure 5).

For every channel there are three signals at its readings: ``raw`` as recorded; ``corrected``, the
errors of the instrument (offset, factor, latency, position error) taken off; ``reconstructed``,
what an instrument without errors would have shown on the reconstructed path.  The vanes keep their
place on the boom and their lag, which are not errors.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, figure 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as File

import numpy as np
import pandas as pd
from scipy.stats import chi2

from flightmech.support.figures import write_figure
from flighttest.reconstruction.channel_signals import compatibility_figure
from flighttest.reconstruction.smoother import FlightPath
from flighttest.regression.uncertainty.prediction_errors import theil

LAGS = 20  # of the Ljung-Box test


def compatibility_table(path: FlightPath) -> pd.DataFrame:
    """Return one row per channel.

    Returns
    -------
    DataFrame
        ``unit readings noise before after`` (rms against the reconstructed signal, raw and
        corrected), ``theil`` (inequality coefficient of the corrected signal), ``ljung_box`` (p
        value of 20 lags of the residual; small when it is not white), ``verdict``.
    """

    rows = []
    for name, row in path.fit.iterrows():
        if name not in path.compatibility:
            continue
        signals = path.compatibility[name]
        rest = path.residuals[name].values
        rows.append(
            {
                "channel": name,
                "unit": signals.attrs.get("units", ""),
                "readings": row.readings,
                "noise": row.noise,
                "before": signals.attrs["rms_raw"],
                "after": signals.attrs["rms_corrected"],
                "theil": theil(
                    signals.sel(version="corrected").values,
                    signals.sel(version="reconstructed").values,
                ),
                "ljung_box": ljung_box(rest[np.isfinite(rest)]),
                "verdict": row.verdict,
            }
        )
    return pd.DataFrame(rows).set_index("channel")


def compatibility_report(path: FlightPath) -> str:
    """Return the table of `compatibility_table` as text."""
    head = (
        f"{'channel':12s}{'unit':>8s}{'readings':>9s}{'noise':>10s}{'rms before':>12s}{'rms after':>11s}{'Theil':>8s}{'L-B p':>7s} "
        f" verdict"
    )
    lines = [f"Data compatibility: {path.states.attrs['record']}", head]
    for name, row in compatibility_table(path).iterrows():
        numbers = f"{row.readings:9d}{row.noise:10.3g}{row.before:12.4g}{row.after:11.4g}{row.theil:8.4f}{row.ljung_box:7.2f}"
        lines.append(f"{name:12s}{row.unit:>8s}{numbers}  {row.verdict}")
    return "\n".join(lines)


def ljung_box(rest: np.ndarray, lags: int = LAGS) -> float:
    """Return the p value of the Ljung-Box test of white residuals: N (N + 2) sum rho_k^2/(N - k)
    against chi-square of `lags`.

    References
    ----------
    .. [LjungBox] Ljung, Box, Biometrika 65, 1978.
    """

    N = len(rest)
    spread = rest - rest.mean()
    power = float(spread @ spread)
    if lags + 1 >= N or power == 0.0:
        return float("nan")
    rho = np.array([float(spread[k:] @ spread[:-k]) / power for k in range(1, lags + 1)])
    return float(chi2.sf(N * (N + 2) * np.sum(rho**2 / (N - np.arange(1, lags + 1))), lags))


def draw_compatibility(
    path: FlightPath, target: str | File, channels: Sequence[str] | None = None
) -> None:
    """Draw raw, corrected and reconstructed signal of each channel over time ([Gresham] figure 5).

    Parameters
    ----------
    path : Path
    target : path
        File to write; its ending names the format (png, svg, pdf).
    channels : sequence of str, optional
        All measured channels without it.

    Raises
    ------
    UnknownName
        A channel that was not measured.
    SchemaError
        A format that is not drawn.
    AeromatchError
        matplotlib is not installed.
    """
    figure = compatibility_figure(path.compatibility, str(path.states.attrs["record"]), channels)
    write_figure(figure, target, dpi=150)
