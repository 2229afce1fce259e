"""Moments of inertia from flight, through the gyroscopic products of coupled manoeuvres.

The moment equations, solved for the angular accelerations, with G = Ixx Izz - Ixz^2 and a plane of
symmetry:

    p' = [Ixz (Ixx - Iyy + Izz) p q - (Izz (Izz - Iyy) + Ixz^2) q r + Izz L + Ixz N]/G
    q' = [(Izz - Ixx) p r + Ixz (r^2 - p^2) + M]/Iyy
    r' = [((Ixx - Iyy) Ixx + Ixz^2) p q - Ixz (Ixx - Iyy + Izz) q r + Ixz L + Ixx N]/G

Aerodynamic moments are linear in their derivatives, so each equation is regressed on the products
of the rates and on qbar times the aerodynamic regressors.  Only ratios of inertia appear in the
products: six coefficients for three ratios, which are found together by generalised least squares;
the residual shows whether the six agree.  One moment that is known, or taken from the aircraft
file, sets the scale.

Needs rates that are large about all axes at once, as orthogonal multisines on all surfaces or
rolling pull-ups give: the products are of second order, 0.1 rad/s squared in an ordinary manoeuvre.
Moments of thrust and of rotors are taken off with the inertia of the aircraft file.

References
----------
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 3 (equations of motion).
.. [DAS] Data acquisition system for fixed-wing unmanned aircraft, eq. (4) to (6) and the remark after them: inertia as
   unknowns of the equation-error method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.linalg import block_diag
from scipy.stats import chi2 as chi2_distribution

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
from flighttest.remarks import Remark, remark_lines

MOMENTS = ("Ixx", "Iyy", "Izz", "Ixz")
_PRODUCTS = {"p_dot": ("pq", "qr"), "q_dot": ("pr", "rr-pp"), "r_dot": ("pq", "qr")}
_COEFFICIENT = {"p_dot": ("Cl", "Cn"), "q_dot": ("Cm",), "r_dot": ("Cl", "Cn")}
_ROUNDS = 50


@dataclass(frozen=True)
class Inertia:
    """Moments of inertia as flight shows them.

    Attributes
    ----------
    estimates : Dataset (term, term_)
        Terms Ixx, Iyy, Izz, Ixz [kg m2]: ``estimate``, ``stderr``, ``stderr_white``,
        ``covariance``, ``correlation``, and ``stated``, the value of the aircraft file.
        Attributes: ``scale`` (the moment that was known), ``chi2`` of the six coefficients against
        the three ratios, ``probability`` that it is larger (three degrees of freedom).
    products : Dataset (product, product_)
        The coefficients of the rate products as regressed, equation by equation: ``estimate``,
        ``stderr``, ``stderr_white``, ``covariance``, and ``fitted``, what the inertia makes of
        them. [1]
    """

    estimates: xr.Dataset
    products: xr.Dataset

    @property
    def remarks(self) -> list[Remark]:
        """Physical inequalities that are broken, contradiction between the equations, moments that
        were not seen.
        """
        e = self.estimates
        I = dict(zip(MOMENTS, e["estimate"].values))
        found = [
            Remark(
                "range", f"{a} + {b} < {c}: no body has such moments", c, I[c], I[a] + I[b], "error"
            )
            for a, b, c in (("Ixx", "Iyy", "Izz"), ("Iyy", "Izz", "Ixx"), ("Ixx", "Izz", "Iyy"))
            if I[a] + I[b] < I[c]
        ]
        if abs(I["Ixz"]) > 0.5 * min(I["Ixx"], I["Izz"]):
            words = "Ixz is above half of the smaller of Ixx and Izz: not of an aeroplane"
            found.append(Remark("range", words, "Ixz", I["Ixz"], 0.5 * min(I["Ixx"], I["Izz"])))
        if e.attrs["probability"] < 0.01:
            words = (
                f"the equations contradict each other: chi2 {e.attrs['chi2']:.1f} of 3; the "
                f"aerodynamic models are too simple"
            )
            found.append(Remark("scatter", words, "", e.attrs["probability"], 0.01))
        for name in MOMENTS:
            value, s = I[name], float(e["stderr"].sel(term=name))
            if name != "Ixz" and s > 0.2 * abs(value):
                words = (
                    f"{name} is known to {100 * s / abs(value):.0f} % only; the manoeuvres "
                    f"are not coupled enough"
                )
                found.append(Remark("not significant", words, name, s / abs(value), 0.2))
        return found

    def report(self) -> str:
        """Return the moments as a text table."""
        e = self.estimates
        text = [
            f"moments of inertia, {e.attrs['scale']} given; chi2 {e.attrs['chi2']:.1f} of 3, "
            f"probability {e.attrs['probability']:.2g}",
            f"{'moment':<8}{'estimate':>12}{'stderr':>11}{'white':>11}{'stated':>12}  [kg m2]",
        ]
        for name in MOMENTS:
            row = e.sel(term=name)
            numbers = (float(row[key]) for key in ("estimate", "stderr", "stderr_white", "stated"))
            text.append(
                f"{name:<8}"
                + "".join(
                    f"{x:>{w}.{d}g}" for x, w, d in zip(numbers, (12, 11, 11, 12), (6, 2, 2, 6))
                )
            )
        return "\n".join([*text, *remark_lines(self.remarks)])


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
        Reference lengths, engines; its inertia is the start, and that of `scale` is taken as known.
    models : mapping
        Aerodynamic models of ``Cl``, ``Cm`` and ``Cn`` about the c.g.
    scale : {"Ixx", "Iyy", "Izz"}
        The moment that is known, from a pendulum test for example.
    cutoff : float, optional
        Low-pass all states alike first, as in `coefficients`. [Hz]

    Returns
    -------
    Inertia

    Raises
    ------
    IdentificationError
        Missing models, products of the rates that do not move, or terms that the data cannot
        distinguish.
    UnknownName
        A state or a moment that is not there.
    """
    if scale not in MOMENTS[:3]:
        raise UnknownName(scale, MOMENTS[:3], "scale")
    if missing := [name for name in ("Cl", "Cm", "Cn") if name not in models]:
        raise IdentificationError(
            f"no model of {', '.join(missing)}; the three moments are coupled, give a model of each"
        )
    parts = [
        _prepared(one, aircraft, cutoff)
        for one in ([path] if isinstance(path, xr.Dataset) else path)
    ]
    found = [_regressed(rate, parts, aircraft, models) for rate in _PRODUCTS]
    k = np.concatenate([one.estimate for one in found])
    C, white = (
        _diagonal([getattr(one, block) for one in found]) for block in ("covariance", "white")
    )
    I, J = _ratios(k, C, aircraft, scale)
    products = least_squares.regression_estimates(
        _NAMES,
        k,
        C,
        np.sqrt(np.diag(white)),
        ([], np.zeros((len(k), 0))),
        {"fitted": ("term", _factors(I))},
    )
    return Inertia(
        _moments(k, C, white, I, J, aircraft, scale),
        products.rename(term="product", term_="product_"),
    )


_NAMES = tuple(f"{rate}/{product}" for rate, products in _PRODUCTS.items() for product in products)


@dataclass(frozen=True)
class _Regressed:
    """Coefficients of the rate products in one equation."""

    estimate: np.ndarray
    covariance: np.ndarray
    white: np.ndarray


def _prepared(states: xr.Dataset, aircraft: Aircraft, cutoff: float | None) -> xr.Dataset:
    """States with angular accelerations freed from known moments, and the products of the rates."""
    data = reduced_rates(states if cutoff is None else smooth_states(states, cutoff), aircraft)
    known = np.linalg.solve(inertia_matrix(aircraft), known_moment(data, aircraft).T)
    p, q, r = (np.asarray(data[name].values, float) for name in "pqr")
    for name, part in zip(_PRODUCTS, known):
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


def _regressed(
    rate: str,
    parts: Sequence[xr.Dataset],
    aircraft: Aircraft,
    models: Mapping[str, RegressionModel],
) -> _Regressed:
    """One equation: an angular acceleration over products of rates and qbar times the aerodynamic
    regressors.
    """
    terms = list(dict.fromkeys(term for name in _COEFFICIENT[rate] for term in models[name].terms))
    variables = list(
        dict.fromkeys(v for name in _COEFFICIENT[rate] for v in models[name].variables)
    )
    products = _PRODUCTS[rate]
    samples = stack_samples(rate, ["qbar", *products, *variables], parts, f"the equation of {rate}")
    z = samples.data[rate].values
    load = (
        samples.data["qbar"].values
        * aircraft.S
        * (aircraft.cbar if rate == "q_dot" else aircraft.b)
    )
    X = np.vstack(
        [
            *(samples.data[name].values for name in products),
            term_regressors(terms, samples.data) * load,
        ]
    ).T
    if len(z) <= 5 * X.shape[1]:
        raise IdentificationError(
            f"{len(z)} samples for {X.shape[1]} terms of {rate}; at least 5 per term are needed"
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
    return _Regressed(theta[:n], C[:n, :n], white[:n, :n])


def _factors(I: np.ndarray) -> np.ndarray:
    """Coefficients of the products, in the order of `_NAMES`, from Ixx, Iyy, Izz, Ixz."""
    x, y, z, c = I
    G = x * z - c * c
    cross = c * (x - y + z) / G
    return np.array(
        [cross, -(z * (z - y) + c * c) / G, (z - x) / y, c / y, ((x - y) * x + c * c) / G, -cross]
    )


def _ratios(
    k: np.ndarray, C: np.ndarray, aircraft: Aircraft, scale: str
) -> tuple[np.ndarray, np.ndarray]:
    """Moments that explain the coefficients best, and the derivatives of those by the free moments."""
    I = np.array([float(getattr(aircraft, name)) for name in MOMENTS])
    free = [MOMENTS.index(name) for name in MOMENTS if name != scale]
    size = I[MOMENTS.index(scale)]
    L = np.linalg.cholesky(C)
    for _ in range(_ROUNDS):
        J = np.stack(
            [
                (_factors(I + h) - _factors(I - h)) / (2e-6 * size)
                for h in 1e-6 * size * np.eye(4)[free]
            ],
            axis=1,
        )
        step = np.linalg.lstsq(
            np.linalg.solve(L, J), np.linalg.solve(L, k - _factors(I)), rcond=None
        )[0]
        new = I.copy()
        new[free] += np.clip(step, -0.3 * size, 0.3 * size)
        if not (new[:3] > 0).all() or new[3] ** 2 >= new[0] * new[2]:
            raise IdentificationError(
                f"the products of the rates require moments of no body "
                f"({', '.join(f'{n} {v:.4g}' for n, v in zip(MOMENTS, new))}); "
                "the manoeuvres are not coupled enough, or the aerodynamic models too simple"
            )
        I = new
        if np.abs(step).max() < 1e-9 * size:
            return I, J
    raise IdentificationError(
        "the moments of inertia did not settle; the manoeuvres are not coupled enough"
    )


def _moments(k, C, white, I, J, aircraft: Aircraft, scale: str) -> xr.Dataset:

    free = [MOMENTS.index(name) for name in MOMENTS if name != scale]
    inverse = np.linalg.inv(C)
    gain = np.linalg.solve(J.T @ inverse @ J, J.T @ inverse)
    covariance, plain = np.zeros((4, 4)), np.zeros((4, 4))
    covariance[np.ix_(free, free)] = gain @ C @ gain.T
    plain[np.ix_(free, free)] = gain @ white @ gain.T
    rest = k - _factors(I)
    chi2 = float(rest @ inverse @ rest)
    stated = np.array([float(getattr(aircraft, name)) for name in MOMENTS])
    found = least_squares.regression_estimates(
        MOMENTS,
        I,
        covariance,
        np.sqrt(np.diag(plain)),
        ([], np.zeros((4, 0))),
        {"stated": ("term", stated)},
    )
    found.attrs = {
        "scale": scale,
        "chi2": chi2,
        "probability": float(chi2_distribution.sf(chi2, 3)),
        "units": "kg m2",
    }
    return found


def _diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:

    return np.asarray(block_diag(*blocks))
