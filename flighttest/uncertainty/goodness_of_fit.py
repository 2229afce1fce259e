"""How well a prediction follows a measurement, in the numbers that reports print.

Samples where either signal is NaN are left out.  Every metric takes the measured signal first.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft Using Flight Data, eq. (36), (37).
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015 (Theil's coefficient, its proportions).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flightmech.errors import IdentificationError, UnknownName
from flightmech.support.arrays import rms

if TYPE_CHECKING:
    import pandas as pd


class Shares(NamedTuple):
    """Parts of the mean square error that are bias, unequal spread and lack of correlation; their sum is one."""

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
        1 for a perfect prediction, 0 for one that is no better than the mean, negative for a worse one. [1]

    Raises
    ------
    IdentificationError
        Signals of different lengths, fewer than two samples in common, or a measurement that is constant.
    """
    z, y = _pair(measured, predicted)
    return 1.0 - float(((z - y) ** 2).sum() / _nonzero(((z - z.mean()) ** 2).sum()))


def nrmse(measured, predicted) -> float:
    """Return the rms error over the range of the measurement, [Gresham] eq. (37). [%]

    Parameters and errors as in `r_squared`.
    """
    z, y = _pair(measured, predicted)
    return 100.0 * rms(z - y) / _nonzero(np.ptp(z))


def theil(measured, predicted) -> float:
    """Return Theil's inequality coefficient rms(z - y)/(rms(z) + rms(y)).

    Returns
    -------
    float
        0 for a perfect prediction, 1 for the worst; below 0.3 counts as good. [1]

    Notes
    -----
    This is the standard form, and the one that the numbers of [Gresham] Tables 4 and 5 were computed with.  Its eq. (36) as
    printed has one root over the sum of both squares: `theil_single_root`.

    Examples
    --------
    >>> theil([1.0, -1.0], [1.0, -1.0]), theil([1.0, -1.0], [-1.0, 1.0])
    (0.0, 1.0)
    """
    z, y = _pair(measured, predicted)
    return rms(z - y) / _nonzero(rms(z) + rms(y))


def theil_single_root(measured, predicted) -> float:
    """Return [Gresham] eq. (36) as printed, rms(z - y)/sqrt(mean z^2 + mean y^2): 0 to sqrt(2). [1]

    Parameters and errors as in `r_squared`.
    """
    z, y = _pair(measured, predicted)
    return rms(z - y) / _nonzero(np.hypot(rms(z), rms(y)))


def theil_shares(measured, predicted) -> Shares:
    """Return what the mean square error consists of: different means, different spreads, lack of correlation.

    Raises
    ------
    IdentificationError
        As in `r_squared`; also when the signals agree exactly, which leaves nothing to divide.
    """
    z, y = _pair(measured, predicted)
    total = _nonzero(((z - y) ** 2).mean())
    bias, spread = (z.mean() - y.mean()) ** 2, (z.std() - y.std()) ** 2
    rest = 2.0 * (z.std() * y.std() - ((z - z.mean()) * (y - y.mean())).mean())
    return Shares(float(bias / total), float(spread / total), float(rest / total))


METRICS = {"TIC": theil, "NRMSE": nrmse, "R2": r_squared}
_TITLES = {
    "TIC": "Theil's inequality coefficient (TIC): 0 is perfect, below 0.3 good",
    "NRMSE": "rms error over the range of the measurement (NRMSE) [%]: 0 is perfect",
    "R2": "coefficient of determination (R2): 1 is perfect",
}


def validation_table(measured: Mapping[str, Any], predicted: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """Return the metrics of one or several models against one record, laid out as [Gresham] Tables 4 and 5.

    Parameters
    ----------
    measured : mapping of str to array (time,)
        Signals by name; a Dataset will do.
    predicted : mapping of str to mapping of str to array (time,)
        Model by model, the predictions of the same signals; the signals of the first model are the columns.

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
    import pandas as pd

    if not predicted:
        raise IdentificationError("no prediction to compare; give at least one model")
    columns = list(map(str, next(iter(predicted.values()))))
    for what, signals in {"the record": measured, **predicted}.items():
        for name in columns:
            if name not in signals:
                raise UnknownName(name, map(str, signals), "signal", f"{what} does not hold it")
    rows = {
        (metric, model): [function(np.asarray(measured[name]), np.asarray(signals[name])) for name in columns]
        for metric, function in METRICS.items()
        for model, signals in predicted.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).set_axis(
        pd.MultiIndex.from_tuples(rows, names=["metric", "model"]), axis="index"
    )


def validation_report(table: pd.DataFrame) -> str:
    """Return a `validation_table` as text: one block per metric, one line per model."""
    width = max(len(str(model)) for model in table.index.get_level_values("model")) + 2
    lines = [" " * width + "".join(f"{name:>10}" for name in table.columns)]
    for metric, rows in table.groupby(level="metric", sort=False):
        lines.append(_TITLES.get(str(metric), str(metric)))
        lines += [f"{model!s:<{width}}" + "".join(f"{value:>10.4f}" for value in row) for (_, model), row in zip(rows.index, rows.values)]
    return "\n".join(lines)


def _pair(measured, predicted) -> tuple[np.ndarray, np.ndarray]:
    z, y = np.asarray(measured, float), np.asarray(predicted, float)
    if z.shape != y.shape or z.ndim != 1:
        raise IdentificationError(f"signals of shape {z.shape} and {y.shape} cannot be compared; put both on one clock first")
    good = np.isfinite(z) & np.isfinite(y)
    if good.sum() < 2:
        raise IdentificationError(f"{good.sum()} samples with both signals; at least 2 are needed")
    return z[good], y[good]


def _nonzero(size) -> float:
    if not size > 0.0:
        raise IdentificationError("the signals do not move, so that nothing can be divided by; choose a record with a manoeuvre")
    return float(size)
