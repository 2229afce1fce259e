"""How well a test input will determine the terms of a model: expected standard errors before the
flight.

Equation error: the regressors X of the predicted motion and the noise of the coefficient give the
covariance of least squares. Output error: the Cramer-Rao bound, the inverse of Fisher's information
M = sum S' R^-1 S with the sensitivities S of the outputs. Errors that last (gusts, model structure)
count less often than their samples: with a memory tau their autocorrelation exp(-|t|/tau) stands in
the middle of the covariance, as in the corrected bounds of a real fit [Morelli1997].

References
----------
.. [Morelli1997] Morelli, Klein, Determining the accuracy of aerodynamic model parameters, J. Guidance 20, 1997.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapters 5, 6 and 9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.signal import fftconvolve

import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, UnknownName
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.simulation.run import index_of_parameter
from flighttest.flight_programme.input_design.predicted_response import STEP, model_inputs
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.records.sensors.instruments import parse_instruments
from flighttest.records.signals.differentiation import derivative_noise
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.uncertainty import collinearity

_DIFFERENCE = 1e-3  # of a parameter, or of its unit when it is zero
_IMU = {"CL": "az_imu", "CD": "ax_imu", "CY": "ay_imu", "CX": "ax_imu", "CZ": "az_imu"}
_GYRO = {"Cl": ("p", "Ixx", "b"), "Cm": ("q", "Iyy", "cbar"), "Cn": ("r", "Izz", "b")}


@dataclass(frozen=True)
class Expected:
    """What a test input promises.

    Attributes
    ----------
    name : str
        The model, or the kind of estimation.
    estimates : Dataset (term, term_)
        ``estimate`` (a-priori value), ``stderr`` (with the memory of the disturbance),
        ``stderr_white``, ``covariance``, ``correlation``, ``vif``.  Attributes ``samples``,
        ``memory`` [s].
    """

    name: str
    estimates: xr.Dataset

    @property
    def determinant(self) -> float:
        """Return the logarithm of the determinant of the covariance: smaller is better
        (D-optimality).
        """
        return float(np.linalg.slogdet(self.estimates["covariance"].values)[1])

    def report(self) -> str:
        """Return the table of expected standard errors as text."""
        e = self.estimates
        lines = [
            f"{self.name}: {e.attrs['samples']} samples, disturbance with a memory of "
            f"{e.attrs['memory']:g} s"
        ]
        lines.append(
            f"{'term':<20}{'a priori':>11}{'std error':>11}{'if white':>11}{'in %':>8}{'VIF':>8}"
        )
        for term in e["term"].values:
            value, error, white, vif = (
                float(e[key].sel(term=term))
                for key in ("estimate", "stderr", "stderr_white", "vif")
            )
            part = f"{100.0 * error / abs(value):.1f}" if value else "-"
            lines.append(
                f"{term!s:<20}{value:>11.4g}{error:>11.2g}{white:>11.2g}{part:>8}{'-' if np.isnan(vif) else f'{vif:.1f}':>8}"
            )
        names, rho = [str(term) for term in e["term"].values], e["correlation"].values
        pairs = [
            f"! {names[i]} and {names[j]} will be correlated by {rho[i, j]:.2f}"
            for i, j in zip(*np.nonzero(np.triu(np.abs(rho) > 0.9, 1)))
        ]
        return "\n".join([*lines, *pairs])


def coefficient_noise(aircraft: Aircraft, response: xr.Dataset) -> dict[str, float]:
    """Return the white noise that the inertial unit of an aircraft leaves in the coefficients, per
    sample. [1]

    Parameters
    ----------
    aircraft : Aircraft
        Mass, inertia, lengths and the noise of its instruments.
    response : Dataset (time,)
        For the mean dynamic pressure and the sampling interval.

    Notes
    -----
    Forces: m sigma_a/(qbar S).  Moments: I sigma_omega G/(qbar S l), G being the noise gain of `derivative`.  Noise alone is the floor of
    a real residual: where an earlier flight of the kind is at hand, take the rms of its residuals.
    """
    specification = parse_instruments(aircraft.instruments, f"instruments of {aircraft.name}")
    force = float(response["qbar"].mean()) * aircraft.S
    gain = derivative_noise(float(np.median(np.diff(response["time"].values))))
    found = {
        name: aircraft.mass * specification.noise(channel) / force for name, channel in _IMU.items()
    }
    for name, (channel, inertia, length) in _GYRO.items():
        found[name] = (
            getattr(aircraft, inertia)
            * specification.noise(channel)
            * gain
            / (force * getattr(aircraft, length))
        )
    return found


def expected_errors(
    model: RegressionModel,
    response: xr.Dataset,
    aircraft: Aircraft,
    noise: Mapping[str, float] | None = None,
    memory: float = 0.0,
) -> Expected:
    """Return the standard errors that `regress` will have with a test input.

    Parameters
    ----------
    model : Model
        Coefficient and terms.
    response : Dataset (time,)
        Predicted motion, all outputs of `predict_response`. [SI]
    aircraft : Aircraft
        For the reduced rates, and the noise.
    noise : mapping of str to float, optional
        Standard deviation of the disturbance of each coefficient; `coefficient_noise` without it.
        [1]
    memory : float
        Time constant of the disturbance; 0 is white. [s]

    Returns
    -------
    Expected
        A-priori values: least squares on the coefficients of the predicted motion, without noise.

    Raises
    ------
    UnknownName
        A variable that the motion does not hold, a coefficient without noise.
    IdentificationError
        The motion does not determine the terms; the text names the combination.
    """
    data = reduced_rates(response, aircraft)
    data = data.assign(
        {
            str(n).removeprefix("applied."): data[n]
            for n in data.data_vars
            if str(n).startswith("applied.")
        }
    )
    data = data.assign(_body_forces(data))
    sigma = (coefficient_noise(aircraft, response) if noise is None else noise).get(
        model.coefficient
    )
    if sigma is None or model.coefficient not in data:
        raise UnknownName(model.coefficient, noise or _IMU, "coefficient", "give its noise")
    X, terms = model.design(data), list(model.terms)
    try:
        collinearity.demand_rank(X, terms)
    except IdentificationError as error:
        raise IdentificationError(f"{model}: with this test input {error}") from None
    theta = np.linalg.lstsq(X, data[model.coefficient].values, rcond=None)[0]
    step = float(np.median(np.diff(data["time"].values)))
    return Expected(str(model), _estimates(terms, theta, [X / sigma], step, memory))


def cramer_rao(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    parameters: Sequence[str],
    noise: Mapping[str, float],
    nuisance: Sequence[str] = (),
    scale: float = 1.0,
    memory: float = 0.0,
) -> Expected:
    """Return the Cramer-Rao bounds of parameters of a model, for output error with a test input.

    Parameters
    ----------
    sim, signal, start, scale
        As in `predicted_response.model_inputs`.
    parameters : sequence of str
        Of the model: ``term.Cm.qhat`` (a factor, one), ``node.CL.basic[3]``, ``mass.Iyy`` ...
    noise : mapping of str to float
        Output to the standard deviation of its noise; these are the outputs that are compared. [SI]
    nuisance : sequence of str
        Parameters that the fit frees as well and nobody requests: ``bias.Cm``, ``init.alpha``,
        ``init.q`` ...
    memory : float
        Time constant of the noise of the outputs; 0 is white. [s]

    Returns
    -------
    Expected
        Of `parameters`; the covariance holds what the nuisance takes away.

    Raises
    ------
    IdentificationError
        Parameters that the outputs cannot distinguish, or do not feel.
    UnknownName
        A parameter or output that the model does not have.
    """
    names = [*parameters, *nuisance]
    values = np.array([_value(sim, start, name) for name in names])
    steps = _DIFFERENCE * np.where(values == 0.0, 1.0, np.abs(values))
    S = _sensitivities(sim, signal, start, names, values, steps, list(noise), scale)
    blocks = [S[:, :, k] / sigma for k, sigma in enumerate(noise.values())]
    try:
        collinearity.demand_rank(np.vstack(blocks), names)
    except IdentificationError as error:
        raise IdentificationError(f"output error: with this test input {error}") from None
    step = float(np.median(np.diff(signal["time"].values)))
    found = _estimates(names, values, blocks, step, memory)
    count = len(parameters)
    return Expected(
        f"output error ({' '.join(noise)})", found.isel(term=slice(count), term_=slice(count))
    )


def _sensitivities(sim, signal, start, names, values, steps, outputs, scale) -> np.ndarray:
    """Central differences of the outputs, (time, parameter, output), all runs in one batch."""

    table = np.vstack(
        [values + sign * np.diag(steps)[k] for k in range(len(names)) for sign in (1.0, -1.0)]
    )
    inputs = model_inputs(sim, signal, start, scale)
    fixed = {name: value for name, value in start.items() if name not in names}
    y = flightmech.simulate_batch(
        sim,
        inputs,
        {name: table[:, k] for k, name in enumerate(names)},
        {**fixed, "mode.trim": 0.0},
        outputs=outputs,
        step=STEP,
    )
    runs = np.stack([y[name].values for name in outputs], axis=-1)
    return np.moveaxis((runs[0::2] - runs[1::2]) / (2.0 * steps[:, None, None]), 0, 1)


def _value(sim: SimModel, start: Mapping[str, float], name: str) -> float:

    return (
        float(start[name])
        if name in start
        else float(Simulation(sim.model).parameter(index_of_parameter(sim, name)))
    )


def _body_forces(data: xr.Dataset) -> dict[str, xr.DataArray]:
    if not {"CL", "CD", "alpha"} <= set(map(str, data.data_vars)):
        return {}
    c, s = np.cos(data["alpha"]), np.sin(data["alpha"])
    return {"CX": data["CL"] * s - data["CD"] * c, "CZ": -data["CL"] * c - data["CD"] * s}


def _estimates(
    terms: list[str], theta: np.ndarray, blocks: list[np.ndarray], step: float, memory: float
) -> xr.Dataset:
    """The covariance of least squares on blocks of regressors in units of their noise, white and
    with a memory.
    """
    X = np.vstack(blocks)
    _, R = np.linalg.qr(X)
    inverse = np.linalg.solve(R, np.eye(len(terms)))
    white = inverse @ inverse.T
    covariance = (
        white
        if memory == 0.0
        else white @ sum(_coloured_information(x, step, memory) for x in blocks) @ white
    )
    stderr = np.sqrt(np.diag(covariance))
    constants = np.array([term == "1" for term in terms])
    vif = collinearity.variance_inflation(collinearity.regressor_correlations(X, constants))
    return xr.Dataset(
        {
            "estimate": ("term", theta),
            "stderr": ("term", stderr),
            "stderr_white": ("term", np.sqrt(np.diag(white))),
            "covariance": (("term", "term_"), covariance),
            "correlation": (("term", "term_"), covariance / np.outer(stderr, stderr)),
            "vif": ("term", np.where(constants, np.nan, vif)),
        },
        {"term": terms, "term_": terms},
        {"samples": len(blocks[0]), "memory": memory},
    )


def _coloured_information(x: np.ndarray, step: float, memory: float) -> np.ndarray:
    """Sum over i and j of x_i exp(-|i - j| step/memory) x_j', (terms, terms)."""

    reach = np.arange(-(len(x) - 1), len(x))
    kernel = np.exp(-np.abs(reach) * step / memory)
    return x.T @ fftconvolve(x, kernel[:, None], mode="same", axes=0)
