"""The channels of a record on one slow clock, as the consistency checks read them, with the samples
that count.

Kinematics tie channels together at low frequency, where delays and sensor positions matter little.
So everything is low-passed without phase and brought to at most 20 samples per second; parts with
missing or frozen samples, and parts on the ground, do not count.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.reconstruction.quality.checks.formed_channels import form_channel, source_channels
from flighttest.records.sensors.position_corrections import force_at_cg
from flighttest.records.signals.differentiation import derivative
from flighttest.records.signals.resampling import is_control, lowpass

RATE = 20.0  # Hz
BAND = 2.0  # Hz
AIRBORNE = 0.4  # of the speed that is exceeded for a tenth of the record
_MARGIN = 1.0  # s around a fault that does not count either
_TRANSIT = 2.0  # s before and after the ground that do not count either
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
        Where a channel is whole.
    flying : array of bool (time,)
        Where the aeroplane is in the air.
    step : float
        [s]
    formed : dict of array (time,)
        Channels formed so far from recorded ones (`completed`), kept because every relation needs
        them. [SI]
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
        """Return the samples in flight at which all of `names` are whole."""
        return np.logical_and.reduce([self.flying, *(self.good[name] for name in names)])

    def with_values(self, changed: dict[str, np.ndarray]) -> ResampledChannels:
        """Return the same signals with some channels replaced."""
        kept = {
            name: x
            for name, x in self.formed.items()
            if not set(changed) & set(source_channels(name, self.values))
        }
        return replace(self, values={**self.values, **changed}, formed=kept)

    def without(self, names: Collection[str]) -> ResampledChannels:
        """Return the signals as if some channels had not been recorded."""
        values = {name: x for name, x in self.values.items() if name not in names}
        return replace(self, values=values, formed={})

    def completed(self, names: Collection[str]) -> ResampledChannels:
        """Return the signals with those of `names` that are not recorded formed from channels that
        are, where that is possible.
        """
        wanted = [
            name for name in names if name not in self.values and source_channels(name, self.values)
        ]
        if not wanted:
            return self
        for name in wanted:
            if name not in self.formed and (x := form_channel(name, self.values)) is not None:
                self.formed[name] = x
        values = {name: self.formed[name] for name in wanted}
        whole = {
            name: np.logical_and.reduce(
                [self.good[one] for one in source_channels(name, self.values)]
            )
            for name in wanted
        }
        return replace(self, values={**self.values, **values}, good={**self.good, **whole})


def resample_channels(record: xr.DataTree, flags: pd.DataFrame) -> ResampledChannels:
    """Return the channels of a record on one clock.

    Parameters
    ----------
    record : DataTree
        Flight record.
    flags : DataFrame
        Faults of samples: ``leaf channel kind start stop``, see `flighttest.signals.flags`.

    Raises
    ------
    SchemaError
        The record holds no channel of motion.
    """
    home = {str(name): leaf for leaf, node in record.children.items() for name in node.data_vars}
    lead = next((home[name] for name in _CLOCKS if name in home), None)
    if lead is None:
        raise SchemaError(
            "flight record",
            [f"none of {' '.join(_CLOCKS)} is there; a quality check needs channels of motion"],
        )
    clock = record[lead].to_dataset()["time"].values
    step = 1.0 / min(RATE, float(record[lead].attrs["rate"]))
    time = clock[0] + step * np.arange(max(int((clock[-1] - clock[0]) / step), 1) + 1)
    values, good = {}, {}
    for name, leaf in home.items():
        node = record[leaf].to_dataset()
        spans = flags[
            (flags["leaf"] == leaf)
            & flags["channel"].isin(["", name])
            & (flags["kind"] != "duplicate")
        ]
        values[name], good[name] = _on_clock(
            node["time"].values,
            node[name].values.astype(float),
            name,
            float(node.attrs["rate"]),
            time,
            spans,
        )
    return ResampledChannels(time, values, good, _flying(values, good, step), step)


def at_cg(signals: ResampledChannels, positions: Mapping[str, np.ndarray]) -> ResampledChannels:
    """Return the signals with accelerometers and vanes moved to the c.g., where the aircraft file
    gives their places.

    Parameters
    ----------
    signals : Signals
        With right signs and units of p, q, r and V.
    positions : mapping of str to array (3,)
        Channel to its place from the c.g. [m]
    """
    if not {"p", "q", "r"} <= set(signals.values):
        return signals
    speed = signals.completed(("V",))
    omega = np.stack([signals[name] for name in "pqr"], axis=1)
    changed: dict[str, np.ndarray] = {}
    if "ax_imu" in positions and {"ax_imu", "ay_imu", "az_imu"} <= set(signals.values):
        turn = np.stack([derivative(signals[name], signals.step, 5, 2) for name in "pqr"], axis=1)
        force = np.stack([signals[name] for name in ("ax_imu", "ay_imu", "az_imu")], axis=1)
        changed.update(
            zip(
                ("ax_imu", "ay_imu", "az_imu"),
                force_at_cg(force, omega, turn, positions["ax_imu"]).T,
            )
        )
    if "V" in speed:
        p, q, r = omega.T
        V = np.maximum(speed["V"], 1.0)
        for name in {"alpha_vane", "beta_vane"} & set(positions) & set(signals.values):
            x, y, z = positions[name]
            moved = (q * x - p * y) / V if name == "alpha_vane" else (p * z - r * x) / V
            changed[name] = signals[name] + moved
    return signals.with_values(changed)


def unwrap_heading(name: str, x: np.ndarray) -> np.ndarray:
    """Return a heading without its jumps, whether it is in radians or, by mistake, in degrees."""
    if name not in ("psi", "lon"):
        return x
    return np.unwrap(x, period=360.0 if np.nanmax(np.abs(x), initial=0.0) > 6.6 else 2.0 * np.pi)


def lowpass_if_possible(x: np.ndarray, step: float, cutoff: float) -> np.ndarray:
    """Return `x` low-passed, or as it is when the clock is too slow or too short for that."""
    if cutoff > 0.4 / step or len(x) * step < 2.0 / cutoff:
        return x
    return lowpass(x, 1.0 / step, cutoff)


def _on_clock(own, x, name, rate, time, spans) -> tuple[np.ndarray, np.ndarray]:
    whole = np.isfinite(x)
    good = np.interp(time, own, whole.astype(float), left=0.0, right=0.0) == 1.0
    for a, b in zip(spans["start"], spans["stop"]):
        good &= (time < a - _MARGIN) | (time > b + _MARGIN)
    if not whole.any():
        return np.zeros_like(time), good
    x = np.interp(own, own[whole], x[whole])
    if name.rpartition(".")[2].startswith(_DISCRETE):
        return np.interp(time, own, x), good
    x = unwrap_heading(name, x)
    if not is_control(name):
        x = lowpass_if_possible(
            np.interp(uniform := np.arange(own[0], own[-1] + 0.5 / rate, 1.0 / rate), own, x),
            1.0 / rate,
            BAND,
        )
        own = uniform
    return np.interp(time, own, x), good


def _flying(values: dict[str, np.ndarray], good: dict[str, np.ndarray], step: float) -> np.ndarray:
    speed = next((name for name in _SPEEDS if name in values), None)
    if speed is None:
        return np.ones(len(next(iter(values.values()))), bool)
    fast = (
        np.hypot(values["vn"], values["ve"])
        if speed == "vn" and "ve" in values
        else np.abs(values[speed])
    )
    if speed == "q_c":
        fast = np.sqrt(fast)
    flying = fast > AIRBORNE * np.percentile(fast[good[speed]] if good[speed].any() else fast, 90.0)
    for name in ("wow_nose", "wow_left", "wow_right"):
        if name in values:
            flying &= values[name] < 0.01
    return _eroded(flying, round(_TRANSIT / step))


def _eroded(mask: np.ndarray, samples: int) -> np.ndarray:
    """Return the mask less `samples` next to every place where it is False."""
    width = 2 * min(samples, (len(mask) - 1) // 2) + 1
    out = np.convolve(~mask, np.ones(width), mode="same") > 0.5
    return mask & ~out
