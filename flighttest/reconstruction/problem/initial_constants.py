"""Constants of a reconstruction with their prior, from an instrument specification and a record."""

from __future__ import annotations

import numpy as np

from flightmech.air import R_AIR
from flightmech.names import lookup
from flighttest.reconstruction.problem.output_equations import LAPSE
from flighttest.reconstruction.problem.problem import Constants
from flighttest.reconstruction.problem.record_inputs import EXACT_FACTOR, RecordInputs
from flighttest.reconstruction.problem.sensor_groups import low_radio_heights
from flighttest.records.sensors.instruments import IMU

WIND_SIGMA = 25.0  # m/s, of each horizontal component
# Lag of vanes whose specification does not state one: value and standard deviation. [s]
_LAG = (0.02, 0.01)
_PRESSURE_SIGMA = 1000.0  # Pa, of the pressure at the reference height
# Pa, of the same where no other sensor shows the height: the pressure then defines the height.
_PRESSURE_SIGMA_ALONE = 0.1
_FAST = 20.0  # m/s: airspeed above which ground velocity less airspeed is an estimate of the wind

_Prior = tuple[str, float, float]  # unit, mean, standard deviation


def initial_constants(
    inputs: RecordInputs, x: np.ndarray, g: float, reference: tuple[float, float]
) -> tuple[Constants, np.ndarray]:
    """Return the constants with their prior, and their start values (nc,).

    Parameters
    ----------
    inputs : RecordInputs
    x : array (N, n)
        First trajectory.
    g : float
        Gravity. [m s-2]
    reference : (float, float)
        Reference height and the measured temperature there. [m], [K]
    """
    priors = _instrument_priors(inputs)
    start: dict[str, float] = {}
    if inputs.can_use("vn", "ve"):
        priors["wind_n"] = priors["wind_e"] = ("m s-1", 0.0, WIND_SIGMA)
        start["wind_n"], start["wind_e"] = _first_wind(inputs, x)
    priors["wind_d"] = ("m s-1", 0.0, inputs.wind_down)
    priors["p_reference"] = _reference_pressure(inputs, x, g, reference)
    units, mean, sigma = zip(*priors.values(), strict=True)
    c = np.array([start.get(name, m) for name, m in zip(priors, mean, strict=True)])
    return Constants(tuple(priors), units, np.array(mean), np.diag(np.square(sigma))), c


def _instrument_priors(inputs: RecordInputs) -> dict[str, _Prior]:
    """Return the priors of biases, scale errors, factors, lags and latencies."""
    specification = inputs.specification
    channels = []
    for name in (*IMU, *inputs.measured):
        if name != "h_radio" and inputs.can_use(name):
            channels.append(name)
    if low_radio_heights(inputs) is not None:
        channels.append("h_radio")
    # A constant is estimated if the specification of its instrument states an uncertainty.
    priors: dict[str, _Prior] = {}
    for name in channels:
        bias_sigma = specification.of(name).bias_sigma
        if name in bias_sigma:
            priors[f"bias.{name}"] = (lookup(name).units, 0.0, bias_sigma[name])
    for name in IMU:
        scale_sigma = specification.of(name).scale_sigma
        if name in scale_sigma:
            priors[f"scale.{name}"] = ("1", 0.0, scale_sigma[name])
    for name in inputs.vanes:
        factor = specification.of(name).factor.get(name, EXACT_FACTOR)
        priors[f"factor.{name}"] = ("1", *factor)
    if inputs.vanes:
        priors["lag.vanes"] = ("s", *(specification.of(inputs.vanes[0]).lag or _LAG))
    airspeed = inputs.air.channel
    airspeed_factor = specification.of(airspeed).factor.get(airspeed)
    if airspeed_factor and inputs.can_use(airspeed):
        priors[f"factor.{airspeed}"] = ("1", *airspeed_factor)
    static_error = specification.of("q_c").static_error
    if static_error:
        priors["static_error"] = ("1", *static_error)
    for name in channels:
        delay = specification.of(name).delay
        if delay:
            priors[specification.delay_of(name)] = ("s", *delay)
    return priors


def _reference_pressure(
    inputs: RecordInputs, x: np.ndarray, g: float, reference: tuple[float, float]
) -> _Prior:
    """Return the prior of the pressure at the reference height."""
    height, temperature = reference
    p = inputs.air.at(inputs.time, inputs.air.p_static)
    # hydrostatic: p/p_0 = (T/T_0)^(g/(R lapse))
    temperature_ratio = 1.0 - LAPSE * (x[:, 6] - height) / temperature
    level = float(np.mean(p / temperature_ratio ** (g / (R_AIR * LAPSE))))
    if inputs.can_use("h_gps"):
        return "Pa", level, _PRESSURE_SIGMA
    return "Pa", level, _PRESSURE_SIGMA_ALONE


def _first_wind(inputs: RecordInputs, x: np.ndarray) -> tuple[float, float]:
    """Return the mean of ground velocity less airspeed along the nose, north and east. [m s-1]

    It is zero without a heading, or if the whole record is slow.
    """
    V = inputs.air.speed_at(inputs.time)
    fast = V > _FAST
    if "psi" not in inputs.channels or not fast.any():
        return 0.0, 0.0
    psi = x[:, 2]
    north = (x[:, 3] - V * np.cos(psi))[fast].mean()
    east = (x[:, 4] - V * np.sin(psi))[fast].mean()
    return float(north), float(east)
