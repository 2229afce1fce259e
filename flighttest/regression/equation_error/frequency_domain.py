"""Equation error in frequency: the same linear model fitted to finite Fourier transforms inside a
band.

Only the band with excitation is looked at: drift, trim and the noise above the band stay out, and
there is no lag window to choose.  Every stretch is freed from its mean and trend, transformed at
the multiples of one over its duration, and divided by the root of the duration, so that long and
short stretches weigh as their information. Where the noise varies through the band, as that of
accelerations from positions does by its fourth power, the equations are weighted by the spectrum of
the residual [Whittle1953]_; without weights the noisiest frequencies decide.  What such noise leaks
from its loud frequencies into the quiet ones is a constant and multiples of j omega and 1/(j omega)
for each stretch: the differences of its integrals between the ends, and the trend taken off.  They
are estimated along. Parameters are real, so every frequency gives two real equations.  The constant
is found afterwards in time.

References
----------
.. [Morelli2006] Morelli, Practical aspects of the equation-error method for aircraft parameter estimation, AIAA 2006-6144.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 7.
.. [Whittle1953] Whittle, Estimation and information in stationary time series, Arkiv foer Matematik 2, 1953.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.stats import norm, t

from flightmech.errors import IdentificationError
from flightmech.support.arrays import rms
from flighttest.records.signals.fourier import (
    adjoint_fourier,
    finite_fourier,
    harmonics,
    remove_straight_line,
)
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.least_squares import ridge_penalty
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.samples import RegressionSamples, slopes_of, stack_samples
from flighttest.regression.equation_error.time_domain import (
    demand_choice,
    demand_determined,
    separate_intercepts,
)
from flighttest.regression.uncertainty import collinearity, significance
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

_EXCITED = 1e-6  # rms of a regressor inside the band, over its largest value, that is no rounding
_SHAPE = 2  # degree of the logarithm of the residual's spectrum over the logarithm of the frequency
_PER_SHAPE = 6  # frequencies that each degree needs
_ROUNDS, _STILL = 30, 1e-4
_WEIGHINGS, _WEIGHED = (
    50,
    1e-6,
)  # of fit and spectrum in turn; change of the logarithm of the spectrum
WEIGHTS = ("equal", "spectrum")


@dataclass(frozen=True)
class TransformedStretch:
    """Where one stretch without a gap stands in the samples and among the transformed rows."""

    samples: slice
    step: float
    frequencies: np.ndarray
    rows: slice

    @property
    def duration(self) -> float:
        """Length of the record, one step per sample. [s]"""
        return (self.samples.stop - self.samples.start) * self.step


def select_stretches(
    samples: RegressionSamples, band: tuple[float, float], spacing: float | None = None
) -> list[TransformedStretch]:
    """Return the stretches that reach down to the band, with the frequencies of each.

    Parameters
    ----------
    samples : Samples
    band : (low, high)
        Both inside; a stretch shorter than 1/low is left out. [Hz]
    spacing : float, optional
        Of the frequencies; default one over the duration of each stretch. [Hz]

    Raises
    ------
    IdentificationError
        No stretch is long enough, or the band is none.
    """
    found: list[TransformedStretch] = []
    start = 0
    for piece, step in zip(*samples.pieces()):
        duration = (piece.stop - piece.start) * step
        if duration * band[0] < 1.0 - 1e-9:
            continue
        frequencies = harmonics(duration if spacing is None else 1.0 / spacing, *band)
        found.append(
            TransformedStretch(piece, step, frequencies, slice(start, start + len(frequencies)))
        )
        start += len(frequencies)
    if not found:
        longest = max((piece.stop - piece.start) * step for piece, step in zip(*samples.pieces()))
        raise IdentificationError(
            f"no stretch is as long as 1/{band[0]:g} Hz, the longest is {longest:.3g} s; "
            f"raise the lower edge of the band"
        )
    return found


def transform_columns(columns: np.ndarray, parts: Sequence[TransformedStretch]) -> np.ndarray:
    """Return the scaled transforms of sampled columns, complex (rows, columns)."""
    rows = [
        finite_fourier(remove_straight_line(columns[part.samples]), part.step, part.frequencies)
        / np.sqrt(part.duration)
        for part in parts
    ]
    return np.concatenate(rows)


def stack_complex(values: np.ndarray) -> np.ndarray:
    """Return complex rows as real ones: real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])


def regress_frequency(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float],
    name: str = "",
    intercepts: str = "common",
    spacing: float | None = None,
    ridge: float | str = 0.0,
    weights: str = "equal",
) -> Fit:
    """Fit a model to measured coefficients by least squares over the frequencies of a band.

    Parameters
    ----------
    model : Model
        Coefficient and terms; ``1`` is the constant found in time.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them.
    band : (low, high)
        Where the excitation is: 0.1 to 2 Hz for a small aeroplane, 0.05 to 1.5 Hz for a jet. [Hz]
    name : str
        For reports and provenance.
    intercepts : {"common", "separate"}
        One constant, or one per manoeuvre.  The slopes do not know the difference: every stretch is
        freed from its mean.
    spacing : float, optional
        Of the frequencies; default one over the duration. Closer frequencies are not independent;
        standard errors account for it. [Hz]
    ridge : float or "auto"
        As in `regress`.
    weights : {"equal", "spectrum"}
        ``spectrum`` weights every frequency by the inverse of the residual's spectrum there, found
        with the fit in turn, and takes off what the ends of the stretches leak: for noise that
        grows with frequency, as that of coefficients from measured positions.

    Returns
    -------
    Fit
        ``stderr`` follows the spectrum of the residual through the band and is multiplied by
        Student's t when the frequencies are few; ``stderr_white`` takes the spectrum as flat.
        Attributes ``R2`` inside the band, without weights, ``R2_time`` over the samples, ``band``,
        ``frequencies``.

    Raises
    ------
    IdentificationError
        No stretch reaches down to the band, too few frequencies, or terms the data cannot
        distinguish.
    UnknownName
        A variable that the data do not hold.

    Notes
    -----
    theta = [Re(X* X)]^-1 Re(X* z), covariance 1/2 s^2 [Re(X* X)]^-1 with s^2 = 2 v* v/(2 M - n): each of the M frequencies
    is two real equations, so a white disturbance gets the same standard errors as in time.  [Klein2006] divides by M - n
    without the half, which makes them larger by the root of two.  Frequencies at a spacing of df below 1/T multiply the
    covariance by 1/(T df).
    """
    demand_choice("intercepts", intercepts, ("common", "separate"))
    demand_choice("weights", weights, WEIGHTS)
    samples = stack_samples(model.coefficient, model.variables, data, model)
    X, terms = model.design(samples.data), list(model.terms)
    if intercepts == "separate":
        X, terms = separate_intercepts(X, terms, samples.data["manoeuvre"].values)
    demand_determined(name, model, samples.data[model.coefficient].values, X, terms)
    parts = select_stretches(samples, band, spacing)
    found, A, change = _solve(model, samples, X, terms, parts, name, ridge, weights)
    found.attrs.update(
        name=name,
        intercepts=intercepts,
        band=f"{band[0]:g} ... {band[1]:g}",
        frequencies=sum(len(part.frequencies) for part in parts),
    )
    data = samples.kept(model.coefficient, change)
    return Fit(
        name,
        model,
        found,
        data,
        least_squares.label_terms(least_squares.equivalent_regressors(A), terms),
        least_squares.label_terms(X, terms),
    )


def demand_frequencies(
    label: str,
    rows: np.ndarray,
    X: np.ndarray,
    parts: Sequence[TransformedStretch],
    terms: Sequence[str],
) -> None:
    """Raise when the transformed equations cannot determine the terms.

    Parameters
    ----------
    label : str
        For the text.
    rows : complex array (rows, terms)
        Transformed regressors.
    X : array (samples, terms)
        Regressors in time.
    parts : sequence of Stretch
    terms : sequence of str

    Raises
    ------
    IdentificationError
        Too few frequencies, a term without excitation in the band, or combinations that vanish
        there.
    """
    if len(rows) < 2 * len(terms):
        raise IdentificationError(
            f"{label}: {len(rows)} frequencies for {len(terms)} slopes; at least two per "
            f"slope are needed: widen the band"
        )
    duration = np.concatenate([np.full(len(part.frequencies), part.duration) for part in parts])
    inside = np.sqrt(2.0 * (np.abs(rows) ** 2 / duration[:, None]).sum(axis=0) / len(parts))
    still = [
        term
        for term, own, size in zip(terms, inside, np.abs(X).max(axis=0))
        if own < _EXCITED * size
    ]
    if still:
        raise IdentificationError(
            f"{label}: {', '.join(still)} {'is' if len(still) == 1 else 'are'} not excited "
            f"inside the band; leave the term out, "
            "add a manoeuvre, or work in time"
        )
    try:
        collinearity.demand_rank(stack_complex(rows), terms)
        collinearity.demand_independence(stack_complex(rows), np.zeros(len(terms), bool), terms)
    except IdentificationError as error:
        raise IdentificationError(f"{label}: inside the band {error}") from None


def _solve(
    model: RegressionModel,
    samples: RegressionSamples,
    X: np.ndarray,
    terms: list[str],
    parts: list[TransformedStretch],
    name: str,
    ridge,
    weights: str,
):
    """The estimates, the linear map (terms, samples) from the measured coefficient to them, and
    what the common errors change.
    """
    z, fixed = samples.data[model.coefficient].values, least_squares.intercept_mask(terms)
    slopes = [term for term, constant in zip(terms, fixed) if not constant]
    if not slopes:
        raise IdentificationError(
            f"{model} has no slope; a spectrum without its mean contains no information "
            f"about a constant"
        )
    Xf, zf = transform_columns(X[:, ~fixed], parts), transform_columns(z[:, None], parts)[:, 0]
    demand_frequencies(f"{name}: {model}" if name else str(model), Xf, X[:, ~fixed], parts, slopes)
    whitened = (
        whitening_weights(Xf, zf, parts)
        if weights == "spectrum"
        else Whitened(np.ones(len(zf)), np.zeros((2 * len(zf), 0)))
    )
    root, lost = whitened.root, whitened.ends.shape[1]
    X2, z2 = whitened.equations(Xf), whitened.equations(zf[:, None])[:, 0]
    penalty, parameter = ridge_penalty(ridge, X2, z2, np.zeros(len(slopes), bool))
    theta, E = least_squares.solve_least_squares(X2, z2, penalty)
    v = whitened.residual(zf, Xf, theta)
    D = least_squares.estimator_matrix(E) * np.tile(root, 2)
    s2 = float((np.abs(v) ** 2).sum()) / (2 * len(v) - len(slopes) - lost)
    dense = np.concatenate(
        [
            np.full(len(part.frequencies), max(1.0, 1.0 / (part.duration * _spacing(part))))
            for part in parts
        ]
    )
    free = spectral_freedom(round(len(v) / dense.mean()), len(slopes) + lost)
    if weights == "equal":
        spectrum, freedom = _spectrum(v, E, parts), np.full(len(slopes), float(free))
    else:
        spectrum = _spectrum(v * root, np.hstack([E, whitened.ends]), parts)
        freedom = np.minimum(float(free), _freedom(D / np.tile(root, 2), spectrum) / dense.mean())
        spectrum = spectrum._replace(power=spectrum.power / root**2)
    grow = student_factor(freedom)
    C = (D * np.tile(spectrum.power * dense, 2)) @ D.T * np.outer(grow, grow)
    white = np.sqrt(s2 * ((D**2) * np.tile(dense, 2)).sum(axis=1))
    whole = _joined(X, z, fixed, samples, _Whole(theta, C, white, _map(D, parts, len(z)), 0.0))
    sources, errors = samples.errors(
        model.coefficient, model.variables, slopes_of(model, whole.theta)
    )
    rest = z - X @ whole.theta
    more = least_squares.regressor_diagnostics(X2, np.zeros(len(slopes), bool))
    more = _with_constants(more, terms, fixed)
    size = np.zeros(len(terms))
    size[~fixed] = np.sqrt((np.abs(Xf) ** 2).sum(axis=0) / (np.abs(zf) ** 2).sum()) * np.abs(theta)
    more["contribution"] = "term", size
    more["stderr_window"] = (
        "term",
        np.full(len(terms), np.nan),
        {"long_name": "standard error by a lag window; none in frequency"},
    )
    if parameter:
        bias = np.zeros(len(terms))
        bias[~fixed] = -np.linalg.solve(
            X2.T @ X2 + np.diag(penalty), penalty * least_squares.solve_least_squares(X2, z2)[0]
        )
        more["shrinkage"] = (
            "term",
            bias,
            {"long_name": "bias of the ridge, from the estimates without it"},
        )
    found = least_squares.regression_estimates(
        terms, whole.theta, whole.covariance, whole.white, (sources, whole.A @ errors.T), more
    )
    found.attrs = {
        "coefficient": model.coefficient,
        "domain": "frequency",
        "R2": 1.0 - float((np.abs(v) ** 2).sum() / (np.abs(zf) ** 2).sum()),
        "R2_time": 1.0 - float(rest @ rest) / float(((z - z.mean()) ** 2).sum()),
        "residual_rms": rms(rest),
        "samples": len(z),
        "manoeuvres": len(samples.steps),
        "offset": whole.offset,
        "weights": weights,
        "ridge": parameter,
        **significance.residual_whiteness(rest, *samples.pieces()),
    }
    dof, inflated = np.full(len(terms), freedom.min()), np.ones(len(terms))
    dof[~fixed], inflated[~fixed] = freedom, grow
    found = significance.add_tests(found, fixed, dof, inflated)
    return found, whole.A, errors


@dataclass(frozen=True)
class Whitened:
    """How equations are weighted by the spectrum of their noise.

    Attributes
    ----------
    root : array (rows,)
        Root of the weight of every frequency; mean one.
    ends : array (2 rows, unknowns)
        Orthonormal; what the ends of the stretches leak, weighted.
    """

    root: np.ndarray
    ends: np.ndarray

    def equations(self, columns: np.ndarray) -> np.ndarray:
        """Return transformed columns (rows, columns) as real equations (2 rows, columns): weighted,
        less what the ends leak.
        """
        found = stack_complex(columns * self.root[:, None])
        return found - self.ends @ (self.ends.T @ found) if self.ends.shape[1] else found

    def residual(self, zf: np.ndarray, Xf: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Return the residual (rows,), without weights."""
        v = zf - Xf @ theta
        if not self.ends.shape[1]:
            return v
        left = self.equations(v[:, None])[:, 0]
        return (left[: len(v)] + 1j * left[len(v) :]) / self.root


def whitening_weights(
    Xf: np.ndarray, zf: np.ndarray, parts: Sequence[TransformedStretch]
) -> Whitened:
    """Return weights by which a fit leaves a residual with a flat spectrum.

    Parameters
    ----------
    Xf : complex array (rows, terms)
        Transformed regressors.
    zf : complex array (rows,)
        Transformed coefficient.
    parts : sequence of Stretch

    Raises
    ------
    IdentificationError
        The ends of the stretches take too many of the equations.

    Notes
    -----
    Least squares with the weights 1/S and the spectrum S of its residual, see `residual_power`, in turn until S stays: the maximum of
    Whittle's likelihood of terms and spectrum together.

    Of noise v = p'', with p that of a position, the finite transform is

        v~ = -omega^2 p~ + j omega [p(T) - p(0)] + [p'(T) - p'(0)]

    Its last parts, the same two numbers at all frequencies, stand far above the first one where
    omega is small, and make the residuals of neighbouring frequencies nearly equal (correlation 0.9
    on flights from markers).  The trend taken off adds a multiple of 1/(j omega).
    """
    columns = []
    for part in parts:
        turn = 2j * np.pi * part.frequencies
        for shape in (np.ones(len(turn)), turn, 1.0 / turn)[
            : 2 * len(turn)
        ]:  # a single frequency has two equations
            columns.append(np.zeros(len(zf), complex))
            columns[-1][part.rows] = np.exp(0.5 * turn * part.step) * shape
    leaks = np.stack(columns, axis=1)
    leaks /= np.linalg.norm(leaks, axis=0)
    left = 2 * len(zf) - leaks.shape[1]
    if left < 2 * Xf.shape[1]:
        raise IdentificationError(
            f"weights='spectrum': of {2 * len(zf)} equations, two per frequency, the ends of "
            f"{len(parts)} stretches take {leaks.shape[1]}; "
            f"the {left} left for {Xf.shape[1]} slopes are less than two each: widen the "
            f"band, give longer manoeuvres or take equal weights"
        )
    X, root = np.hstack([Xf, leaks]), np.ones(len(zf))
    for _ in range(_WEIGHINGS):
        E, z = stack_complex(X * root[:, None]), stack_complex(zf * root)
        v = zf - X @ np.linalg.lstsq(E, z, rcond=None)[0]
        power = residual_power(v, E, parts)[: len(v)]
        if not power.all():
            break  # nothing is left to weigh
        before, root = root, 1.0 / np.sqrt(power)
        root /= root.mean()
        if np.abs(np.log(root / before)).max() < _WEIGHED:
            break
    return Whitened(root, np.linalg.qr(stack_complex(leaks * root[:, None]))[0])


def _spacing(part: TransformedStretch) -> float:
    return (
        float(part.frequencies[1] - part.frequencies[0])
        if len(part.frequencies) > 1
        else 1.0 / part.duration
    )


def residual_power(v: np.ndarray, E: np.ndarray, parts: Sequence[TransformedStretch]) -> np.ndarray:
    """Return the variance of each real equation (2 rows,): the residual's spectrum as a parabola in
    logarithms, less what the fit took up.

    Parameters
    ----------
    v : complex array (rows,)
        Residuals.
    E : array (2 rows, unknowns)
        Regressors as real rows, see `stack_complex`.
    parts : sequence of Stretch

    Notes
    -----
    Whittle's likelihood: power over spectrum is chi-square distributed; scoring steps of a regression with logarithmic link.
    """
    return np.tile(_spectrum(v, E, parts).power, 2)


class _Spectrum(NamedTuple):
    """Power of the residual (rows,), what its logarithm is made of (rows, unknowns), and the part
    of each row that the fit has left.
    """

    power: np.ndarray
    basis: np.ndarray
    free: np.ndarray


def _spectrum(v: np.ndarray, E: np.ndarray, parts: Sequence[TransformedStretch]) -> _Spectrum:
    leverage = (np.linalg.qr(E)[0] ** 2).sum(axis=1)
    free = np.maximum(0.05, 1.0 - 0.5 * (leverage[: len(v)] + leverage[len(v) :]))
    power = 0.5 * np.abs(v) ** 2 / free
    x = np.log(np.concatenate([part.frequencies for part in parts]))
    degree = _degree(len(v))
    basis = np.linalg.qr(np.vander((x - x.mean()) / max(np.ptp(x), 1e-9), degree + 1))[0]
    if not power.any():
        return _Spectrum(power, basis, free)
    level = np.full(len(v), np.log((power * free).sum() / free.sum()))
    for _ in range(_ROUNDS):
        change = power / np.exp(level) - 1.0
        step = basis @ np.linalg.solve(
            (basis * free[:, None]).T @ basis, (basis * free[:, None]).T @ change
        )
        level = level + np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < _STILL:
            break
    return _Spectrum(np.exp(level), basis, free)


def _freedom(D: np.ndarray, spectrum: _Spectrum) -> np.ndarray:
    """Degrees of freedom of the variances of estimates with the linear map D (estimates, 2 rows): 2
    over their relative variance.

    Weights draw an estimate from few frequencies, at the quiet end of the band, and the spectrum
    there is known from few.
    """
    half = len(spectrum.power)
    share = (D[:, :half] ** 2 + D[:, half:] ** 2) * spectrum.power
    slope = share @ spectrum.basis / np.maximum(share.sum(axis=1), 1e-300)[:, None]
    information = (spectrum.basis * spectrum.free[:, None]).T @ spectrum.basis
    return np.maximum(1.0, 2.0 / (slope * np.linalg.solve(information, slope.T).T).sum(axis=1))


def _degree(frequencies: int) -> int:
    return min(_SHAPE, frequencies // _PER_SHAPE)


def spectral_freedom(frequencies: int, slopes: int) -> int:
    """Return the degrees of freedom of the residual's spectrum: two per frequency, less what was
    fitted.
    """
    return max(1, 2 * frequencies - slopes - _degree(frequencies) - 1)


def student_factor(free: float | np.ndarray) -> np.ndarray:
    """Return the factor on standard errors that makes two of them hold 95.45 % when few frequencies
    determine the disturbance.
    """

    return np.asarray(t.ppf(norm.cdf(2.0), free)) / 2.0


def _map(D: np.ndarray, parts: Sequence[TransformedStretch], samples: int) -> np.ndarray:
    """The linear map (terms, samples) from the measured coefficient to the slopes."""
    half = D.shape[1] // 2
    weights = (D[:, :half] + 1j * D[:, half:]).T
    A = np.zeros((len(D), samples))
    for part in parts:
        count = part.samples.stop - part.samples.start
        back = adjoint_fourier(
            weights[part.rows] / np.sqrt(part.duration), part.step, part.frequencies, count
        )
        A[:, part.samples] = remove_straight_line(back).T
    return A


@dataclass(frozen=True)
class _Whole:
    """Constants and slopes together: estimates, covariance, white standard errors, linear map,
    offset between stretches.
    """

    theta: np.ndarray
    covariance: np.ndarray
    white: np.ndarray
    A: np.ndarray
    offset: float


def _joined(
    X: np.ndarray, z: np.ndarray, fixed: np.ndarray, samples: RegressionSamples, slopes: _Whole
) -> _Whole:
    """Slopes joined by the constants that are left in time; these depend on the slopes through the
    mean regressors.
    """
    n = len(fixed)
    theta, white, C, A = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, len(z)))
    theta[~fixed], white[~fixed], A[~fixed] = slopes.theta, slopes.white, slopes.A
    C[np.ix_(~fixed, ~fixed)] = slopes.covariance
    if not fixed.any():
        return _Whole(theta, C, white, A, 0.0)
    P = least_squares.estimator_matrix(X[:, fixed])
    theta[fixed] = P @ (z - X[:, ~fixed] @ slopes.theta)
    v = z - X @ theta
    own = coloured_covariance_of(X[:, fixed], v, *samples.pieces())
    means = P @ X[:, ~fixed]
    A[fixed] = P - means @ slopes.A
    C[np.ix_(fixed, fixed)] = own.covariance + means @ slopes.covariance @ means.T
    C[np.ix_(fixed, ~fixed)] = -means @ slopes.covariance
    C[np.ix_(~fixed, fixed)] = C[np.ix_(fixed, ~fixed)].T
    white[fixed] = np.sqrt((v @ v) / (len(v) - n) * (P**2).sum(axis=1) + means**2 @ slopes.white**2)
    return _Whole(theta, C, white, A, own.offset)


def _with_constants(
    more: dict[str, tuple], terms: Sequence[str], fixed: np.ndarray
) -> dict[str, tuple]:
    """Diagnostics of the slopes under the names of all terms: nothing is collinear with a constant
    that was taken out.
    """
    n, at = len(terms), np.flatnonzero(~fixed)
    vif, correlation = np.full(n, np.nan), np.eye(n)
    vif[at], correlation[np.ix_(at, at)] = more["vif"][1], more["regressor_correlation"][1]
    proportion = np.zeros((len(more["condition_index"][1]), n))
    proportion[:, at] = more["proportion"][1]
    return {
        **more,
        "vif": ("term", vif, more["vif"][2]),
        "regressor_correlation": (("term", "term_"), correlation),
        "proportion": (("component", "term"), proportion, more["proportion"][2]),
    }
