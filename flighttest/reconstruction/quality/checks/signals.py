"""Channels of a record on one slow clock, with masks of valid samples, for the checks.

Kinematics relate channels at low frequency, where delays and sensor positions matter little. All
channels are therefore low-passed without phase and resampled to at most 20 samples per second.
Parts with missing or frozen samples and parts on the ground are not valid.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import WRAPPED
from flighttest.reconstruction.quality.checks.formed_channels import form_channel, source_channels
from flighttest.records.sensors.position_corrections import force_at_cg
from flighttest.records.signals.differentiation import derivative
from flighttest.records.signals.resampling import is_control, lowpass

RATE = 20.0  # Hz
BAND = 2.0  # Hz
AIRBORNE = 0.4  # of the speed that is exceeded for a tenth of the record: on the ground below
_MARGIN = 1.0  # s around a fault that are not valid
_TRANSIT = 2.0  # s before and after the ground that are not valid
_LEAST_SPEED = 1.0  # m/s, in the correction of vanes
_RADIAN_LIMIT = 6.6  # heading above which the unit is degrees
_DISCRETE = ("wow_", "gear", "speedbrake", "brake")
_SPEEDS = ("V", "V_cas", "mach", "q_c", "vn")
_CLOCKS = ("p", "q", "r", "theta", "phi", "V", "h_baro")


@dataclass(frozen=True)
class ResampledChannels:
    """Channels on one uniform clock.

    Attributes
    ----------
    time : array (time,)
        [s]
    values : dict of array (time,)
        Canonical name to channel, SI.
    good : dict of array of bool (time,)
        Valid samples of a channel.
    flying : array of bool (time,)
        Samples in the air.
    step : float
        [s]
    formed : dict of array (time,)
        Cache of the channels that `completed` formed from recorded ones. [SI]
    """

    time: np.ndarray
    values: dict[str, np.ndarray]
    good: dict[str, np.ndarray]
    flying: np.ndarray
    step: float
    formed: dict[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def mask(self, names: tuple[str, ...]) -> np.ndarray:
        """Return the samples in flight at which all of `names` are valid."""
        return np.logical_and.reduce([self.flying, *(self.good[name] for name in names)])

    def with_values(self, changed: dict[str, np.ndarray]) -> ResampledChannels:
        """Return the same signals with some channels replaced."""
        # Formed channels remain valid if their sources did not change.
        formed = {}
        for name, x in self.formed.items():
            if changed.keys().isdisjoint(source_channels(name, self.values)):
                formed[name] = x
        return replace(self, values={**self.values, **changed}, formed=formed)

    def without(self, names: Collection[str]) -> ResampledChannels:
        """Return the signals as if some channels had not been recorded."""
        values = {name: x for name, x in self.values.items() if name not in names}
        return replace(self, values=values, formed={})

    def completed(self, names: Collection[str]) -> ResampledChannels:
        """Return the signals with missing channels formed from recorded ones, if possible."""
        values, good = dict(self.values), dict(self.good)
        for name in names:
            sources = source_channels(name, self.values)
            if name in self.values or not sources:
                continue
            if name not in self.formed:
                formed = form_channel(name, self.values)
                assert formed is not None  # it has sources
                self.formed[name] = formed
            values[name] = self.formed[name]
            good[name] = np.logical_and.reduce([self.good[source] for source in sources])
        if len(values) == len(self.values):
            return self
        return replace(self, values=values, good=good)


def resample_channels(record: xr.DataTree, flags: pd.DataFrame) -> ResampledChannels:
    """Return the channels of a record on one clock.

    Parameters
    ----------
    record : DataTree
        Flight record.
    flags : DataFrame
        Faults of samples: ``leaf channel kind start stop``, see `faults_of`.

    Raises
    ------
    SchemaError
        The record holds no channel of motion.
    """
    leaf_of: dict[str, str] = {}
    for leaf, node in record.children.items():
        for name in node.data_vars:
            leaf_of[str(name)] = leaf
    lead = _first_present(_CLOCKS, leaf_of)
    if lead is None:
        raise SchemaError(
            "flight record",
            [f"none of {' '.join(_CLOCKS)} is there; a quality check needs channels of motion"],
        )
    lead_data = record[leaf_of[lead]].to_dataset()
    clock = lead_data["time"].values
    step = 1.0 / min(RATE, float(lead_data.attrs["rate"]))
    time = clock[0] + step * np.arange(max(int((clock[-1] - clock[0]) / step), 1) + 1)
    # A duplicate time stamp does not make samples invalid.
    flags = flags[flags["kind"] != "duplicate"]
    values, good = {}, {}
    for name, leaf in leaf_of.items():
        of_channel = (flags["leaf"] == leaf) & flags["channel"].isin(["", name])
        data = record[leaf].to_dataset()
        good[name] = _valid_samples(data, name, time=time, faults=flags[of_channel])
        values[name] = _resample(data, name, time)
    flying = _in_flight(values, good, step)
    return ResampledChannels(time, values, good=good, flying=flying, step=step)


def at_cg(signals: ResampledChannels, positions: Mapping[str, np.ndarray]) -> ResampledChannels:
    """Return the signals with accelerometers and vanes at the c.g.

    Parameters
    ----------
    signals : ResampledChannels
        With correct signs and units of p, q, r and V.
    positions : mapping of str to array (3,)
        Position of a sensor relative to the c.g. Other sensors are not moved. [m]
    """
    recorded = signals.values.keys()
    if not {"p", "q", "r"} <= recorded:
        return signals
    omega = np.stack([signals[name] for name in "pqr"], axis=1)
    corrected: dict[str, np.ndarray] = {}
    axes = ("ax_imu", "ay_imu", "az_imu")
    if "ax_imu" in positions and recorded >= set(axes):
        omega_dot = np.stack(
            [derivative(signals[name], signals.step, 5, 2) for name in "pqr"], axis=1
        )
        force = np.stack([signals[name] for name in axes], axis=1)
        force = force_at_cg(force, omega, omega_dot, positions["ax_imu"])
        corrected.update(zip(axes, force.T, strict=True))
    speed = signals.completed(("V",))
    if "V" in speed:
        # A vane at the position r moves with omega x r.
        p, q, r = omega.T
        V = np.maximum(speed["V"], _LEAST_SPEED)
        for name in {"alpha_vane", "beta_vane"} & positions.keys() & recorded:
            x, y, z = positions[name]
            if name == "alpha_vane":
                by_rotation = (q * x - p * y) / V
            else:
                by_rotation = (p * z - r * x) / V
            corrected[name] = signals[name] + by_rotation
    return signals.with_values(corrected)


def unwrap_angle(name: str, x: np.ndarray) -> np.ndarray:
    """Return an angle without its jumps of a turn, in radians or, by mistake, in degrees.

    Other channels are returned without a change.
    """
    if name not in WRAPPED:
        return x
    period = 2.0 * np.pi
    if np.nanmax(np.abs(x), initial=0.0) > _RADIAN_LIMIT:
        period = 360.0
    return np.unwrap(x, period=period)


def lowpass_if_possible(x: np.ndarray, step: float, cutoff: float) -> np.ndarray:
    """Return `x` after a low-pass, or `x` if the clock is too slow or too short for the filter."""
    if cutoff > 0.4 / step or len(x) * step < 2.0 / cutoff:
        return x
    return lowpass(x, 1.0 / step, cutoff)


def _first_present(names: Collection[str], present: Collection[str]) -> str | None:
    """Return the first name that is present; None without one."""
    for name in names:
        if name in present:
            return name
    return None


def _valid_samples(
    data: xr.Dataset, name: str, time: np.ndarray, faults: pd.DataFrame
) -> np.ndarray:
    """Return the samples on the clock `time` that are finite and without a fault."""
    finite = np.isfinite(data[name].values.astype(float))
    clock = data["time"].values
    # 1 only if both neighbours are finite
    valid = np.interp(time, clock, finite.astype(float), left=0.0, right=0.0) == 1.0
    for start, stop in zip(faults["start"], faults["stop"], strict=True):
        valid &= (time < start - _MARGIN) | (time > stop + _MARGIN)
    return valid


def _resample(data: xr.Dataset, name: str, time: np.ndarray) -> np.ndarray:
    """Return a channel on the clock `time`; zeros without a finite sample."""
    clock, x = data["time"].values, data[name].values.astype(float)
    finite = np.isfinite(x)
    if not finite.any():
        return np.zeros_like(time)
    x = np.interp(clock, clock[finite], x[finite])
    # Switches are not filtered, and neither are controls, whose steps are real.
    if name.rpartition(".")[2].startswith(_DISCRETE):
        return np.interp(time, clock, x)
    x = unwrap_angle(name, x)
    if is_control(name):
        return np.interp(time, clock, x)
    step = 1.0 / float(data.attrs["rate"])
    uniform = np.arange(clock[0], clock[-1] + 0.5 * step, step)
    x = lowpass_if_possible(np.interp(uniform, clock, x), step, BAND)
    return np.interp(time, uniform, x)


def _in_flight(
    values: dict[str, np.ndarray], good: dict[str, np.ndarray], step: float
) -> np.ndarray:
    """Return the samples in flight (time,); all samples without a speed."""
    name = _first_present(_SPEEDS, values)
    if name is None:
        some_channel = next(iter(values.values()))
        return np.ones(len(some_channel), bool)
    speed = np.abs(values[name])
    if name == "vn" and "ve" in values:
        speed = np.hypot(values["vn"], values["ve"])
    if name == "q_c":
        # proportional to the speed
        speed = np.sqrt(speed)
    valid = speed
    if good[name].any():
        valid = speed[good[name]]
    flying = speed > AIRBORNE * np.percentile(valid, 90.0)
    for wheel in ("wow_nose", "wow_left", "wow_right"):
        if wheel in values:
            flying &= values[wheel] < 0.01
    return _erode_mask(flying, round(_TRANSIT / step))


def _erode_mask(mask: np.ndarray, samples: int) -> np.ndarray:
    """Return the mask without the `samples` next to every sample where it is False."""
    width = 2 * min(samples, (len(mask) - 1) // 2) + 1
    near_false = np.convolve(~mask, np.ones(width), mode="same") > 0.5
    return mask & ~near_false
