"""Moments of inertia from flight, through the gyroscopic products of coupled manoeuvres.

The moment equations, solved for the angular accelerations, with G = Ixx Izz - Ixz^2 and a plane of
symmetry:

    p' = [Ixz (Ixx - Iyy + Izz) p q - (Izz (Izz - Iyy) + Ixz^2) q r + Izz L + Ixz N]/G
    q' = [(Izz - Ixx) p r + Ixz (r^2 - p^2) + M]/Iyy
    r' = [((Ixx - Iyy) Ixx + Ixz^2) p q - Ixz (Ixx - Iyy + Izz) q r + Ixz L + Ixx N]/G

Aerodynamic moments are linear in their derivatives.  Each equation is therefore regressed on the
products of the rates and on qbar times the aerodynamic regressors.  Only ratios of inertia appear
in the products: six coefficients for three ratios.  Generalised least squares estimate the ratios
from all six, and the residual shows whether the six agree.  One moment, measured or of the aircraft
file, sets the scale.

The rates must be large about all axes at the same time, as in orthogonal multisines on all surfaces
or rolling pull-ups.  The products are of second order, 0.1 rad/s squared in an ordinary manoeuvre.
Moments of thrust and of rotors are subtracted with the inertia of the aircraft file.

References
----------
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 3 (equations of
   motion).
.. [DAS] Data acquisition system for fixed-wing unmanned aircraft, eq. (4) to (6) and the remark
   after them: inertia as unknowns of the equation-error method.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr
from scipy.linalg import block_diag

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, UnknownName
from flighttest.reconstruction.dynamics.force_coefficients import smooth_states
from flighttest.reconstruction.dynamics.loads import inertia_matrix, known_moment
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.model import RegressionModel, term_regressors
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.regression.uncertainty.collinearity import demand_rank
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import PrintedResult, Remark, TabledEstimates

MOMENTS = ("Ixx", "Iyy", "Izz", "Ixz")
# Products of the rates in each equation, and coefficients whose regressors it contains.
_PRODUCTS = {"p_dot": ("pq", "qr"), "q_dot": ("pr", "rr-pp"), "r_dot": ("pq", "qr")}
_COEFFICIENT = {"p_dot": ("Cl", "Cn"), "q_dot": ("Cm",), "r_dot": ("Cl", "Cn")}
_NAMES = (
    *(f"p_dot/{product}" for product in _PRODUCTS["p_dot"]),
    *(f"q_dot/{product}" for product in _PRODUCTS["q_dot"]),
    *(f"r_dot/{product}" for product in _PRODUCTS["r_dot"]),
)
# Degrees of freedom of six coefficients less three ratios.
_FREEDOM = 3
# Probability of the chi-square below which the equations contradict each other.
_CONTRADICTION = 0.01
# Relative standard error above which a moment is not determined.
_VAGUE = 0.2
# Smallest number of samples per term of an equation.
_SAMPLES_PER_TERM = 5
# Largest number of steps, and step [of the scale] at which the moments have converged.
_ROUNDS, _SETTLED = 50, 1e-9
# Largest step of a moment, and step of the central differences. [of the scale]
_LARGEST_STEP, _DIFFERENCE = 0.3, 1e-6
# Columns of the report: name in the estimates, width and digits.
_COLUMNS = (("estimate", 12, 6), ("stderr", 11, 2), ("stderr_white", 11, 2), ("stated", 12, 6))


@dataclass(frozen=True)
class Inertia(PrintedResult, TabledEstimates):
    """Moments of inertia estimated from flight.

    Attributes
    ----------
    estimates : Dataset (term, term_)
        Terms Ixx, Iyy, Izz, Ixz [kg m2]: ``estimate``, ``stderr``, ``stderr_white``,
        ``covariance``, ``correlation``, and ``stated``, the value of the aircraft file.
        Attributes: ``scale`` (name of the fixed moment), ``chi2`` of the six coefficients against
        the three ratios, ``probability`` of a larger value (three degrees of freedom).
    products : Dataset (product, product_)
        Regressed coefficients of the rate products, equation by equation: ``estimate``, ``stderr``,
        ``stderr_white``, ``covariance``, and ``fitted``, the value that follows from the inertia.
        [1]
    """

    estimates: xr.Dataset
    products: xr.Dataset

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on physical inequalities, contradictions, and moments without information."""
        return list(_list_remarks(self.estimates))

    def report_lines(self) -> list[str]:
        """Return the moments as lines."""
        e = self.estimates
        lines = [
            f"moments of inertia, {e.attrs['scale']} given; chi2 {e.attrs['chi2']:.1f} of "
            f"{_FREEDOM}, probability {e.attrs['probability']:.2g}",
            f"{'moment':<8}{'estimate':>12}{'stderr':>11}{'white':>11}{'stated':>12}  [kg m2]",
        ]
        for name in MOMENTS:
            line = f"{name:<8}"
            for key, width, digits in _COLUMNS:
                line += f"{float(e[key].sel(term=name)):>{width}.{digits}g}"
            lines.append(line)
        return lines


def _list_remarks(e: xr.Dataset) -> Iterator[Remark]:
    """Yield the remarks on estimates of moments."""
    I = dict(zip(MOMENTS, e["estimate"].values))
    # Triangle inequalities: the moments of a mass distribution cannot violate them.
    for a, b, c in (("Ixx", "Iyy", "Izz"), ("Iyy", "Izz", "Ixx"), ("Ixx", "Izz", "Iyy")):
        if I[a] + I[b] < I[c]:
            text = f"{a} + {b} < {c}: no body has such moments"
            yield Remark("range", text, c, I[c], threshold=I[a] + I[b], severity="error")
    limit = 0.5 * min(I["Ixx"], I["Izz"])
    if abs(I["Ixz"]) > limit:
        text = "Ixz is above half of the smaller of Ixx and Izz: not of an aeroplane"
        yield Remark("range", text, "Ixz", I["Ixz"], threshold=limit)
    probability = e.attrs["probability"]
    if probability < _CONTRADICTION:
        text = (
            f"the equations contradict each other: chi2 {e.attrs['chi2']:.1f} of {_FREEDOM}; the "
            f"aerodynamic models are too simple"
        )
        yield Remark("scatter", text, "", probability, threshold=_CONTRADICTION)
    for name in MOMENTS[:3]:
        stderr = float(e["stderr"].sel(term=name))
        if stderr > _VAGUE * abs(I[name]):
            text = (
                f"{name} is known to {100 * stderr / abs(I[name]):.0f} % only; the manoeuvres "
                f"are not coupled enough"
            )
            ratio = stderr / abs(I[name])
            yield Remark("not significant", text, name, ratio, threshold=_VAGUE)


def inertia_from_flight(
    path: xr.Dataset | Sequence[xr.Dataset],
    aircraft: Aircraft,
    models: Mapping[str, RegressionModel],
    scale: str = "Iyy",
    cutoff: float | None = None,
) -> Inertia:
    """Estimate moments of inertia from coupled manoeuvres.

    Parameters
    ----------
    path : Dataset (time,) or list of them
        States: `V qbar p q r p_dot q_dot r_dot` at the c.g., and the variables of the models. [SI]
    aircraft : Aircraft
        Reference lengths and engines. Its inertia is the start, and its value of `scale` is fixed.
    models : mapping
        Aerodynamic models of ``Cl``, ``Cm`` and ``Cn`` about the c.g.
    scale : {"Ixx", "Iyy", "Izz"}
        Fixed moment, for example from a pendulum test.
    cutoff : float, optional
        Cut-off frequency of a low-pass of all states, as in `coefficients`. [Hz]

    Returns
    -------
    Inertia

    Raises
    ------
    IdentificationError
        Missing models, products of the rates that do not move, or terms that the data cannot
        distinguish.
    UnknownName
        A missing state, or an unknown moment.
    """
    if scale not in MOMENTS[:3]:
        raise UnknownName(scale, MOMENTS[:3], "scale")
    missing = [name for name in ("Cl", "Cm", "Cn") if name not in models]
    if missing:
        raise IdentificationError(
            f"no model of {', '.join(missing)}; the three moments are coupled, give a model of each"
        )
    manoeuvres = [path] if isinstance(path, xr.Dataset) else path
    parts = [_prepare_states(states, aircraft, cutoff) for states in manoeuvres]
    equations = [_regress_rate(rate, parts, aircraft=aircraft, models=models) for rate in _PRODUCTS]
    k = np.concatenate([equation.estimate for equation in equations])
    C = _join_covariances(equations, [equation.covariance for equation in equations])
    white = _join_covariances(equations, [equation.white for equation in equations])
    I, J = _solve_ratios(k, C, aircraft=aircraft, scale=scale)
    products = least_squares.regression_estimates(
        _NAMES,
        k,
        C,
        white=np.sqrt(np.diag(white)),
        systematic=([], np.zeros((len(k), 0))),
        extra={"fitted": ("term", _product_coefficients(I))},
    )
    estimates = _moments_dataset(_Coefficients(k, C, white), I, J=J, aircraft=aircraft, scale=scale)
    return Inertia(estimates, products.rename(term="product", term_="product_"))


@dataclass(frozen=True)
class _Regressed:
    """Coefficients of the rate products of one equation, with covariances for coloured and for
    white residuals, and the residuals (sample,).
    """

    estimate: np.ndarray
    covariance: np.ndarray
    white: np.ndarray
    residual: np.ndarray


def _join_covariances(
    equations: Sequence[_Regressed], covariances: Sequence[np.ndarray]
) -> np.ndarray:
    """Return the covariance of the coefficients of all equations.

    The product of inertia brings the errors of L and N into p' and r'.  Both have the same
    regressors, so with white residuals their covariance is that of one equation times the ratio of
    the residual moments.  The product of the symmetric roots of both covariances times the
    correlation of the residuals equals that, and stays positive with other residuals.
    """
    joined = np.asarray(block_diag(*covariances))
    roll, _, yaw = equations
    norms = float(np.linalg.norm(roll.residual) * np.linalg.norm(yaw.residual))
    # exact data have no residual, and nothing to correlate
    if not norms > 0.0:
        return joined
    correlation = float(roll.residual @ yaw.residual) / norms
    root_p, root_r = _symmetric_root(covariances[0]), _symmetric_root(covariances[2])
    joined[:2, -2:] = correlation * root_p @ root_r
    joined[-2:, :2] = joined[:2, -2:].T
    return joined


def _symmetric_root(covariance: np.ndarray) -> np.ndarray:
    """Return the symmetric square root; variances that rounding makes negative count as zero."""
    variances, axes = np.linalg.eigh(covariance)
    return axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T


@dataclass(frozen=True)
class _Coefficients:
    """Coefficients of all rate products, with covariances for coloured and for white residuals."""

    estimate: np.ndarray
    covariance: np.ndarray
    white: np.ndarray


def _prepare_states(states: xr.Dataset, aircraft: Aircraft, cutoff: float | None) -> xr.Dataset:
    """Return states with the products of the rates, and accelerations less the known moments."""
    if cutoff is not None:
        states = smooth_states(states, cutoff)
    data = reduced_rates(states, aircraft)
    by_known = np.linalg.solve(inertia_matrix(aircraft), known_moment(data, aircraft).T)
    p, q, r = (np.asarray(data[name].values, float) for name in "pqr")
    for name, part in zip(_PRODUCTS, by_known):
        if name not in data:
            raise UnknownName(
                name,
                map(str, data.data_vars),
                "state",
                "inertia from flight needs the angular accelerations",
            )
        data[name] = "time", np.asarray(data[name].values, float) - part
    for name, values in (("pq", p * q), ("qr", q * r), ("pr", p * r), ("rr-pp", r * r - p * p)):
        data[name] = "time", values
    return data


def _regress_rate(
    rate: str,
    parts: Sequence[xr.Dataset],
    aircraft: Aircraft,
    models: Mapping[str, RegressionModel],
) -> _Regressed:
    """Regress an angular acceleration on rate products and qbar times aerodynamic regressors."""
    # Each term and each variable once, in the order of the models.
    terms: dict[str, None] = {}
    variables: dict[str, None] = {}
    for name in _COEFFICIENT[rate]:
        terms |= dict.fromkeys(models[name].terms)
        variables |= dict.fromkeys(models[name].variables)
    products = _PRODUCTS[rate]
    samples = stack_samples(rate, ["qbar", *products, *variables], parts, f"the equation of {rate}")
    z = samples.data[rate].values
    length = aircraft.cbar if rate == "q_dot" else aircraft.b
    load = samples.data["qbar"].values * aircraft.S * length
    rows = [samples.data[name].values for name in products]
    X = np.vstack([*rows, term_regressors(list(terms), samples.data) * load]).T
    if len(z) <= _SAMPLES_PER_TERM * X.shape[1]:
        raise IdentificationError(
            f"{len(z)} samples for {X.shape[1]} terms of {rate}; at least {_SAMPLES_PER_TERM} per "
            f"term are needed"
        )
    try:
        demand_rank(X, [*products, *(f"qbar*{term}" for term in terms)])
    except IdentificationError as error:
        raise IdentificationError(f"equation of {rate}: {error}") from None
    theta, _ = least_squares.solve_least_squares(X, z)
    v = z - X @ theta
    C = coloured_covariance_of(X, v, *samples.pieces()).covariance
    A = least_squares.estimator_matrix(X)
    white = A @ A.T * float(v @ v) / (len(z) - len(theta))
    n = len(products)
    return _Regressed(theta[:n], C[:n, :n], white[:n, :n], v)


def _product_coefficients(I: np.ndarray) -> np.ndarray:
    """Return the coefficients of the products, in the order of `_NAMES`, from Ixx, Iyy, Izz, Ixz.

    The equations are those of the module.
    """
    x, y, z, c = I
    G = x * z - c * c
    cross = c * (x - y + z) / G
    return np.array(
        [cross, -(z * (z - y) + c * c) / G, (z - x) / y, c / y, ((x - y) * x + c * c) / G, -cross]
    )


def _free_moments(scale: str) -> list[int]:
    """Return the indices of the estimated moments."""
    return [MOMENTS.index(name) for name in MOMENTS if name != scale]


def _solve_ratios(
    k: np.ndarray, C: np.ndarray, aircraft: Aircraft, scale: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the moments of generalised least squares, and the slopes of the coefficients."""
    I = np.array([float(getattr(aircraft, name)) for name in MOMENTS])
    free = _free_moments(scale)
    size = I[MOMENTS.index(scale)]
    # Gauss-Newton steps; the Cholesky factor L whitens the coefficients.
    L = np.linalg.cholesky(C)
    for _ in range(_ROUNDS):
        slopes = []
        for h in _DIFFERENCE * size * np.eye(4)[free]:
            difference = _product_coefficients(I + h) - _product_coefficients(I - h)
            slopes.append(difference / (2.0 * _DIFFERENCE * size))
        J = np.stack(slopes, axis=1)
        residual = k - _product_coefficients(I)
        step = np.linalg.lstsq(np.linalg.solve(L, J), np.linalg.solve(L, residual), rcond=None)[0]
        trial = I.copy()
        trial[free] += np.clip(step, -_LARGEST_STEP * size, _LARGEST_STEP * size)
        if not (trial[:3] > 0).all() or trial[3] ** 2 >= trial[0] * trial[2]:
            moments = ", ".join(f"{name} {value:.4g}" for name, value in zip(MOMENTS, trial))
            raise IdentificationError(
                f"the products of the rates require moments of no body "
                f"({moments}); "
                "the manoeuvres are not coupled enough, or the aerodynamic models too simple"
            )
        I = trial
        if np.abs(step).max() < _SETTLED * size:
            return I, J
    raise IdentificationError(
        f"the moments of inertia are not converged after {_ROUNDS} steps, the last one of "
        f"{np.abs(step).max():.3g} kg m2; the manoeuvres are not coupled enough"
    )


def _moments_dataset(
    coefficients: _Coefficients, I: np.ndarray, J: np.ndarray, aircraft: Aircraft, scale: str
) -> xr.Dataset:
    """Return the moments with covariances and the chi-square of the coefficients."""
    k, C = coefficients.estimate, coefficients.covariance
    block = np.ix_(_free_moments(scale), _free_moments(scale))
    # Generalised least squares: gain (J'C^-1 J)^-1 J'C^-1.
    inverse = np.linalg.inv(C)
    gain = np.linalg.solve(J.T @ inverse @ J, J.T @ inverse)
    covariance, white = np.zeros((4, 4)), np.zeros((4, 4))
    covariance[block] = gain @ C @ gain.T
    white[block] = gain @ coefficients.white @ gain.T
    residual = k - _product_coefficients(I)
    chi2 = float(residual @ inverse @ residual)
    stated = np.array([float(getattr(aircraft, name)) for name in MOMENTS])
    estimates = least_squares.regression_estimates(
        MOMENTS,
        I,
        covariance,
        white=np.sqrt(np.diag(white)),
        systematic=([], np.zeros((4, 0))),
        extra={"stated": ("term", stated)},
    )
    estimates.attrs = {
        "scale": scale,
        "chi2": chi2,
        "probability": float(scipy.stats.chi2.sf(chi2, _FREEDOM)),
        "units": "kg m2",
    }
    return estimates
