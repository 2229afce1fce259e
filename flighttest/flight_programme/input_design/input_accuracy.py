"""Expected standard errors of the terms of a model, before the flight of a test input.

Equation error: the regressors X of the predicted motion and the noise of the coefficient give the
covariance of least squares. Output error: the Cramer-Rao bound is the inverse of Fisher's
information M = sum S' R^-1 S with the sensitivities S of the outputs. Disturbances with a memory
(gusts, model structure) contain less information than their number of samples. With a memory tau
their autocorrelation exp(-|t|/tau) is the middle factor of the covariance, as in the corrected
bounds of a fit [Morelli1997].

References
----------
.. [Morelli1997] Morelli, Klein, Determining the accuracy of aerodynamic model parameters,
   J. Guidance 20, 1997.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapters 5, 6 and 9.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.signal import fftconvolve

import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, UnknownName
from flightmech.short_text import ShortText
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.simulation.run import index_of_parameter
from flighttest.flight_programme.input_design.predicted_response import STEP, model_inputs
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.records.sensors.instruments import parse_instruments
from flighttest.records.signals.differentiation import derivative_noise
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.uncertainty import collinearity

# Step of a central difference, as a share of a parameter, or of its unit if it is zero.
_DIFFERENCE = 1e-3
# Correlation of two terms above which the report has a warning.
_CORRELATED = 0.9
# Accelerometer of each force coefficient.
_IMU = {"CL": "az_imu", "CD": "ax_imu", "CY": "ay_imu", "CX": "ax_imu", "CZ": "az_imu"}
# Gyro, moment of inertia and reference length of each moment coefficient.
_GYRO = {"Cl": ("p", "Ixx", "b"), "Cm": ("q", "Iyy", "cbar"), "Cn": ("r", "Izz", "b")}


@dataclass(frozen=True)
class Expected(ShortText):
    """Expected accuracy of the terms of one model.

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
        """Logarithm of the determinant of the covariance; D-optimality minimises it."""
        return float(np.linalg.slogdet(self.estimates["covariance"].values)[1])

    def report(self) -> str:
        """Return the table of expected standard errors as text."""
        samples, memory = self.estimates.attrs["samples"], self.estimates.attrs["memory"]
        lines = [
            f"{self.name}: {samples} samples, disturbance with a memory of {memory:g} s",
            f"{'term':<20}{'a priori':>11}{'std error':>11}{'if white':>11}{'in %':>8}{'VIF':>8}",
        ]
        terms = self.estimates["term"].values
        for term in terms:
            lines.append(_format_row(str(term), self.estimates.sel(term=term)))
        correlation = self.estimates["correlation"].values
        # pairs above the diagonal, each once
        for i, j in zip(*np.nonzero(np.triu(np.abs(correlation) > _CORRELATED, 1)), strict=True):
            lines.append(
                f"! {terms[i]} and {terms[j]} will be correlated by {correlation[i, j]:.2f}"
            )
        return "\n".join(lines)


def _format_row(term: str, row: xr.Dataset) -> str:
    """Return one line of the report."""
    value, error = float(row["estimate"]), float(row["stderr"])
    white, vif = float(row["stderr_white"]), float(row["vif"])
    # a relative error of zero, and the inflation of a constant, do not exist
    percent, inflation = "-", "-"
    if value:
        percent = f"{100.0 * error / abs(value):.1f}"
    if not np.isnan(vif):
        inflation = f"{vif:.1f}"
    return f"{term:<20}{value:>11.4g}{error:>11.2g}{white:>11.2g}{percent:>8}{inflation:>8}"


def coefficient_noise(aircraft: Aircraft, response: xr.Dataset) -> dict[str, float]:
    """Return the white noise of the coefficients from the inertial unit, per sample. [1]

    Parameters
    ----------
    aircraft : Aircraft
        Mass, inertia, lengths and the noise of its instruments.
    response : Dataset (time,)
        For the mean dynamic pressure and the sampling interval.

    Notes
    -----
    Forces: m sigma_a/(qbar S).  Moments: I sigma_omega G/(qbar S l), with the noise gain G of
    `derivative`.  This noise is the lower bound of a real residual.  If an earlier flight of the
    same kind is available, use the rms of its residuals instead.
    """
    specification = parse_instruments(aircraft.instruments, f"instruments of {aircraft.name}")
    force = float(response["qbar"].mean()) * aircraft.S
    gain = derivative_noise(float(np.median(np.diff(response["time"].values))))
    noise = {}
    for name, channel in _IMU.items():
        noise[name] = aircraft.mass * specification.noise(channel) / force
    for name, (channel, inertia, length) in _GYRO.items():
        moment = getattr(aircraft, inertia) * specification.noise(channel) * gain
        noise[name] = moment / (force * getattr(aircraft, length))
    return noise


def expected_errors(
    model: RegressionModel,
    response: xr.Dataset,
    aircraft: Aircraft,
    noise: Mapping[str, float] | None = None,
    memory: float = 0.0,
) -> Expected:
    """Return the expected standard errors of `regress` with a test input.

    Parameters
    ----------
    model : RegressionModel
        Coefficient and terms.
    response : Dataset (time,)
        Predicted motion, all outputs of `predict_response`. [SI]
    aircraft : Aircraft
        For the reduced rates, and the noise.
    noise : mapping of str to float, optional
        Standard deviation of the disturbance of each coefficient; by default that of
        `coefficient_noise`. [1]
    memory : float
        Time constant of the disturbance; 0 is white. [s]

    Returns
    -------
    Expected
        A-priori values: least squares on the coefficients of the predicted motion, without noise.

    Raises
    ------
    UnknownName
        The motion does not have a variable of the model, or the coefficient has no noise.
    IdentificationError
        The motion does not determine the terms; the text names the combination.
    """
    data = reduced_rates(response, aircraft)
    # models name the applied deflections as the surfaces
    applied = {}
    for name in data.data_vars:
        if str(name).startswith("applied."):
            applied[str(name).removeprefix("applied.")] = data[name]
    data = data.assign(applied)
    data = data.assign(_body_forces(data))
    if noise is None:
        sigma = coefficient_noise(aircraft, response).get(model.coefficient)
    else:
        sigma = noise.get(model.coefficient)
    if sigma is None or model.coefficient not in data:
        raise UnknownName(model.coefficient, noise or _IMU, "coefficient", "give its noise")
    X, terms = model.design(data), list(model.terms)
    try:
        collinearity.demand_rank(X, terms)
    except IdentificationError as error:
        raise IdentificationError(f"{model}: with this test input {error}") from None
    theta = np.linalg.lstsq(X, data[model.coefficient].values, rcond=None)[0]
    step = float(np.median(np.diff(data["time"].values)))
    estimates = _estimate_covariance(terms, theta, [X / sigma], step=step, memory=memory)
    return Expected(str(model), estimates)


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
    """Return the Cramer-Rao bounds of model parameters, for output error with a test input.

    Parameters
    ----------
    sim, signal, start, scale
        As in `predicted_response.model_inputs`.
    parameters : sequence of str
        Parameters of the model: ``term.Cm.qhat`` (a factor, one), ``node.CL.basic[3]``,
        ``mass.Iyy`` ...
    noise : mapping of str to float
        Compared outputs, each with the standard deviation of its noise. [SI]
    nuisance : sequence of str
        Further free parameters of the fit, which are not reported: ``bias.Cm``, ``init.alpha``,
        ``init.q`` ...
    memory : float
        Time constant of the noise of the outputs; 0 is white. [s]

    Returns
    -------
    Expected
        Values of `parameters`.  The nuisance parameters increase their covariance.

    Raises
    ------
    IdentificationError
        The outputs do not distinguish the parameters, or do not depend on them.
    UnknownName
        The model does not have a parameter or an output.
    """
    names = [*parameters, *nuisance]
    values = np.array([_parameter_value(sim, start, name) for name in names])
    inputs = model_inputs(sim, signal, start, scale=scale)
    S = _differentiate_outputs(sim, inputs, start, values=dict(zip(names, values)), outputs=noise)
    # sensitivities in units of the noise, one block per output
    blocks = [S[:, :, k] / sigma for k, sigma in enumerate(noise.values())]
    try:
        collinearity.demand_rank(np.vstack(blocks), names)
    except IdentificationError as error:
        raise IdentificationError(f"output error: with this test input {error}") from None
    step = float(np.median(np.diff(signal["time"].values)))
    estimates = _estimate_covariance(names, values, blocks, step=step, memory=memory)
    reported = slice(len(parameters))
    return Expected(
        f"output error ({' '.join(noise)})", estimates.isel(term=reported, term_=reported)
    )


def _differentiate_outputs(
    sim: SimModel,
    inputs: xr.Dataset,
    start: Mapping[str, float],
    *,
    values: Mapping[str, float],
    outputs: Iterable[str],
) -> np.ndarray:
    """Return central differences of the outputs, (time, parameter, output).

    All runs are simulated in one batch.
    """
    centre = np.array(list(values.values()))
    steps = _DIFFERENCE * np.where(centre == 0.0, 1.0, np.abs(centre))
    # rows 2k and 2k + 1: parameter k increased and decreased by its step
    table = np.repeat(centre[None], 2 * len(steps), axis=0)
    table[0::2] += np.diag(steps)
    table[1::2] -= np.diag(steps)
    fixed = {name: value for name, value in start.items() if name not in values}
    outputs = list(outputs)
    y = flightmech.simulate_batch(
        sim,
        inputs,
        {name: table[:, k] for k, name in enumerate(values)},
        parameters={**fixed, "mode.trim": 0.0},
        outputs=outputs,
        step=STEP,
    )
    runs = np.stack([y[name].values for name in outputs], axis=-1)
    return np.moveaxis((runs[0::2] - runs[1::2]) / (2.0 * steps[:, None, None]), 0, 1)


def _parameter_value(sim: SimModel, start: Mapping[str, float], name: str) -> float:
    if name in start:
        return float(start[name])
    return float(Simulation(sim.model).parameter(index_of_parameter(sim, name)))


def _body_forces(data: xr.Dataset) -> dict[str, xr.DataArray]:
    """Return the body-axis force coefficients of lift and drag, if the data have these."""
    if not {"CL", "CD", "alpha"} <= set(map(str, data.data_vars)):
        return {}
    c, s = np.cos(data["alpha"]), np.sin(data["alpha"])
    return {"CX": data["CL"] * s - data["CD"] * c, "CZ": -data["CL"] * c - data["CD"] * s}


def _estimate_covariance(
    terms: list[str], theta: np.ndarray, blocks: list[np.ndarray], *, step: float, memory: float
) -> xr.Dataset:
    """Return the least-squares covariance, for white noise and for noise with a memory.

    The blocks are regressors in units of their noise.
    """
    X = np.vstack(blocks)
    # (X'X)^-1 by the triangular factor, whose condition is the root of that of X'X
    _, R = np.linalg.qr(X)
    inverse = np.linalg.solve(R, np.eye(len(terms)))
    white = inverse @ inverse.T
    covariance = white
    if memory != 0.0:
        # [Morelli1997]: the information of coloured noise between two white covariances
        coloured = sum(_coloured_information(x, step, memory) for x in blocks)
        covariance = white @ coloured @ white
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
    """Return the sum over i and j of x_i exp(-|i - j| step/memory) x_j', (term, term)."""
    lags = np.arange(-(len(x) - 1), len(x))
    kernel = np.exp(-np.abs(lags) * step / memory)
    return x.T @ fftconvolve(x, kernel[:, None], mode="same", axes=0)
