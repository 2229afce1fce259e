"""Free motion of an identified control under the recorded forces, against the recorded motion: the proof of the regression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.units import G0

from .linkage import follow
from .loading import ControlLoading
from .motion import REST, free_motion, signals

_CABLE = ("inertia", "cable_stiffness", "cable_damping", "hinge_friction", "hinge_damping")


@dataclass(frozen=True)
class Flown:
    """One window of free motion.

    Attributes
    ----------
    time : array (time,)
        [s]
    travel, deflection : array (time, 2)
        Measured and simulated. [m or rad; rad]
    """

    time: np.ndarray
    travel: np.ndarray
    deflection: np.ndarray

    def misfit(self) -> tuple[float, float]:
        """Return the rms of measured minus simulated travel and deflection, over the range of the measured one."""
        pairs = (self.travel, self.deflection)
        found = [float(np.sqrt(np.mean((x[:, 0] - x[:, 1]) ** 2)) / np.ptp(x[:, 0])) for x in pairs]
        return found[0], found[1]


def fly_windows(loading: ControlLoading, estimates: Mapping[str, float], free: Sequence[xr.Dataset]) -> list[Flown]:
    """Return every window of free motion of the records, simulated with the recorded forces and air.

    Parameters
    ----------
    loading : ControlLoading
    estimates : mapping of str to float
        Names of `IdentifiedLoading.estimates`; a negative damping counts as none.
    free : sequence of Dataset (time,)
        Pulses and releases.

    Returns
    -------
    list of Flown

    Raises
    ------
    IdentificationError
        A mass or a stiffness that is not positive.
    """
    return [_flown(loading, estimates, window) for one in free for window in free_motion(loading, one)]


def _flown(loading: ControlLoading, p: Mapping[str, float], window: xr.Dataset) -> Flown:
    wrong = [f"{name} is {p[name]:.3g}" for name in ("mass", "inertia", "cable_stiffness") if name in p and not p[name] > 0.0]
    if wrong:
        raise IdentificationError(f"{loading.item}: {', '.join(wrong)}; join it with the drawings by `with_prior`, or take order 2")
    moved = signals(loading, window, None)
    time, g = moved["time"].values, loading.gearing
    step = float(np.median(np.diff(time)))
    load = loading.load(moved) / -g  # qbar S_hinge c_hinge
    factors = loading.by_power(moved)
    moment = np.zeros((len(time), 1 + max(power for power, _ in factors), 1))
    for (power, factor), term in zip(factors, loading.model.terms):
        moment[:, power, 0] += load * factor * p[loading.term(term)]
    force = moved[f"F_{loading.item}"].values - p["offset"]
    if "bob_weight" in loading.constants:
        force = force - p["bob_weight"] * G0 * (moved["nz"].values - 1.0)
    rest = max(1, round(REST / step))
    s, delta = moved["travel"].values, moved[loading.deflection].values
    rigging = p.get("rigging", 0.0)
    spring = p.get("stiffness", 0.0) + p.get("nose_spring", 0.0) * float(moved["on_ground"].values.mean())
    constants = {name: np.array([max(0.0, p[name])]) for name in ("mass", "damping", "friction", *_CABLE) if name in p}
    constants |= {"damping": constants.get("damping", np.zeros(1)), "preload": np.array([max(0.0, p.get("preload", 0.0))])}
    constants |= {"stiffness": np.array([spring]), "rigging": np.array([rigging])}
    start = np.array([s[:rest].mean()]), np.array([(delta[:rest].mean() - rigging) / g])
    S, D = follow(constants, g, start, force[:, None], moment, step)
    return Flown(time, np.column_stack([s, S[:, 0]]), np.column_stack([delta, D[:, 0]]))
