"""Agreement of a prediction with a measurement, in the figures that reports print.

Samples without a measurement are ignored. A prediction without a value at a measured sample is an
error: the figures of a run up to its divergence would be those of a good model. Every function
takes the measured signal first.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft
   Using Flight Data, eq. (36), (37).
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015 (Theil's
   coefficient, its proportions).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from flightmech.errors import IdentificationError, UnknownName
from flightmech.support.arrays import rms


class TheilShares(NamedTuple):
    """Proportions of the mean square error [Jategaonkar]_; their sum is one.

    Attributes
    ----------
    bias : float
        Share of the different means.
    variance : float
        Share of the different standard deviations.
    covariance : float
        Share of the missing correlation.
    """

    bias: float
    variance: float
    covariance: float


def r_squared(measured, predicted) -> float:
    """Return the coefficient of determination, 1 - sum((z - y)^2)/sum((z - mean z)^2).

    Parameters
    ----------
    measured, predicted : array (time,)
        Signals z and y, of the same unit.

    Returns
    -------
    float
        1 for a perfect prediction, 0 for one as good as the mean, negative for a worse one. [1]

    Raises
    ------
    IdentificationError
        Signals of different lengths, fewer than two samples in common, a constant measurement, or a
        prediction without a value.
    """
    z, y = _common_samples(measured, predicted)
    return 1.0 - float(((z - y) ** 2).sum() / _demand_positive(((z - z.mean()) ** 2).sum()))


def nrmse(measured, predicted) -> float:
    """Return the rms error over the range of the measurement, [Gresham]_ eq. (37). [%]

    Parameters and errors as in `r_squared`.
    """
    z, y = _common_samples(measured, predicted)
    return 100.0 * rms(z - y) / _demand_positive(np.ptp(z))


def theil(measured, predicted) -> float:
    """Return Theil's inequality coefficient rms(z - y)/(rms(z) + rms(y)).

    Returns
    -------
    float
        0 for a perfect prediction, 1 for the worst; below 0.3 counts as good [Jategaonkar]_. [1]

    Notes
    -----
    This is the standard form. The numbers of [Gresham]_ Tables 4 and 5 agree with it. Eq. (36) as
    printed there has one root over the sum of both squares: `theil_single_root`.

    Examples
    --------
    >>> theil([1.0, -1.0], [1.0, -1.0]), theil([1.0, -1.0], [-1.0, 1.0])
    (0.0, 1.0)
    """
    z, y = _common_samples(measured, predicted)
    return rms(z - y) / _demand_positive(rms(z) + rms(y))


def theil_single_root(measured, predicted) -> float:
    """Return [Gresham]_ eq. (36) as printed, rms(z - y)/sqrt(mean z^2 + mean y^2). [1]

    The range is 0 to sqrt(2). Parameters and errors as in `r_squared`.
    """
    z, y = _common_samples(measured, predicted)
    return rms(z - y) / _demand_positive(np.hypot(rms(z), rms(y)))


def theil_shares(measured, predicted) -> TheilShares:
    """Return the proportions of the mean square error: bias, variance and covariance.

    Raises
    ------
    IdentificationError
        As in `r_squared`; also if the signals agree exactly, so that the error is zero.
    """
    z, y = _common_samples(measured, predicted)
    total = _demand_positive(((z - y) ** 2).mean())
    # mean (z - y)^2 = (mean z - mean y)^2 + (s_z - s_y)^2 + 2 (s_z s_y - cov(z, y))
    bias, spread = (z.mean() - y.mean()) ** 2, (z.std() - y.std()) ** 2
    covariance = ((z - z.mean()) * (y - y.mean())).mean()
    uncorrelated = 2.0 * (z.std() * y.std() - covariance)
    return TheilShares(float(bias / total), float(spread / total), float(uncorrelated / total))


METRICS = {"TIC": theil, "NRMSE": nrmse, "R2": r_squared}
_TITLES = {
    "TIC": "Theil's inequality coefficient (TIC): 0 is perfect, below 0.3 good",
    "NRMSE": "rms error over the range of the measurement (NRMSE) [%]: 0 is perfect",
    "R2": "coefficient of determination (R2): 1 is perfect",
}


def validation_table(
    measured: Mapping[str, Any], predicted: Mapping[str, Mapping[str, Any]]
) -> pd.DataFrame:
    """Return the metrics of one or several models against one record.

    The layout is that of [Gresham]_ Tables 4 and 5.

    Parameters
    ----------
    measured : mapping of str to array (time,)
        Signals by name; a Dataset is accepted.
    predicted : mapping of str to mapping of str to array (time,)
        Predictions of the same signals, by model. The signals of the first model are the columns.

    Returns
    -------
    DataFrame
        Index (``metric``, ``model``) with the metrics TIC, NRMSE [%] and R2, one column per signal.

    Raises
    ------
    UnknownName
        A signal that a model or the record does not have.
    IdentificationError
        As in `r_squared`.
    """
    if not predicted:
        raise IdentificationError("no prediction to compare; give at least one model")
    columns = list(map(str, next(iter(predicted.values()))))
    for holder, signals in {"the record": measured, **predicted}.items():
        for name in columns:
            if name not in signals:
                raise UnknownName(name, map(str, signals), "signal", f"{holder} does not hold it")
    # One row per metric and model: the metrics are the outer index, as in the tables of [Gresham]_.
    rows: dict[tuple[str, str], list[float]] = {}
    for metric, function in METRICS.items():
        for model, signals in predicted.items():
            row = []
            for name in columns:
                row.append(function(np.asarray(measured[name]), np.asarray(signals[name])))
            rows[metric, model] = row
    index = pd.MultiIndex.from_tuples(rows, names=["metric", "model"])
    table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
    return table.set_axis(index, axis="index")


def validation_report(table: pd.DataFrame) -> str:
    """Return a `validation_table` as text: one block per metric, one line per model."""
    width = max(len(str(model)) for model in table.index.get_level_values("model")) + 2
    lines = [" " * width + "".join(f"{name:>10}" for name in table.columns)]
    for metric, rows in table.groupby(level="metric", sort=False):
        lines.append(_TITLES.get(str(metric), str(metric)))
        for (_, model), row in zip(rows.index, rows.values):
            lines.append(f"{model!s:<{width}}" + "".join(f"{value:>10.4f}" for value in row))
    return "\n".join(lines)


def _common_samples(measured, predicted) -> tuple[np.ndarray, np.ndarray]:
    """Return both signals at the measured samples."""
    # A broadcast of different shapes would compare samples of different times.
    z, y = np.asarray(measured, float), np.asarray(predicted, float)
    if z.shape != y.shape or z.ndim != 1:
        raise IdentificationError(
            f"signals of shape {z.shape} and {y.shape} cannot be compared; put both on one "
            f"clock first"
        )
    measured_at = np.isfinite(z)
    lost = measured_at & ~np.isfinite(y)
    if lost.any():
        raise IdentificationError(
            f"the prediction has no value at {int(lost.sum())} of {int(measured_at.sum())} "
            f"measured samples, first at sample {int(lost.argmax())}: the run diverges or ends "
            f"early; give the samples before it to compare these alone"
        )
    if measured_at.sum() < 2:
        raise IdentificationError(
            f"{measured_at.sum()} samples with both signals; at least 2 are needed"
        )
    return z[measured_at], y[measured_at]


def _demand_positive(size) -> float:
    """Return a size that a metric divides by; raise if it is not positive."""
    if not size > 0.0:
        raise IdentificationError(
            "the signals do not move, so that nothing can be divided by; choose a record "
            "with a manoeuvre"
        )
    return float(size)
