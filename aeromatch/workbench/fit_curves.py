"""Curves of a fit for the workbench: partial regression, spectrum, and lines along the windows."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

import flighttest
from aeromatch.workbench.channels.spectra import average_densities
from flightmech.errors import UnknownName
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    select_stretches,
    stack_complex,
    transform_columns,
)
from flighttest.regression.equation_error.least_squares import weight_roots
from flighttest.regression.equation_error.samples import RegressionSamples

# Longest segment of the spectrum, in samples.
_SEGMENT = 1024
# A time step longer than this multiple of the usual step is a gap.
_GAP = 1.5


def added_variable_residuals(
    fit: flighttest.Fit, term: str, band: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals of a regressor and of the coefficient on all other regressors.

    The residuals have the weights of the fit.

    Parameters
    ----------
    fit : Fit
    term : str
    band : (low, high), optional
        Band of a fit in frequency. [Hz]

    Returns
    -------
    regressor, coefficient : ndarray (sample,)
        For a fit in frequency (equation,): real and imaginary parts of the transforms at its
        frequencies.

    Raises
    ------
    UnknownName
        The fit does not have the term, or the term is the constant of a fit in frequency, which is
        estimated in time.
    """
    terms = [str(name) for name in fit.estimates["term"].values]
    X, z = fit.regressors.values, fit.data[fit.model.coefficient].values
    if band is not None:
        slopes = [j for j, name in enumerate(terms) if name != "1" and not name.startswith("1[")]
        terms = [terms[j] for j in slopes]
        X, z = in_frequency(fit, band, X[:, slopes], z)
    else:
        root, _ = weight_roots(fit.estimates.attrs["weights"], X, z, fit.data)
        X, z = X * root[:, None], z * root
    if term not in terms:
        raise UnknownName(term, terms, "term")
    j = terms.index(term)
    # The columns of Q span the other regressors; I - Q Q' removes their part.
    Q, _ = np.linalg.qr(np.delete(X, j, axis=1))
    return X[:, j] - Q @ (Q.T @ X[:, j]), z - Q @ (Q.T @ z)


def in_frequency(
    fit: flighttest.Fit, band: tuple[float, float], X: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations of a fit in frequency, (equation, terms) and (equation,).

    They are the transforms of the regressors `X` and of the coefficient `z` in a band. [Hz]
    """
    window, time = fit.data["manoeuvre"].values, fit.data["time"].values
    steps = []
    for k in range(fit.estimates.attrs["manoeuvres"]):
        steps.append(float(np.median(np.diff(time[window == k]))))
    stretches = select_stretches(RegressionSamples(fit.data, steps), band)
    regressors = stack_complex(transform_columns(X, stretches))
    coefficient = stack_complex(transform_columns(z[:, None], stretches))
    return regressors, coefficient[:, 0]


def power_spectral_densities(fit: flighttest.Fit) -> dict[str, Any]:
    """Return the power spectral densities of coefficient and residual, by the method of Welch.

    The segments are those of `average_densities`, 1024 samples at most.

    Returns
    -------
    dict
        ``frequency`` [Hz], ``measured`` and ``residual`` [1/Hz], ``segments``, ``left_out``
        (stretches), ``white``: the level of a white residual of the same variance.
    """
    stretches = find_stretches(fit)
    lines = {"measured": fit.data[fit.model.coefficient].values, "residual": fit.residual}
    spectra = average_densities(lines, stretches, _SEGMENT)
    residual = np.concatenate([lines["residual"][piece] for piece in spectra["used"]])
    return {
        "frequency": spectra["frequency"],
        **spectra["densities"],
        "white": 2.0 * spectra["step"] * float(np.var(residual)),
        "segments": spectra["segments"],
        "left_out": spectra["left_out"],
    }


def find_stretches(fit: flighttest.Fit) -> list[tuple[slice, float]]:
    """Return the stretches without a gap, each inside one window, and their intervals. [s]"""
    time, window = fit.data["time"].values, fit.data["manoeuvre"].values
    step = np.diff(time)
    usual: dict[int, float] = {}
    for k in np.unique(window):
        if np.sum(window == k) > 1:
            usual[k] = float(np.median(step[(window[1:] == k) & (window[:-1] == k)]))
    limit = np.array([_GAP * usual.get(k, 0.0) for k in window[1:]])
    cuts = np.flatnonzero((np.diff(window) != 0) | (step > limit)) + 1
    edges = [0, *cuts.tolist(), len(time)]
    # A single sample between two gaps is not a stretch.
    return [(slice(a, b), usual[window[a]]) for a, b in pairwise(edges) if b - a > 1]


def lines_along_windows(
    fit: flighttest.Fit,
) -> tuple[np.ndarray, list[tuple[float, float]], dict[str, np.ndarray]]:
    """Return measured, fitted and residual coefficient along the windows, one after the other.

    Returns
    -------
    time : ndarray (n,)
        Time along the windows, without the gaps. [s]
    edges : list of (float, float)
        Start and end of each window. [s]
    lines : dict of str to ndarray (n,)
        ``measured``, ``fitted``, ``residual``; NaN at the end of each stretch.
    """
    measured, residual = fit.data[fit.model.coefficient].values, fit.residual
    time, window = fit.data["time"].values, fit.data["manoeuvre"].values
    times: list[Any] = []
    indices: list[Any] = []
    edges: dict[int, tuple[float, float]] = {}
    now = 0.0
    for piece, step in find_stretches(fit):
        stretch = now + time[piece] - time[piece.start]
        # A window may have several stretches; it begins with the first and ends with the last.
        k = int(window[piece.start])
        first = edges[k][0] if k in edges else float(stretch[0])
        edges[k] = first, float(stretch[-1])
        # The index -1 marks the end of the stretch, where the lines are broken.
        times += [stretch, [stretch[-1] + 0.5 * step]]
        indices += [np.arange(piece.start, piece.stop), [-1]]
        now = float(stretch[-1]) + step
    index = np.concatenate(indices).astype(int)
    lines = {"measured": measured, "fitted": measured - residual, "residual": residual}
    broken = {name: np.where(index < 0, np.nan, line[index]) for name, line in lines.items()}
    # A window without a stretch is empty, at the end.
    windows = range(fit.estimates.attrs["manoeuvres"])
    return np.concatenate(times), [edges.get(k, (now, now)) for k in windows], broken
