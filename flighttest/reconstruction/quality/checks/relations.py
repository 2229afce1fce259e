"""What kinematics and the atmosphere demand of the channels of a record: pairs that must agree
whatever the aeroplane does.

Each relation computes one quantity twice, from different channels.  They agree to noise, wind and
neglected effects (sideslip, sensor positions) when every channel has its sign, unit and axis; a
mistake in any of these makes them disagree grossly.  Relations overlap, so that the one channel
that explains all disagreements can be found (`repairs`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flightmech.air import GAMMA, R_AIR, calibrated_airspeed, mach_number
from flightmech.support.arrays import rms
from flightmech.units import G0
from flighttest.reconstruction.quality.checks.formed_channels import (
    describe_channel,
    source_channels,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.records.sensors.measurements import pressure
from flighttest.records.signals.differentiation import derivative

_TINY = 1e-12
_LATE = 0.2  # s by which one side may be behind the other; delays are found elsewhere
_SHORTEST, _PERIODS = 4.0, 3.0  # s; periods of the cut-off: shorter stretches prove nothing


@dataclass(frozen=True)
class Relation:
    """Two ways to one quantity.

    Attributes
    ----------
    name, title : str
        Key, and both sides in words.
    needs : tuple of str
        Channels without which it cannot be formed.
    sides : callable
        Signals -> (first side, second side).
    units : str
        SI unit of both sides.
    cutoff : float
        Frequency below which both are compared. [Hz]
    tolerance : float
        Rms difference that noise, changes of wind and neglected effects account for. [units]
    level : bool
        Whether the level counts, or changes only.
    limit : float
        Disagreement above which something is wrong. [1]
    optional : tuple of str
        Channels it uses where they are there.
    formed : tuple of str
        Those of `needs` that may be formed from other channels where they are not recorded
        (`formed_channels`).
    """

    name: str
    title: str
    needs: tuple[str, ...]
    sides: Callable[[ResampledChannels], tuple[np.ndarray, np.ndarray]]
    units: str
    cutoff: float
    tolerance: float
    level: bool = False
    limit: float = 0.3
    optional: tuple[str, ...] = ()
    formed: tuple[str, ...] = ("V",)

    def channels(self, signals: ResampledChannels) -> tuple[str, ...]:
        """Return the recorded channels it rests on."""
        rests_on = [name for need in self.needs for name in self._sources(need, signals)]
        others = [name for name in self.optional if name in signals]
        return tuple(dict.fromkeys([*rests_on, *others]))

    def missing(self, signals: ResampledChannels) -> tuple[str, ...]:
        """Return those of `needs` that are neither recorded nor formed from others."""
        return tuple(need for need in self.needs if not self._sources(need, signals))

    def compare(self, signals: ResampledChannels) -> RelationCheck | None:
        """Return both sides and how far they disagree; None where a channel or enough of the flight
        is missing.
        """
        if self.missing(signals):
            return None
        mask = self.mask(signals)
        if mask.sum() * signals.step < self.shortest:
            return None
        first, second = (_finite(side) for side in self.sides(signals.completed(self.formed)))
        first, second = (
            lowpass_if_possible(side, signals.step, self.cutoff) for side in (first, second)
        )
        y, x = (side[mask] - (0.0 if self.level else side[mask].mean()) for side in (first, second))
        size = rms(y) + rms(x)
        late = _LATE * min(rms(np.gradient(side, signals.step)[mask]) for side in (first, second))
        allowed = np.hypot(self.tolerance, late)
        apart = float(np.sqrt(max(rms(y - x) ** 2 - allowed**2, 0.0))) / max(
            size, 4.0 * self.tolerance
        )
        raw = rms(y - x) / max(size, _TINY)
        return RelationCheck(
            self, signals.time, first, second, mask, apart, raw, size > 4.0 * self.tolerance
        )

    def mask(self, signals: ResampledChannels) -> np.ndarray:
        """Return the samples that count: whole channels in flight, without what the ends of the
        filter may spoil.
        """
        mask = signals.mask(self.channels(signals))
        edge = round(0.5 / (self.cutoff * signals.step))
        mask[:edge] = mask[len(mask) - edge :] = False
        return mask

    @property
    def shortest(self) -> float:
        """Time in flight below which it proves nothing. [s]"""
        return max(_SHORTEST, _PERIODS / self.cutoff)

    def _sources(self, need: str, signals: ResampledChannels) -> tuple[str, ...]:
        if need in signals:
            return (need,)
        return source_channels(need, signals.values) if need in self.formed else ()


@dataclass(frozen=True)
class RelationCheck:
    """Both sides of a relation for a record.

    `disagreement` is rms(difference beyond the tolerance)/(rms + rms): 0 equal, 0.7 unrelated, 1
    opposite; two sides that are small against the tolerance agree.  `raw` is the same without
    tolerance; `moving` shows whether there was more than that to compare.
    """

    relation: Relation
    time: np.ndarray
    first: np.ndarray
    second: np.ndarray
    mask: np.ndarray
    disagreement: float
    raw: float
    moving: bool

    @property
    def consistent(self) -> bool:
        """Whether the disagreement is below the limit of the relation."""
        return self.disagreement <= self.relation.limit

    @property
    def has_signal(self) -> bool:
        """Whether both sides move by more than the tolerance: one that wanders while the other
        rests shows no factor and no sign.
        """
        sides = (
            side[self.mask] - (0.0 if self.relation.level else side[self.mask].mean())
            for side in (self.first, self.second)
        )
        return min(rms(side) for side in sides) > self.relation.tolerance

    @property
    def offset(self) -> float:
        """Mean of first minus second. [units]"""
        return float((self.first - self.second)[self.mask].mean())

    @property
    def slope(self) -> float:
        """First per second, errors in both alike: standard deviation over standard deviation, with
        the sign of the correlation.
        """
        return float(
            np.sign(self.correlation)
            * np.std(self.first[self.mask])
            / max(np.std(self.second[self.mask]), _TINY)
        )

    @property
    def correlation(self) -> float:
        """Correlation of the changes."""
        y, x = (side[self.mask] - side[self.mask].mean() for side in (self.first, self.second))
        return float((y * x).mean() / max(rms(y) * rms(x), _TINY))


def compare_all(signals: ResampledChannels) -> dict[str, RelationCheck]:
    """Return every relation that the record can speak to."""
    found = ((relation.name, relation.compare(signals)) for relation in RELATIONS)
    return {name: comparison for name, comparison in found if comparison is not None}


def not_checked(signals: ResampledChannels) -> pd.DataFrame:
    """Return the relations that a record cannot speak to, with the reason.

    Returns
    -------
    DataFrame
        ``relation title missing reason``; `missing` are the channels that are absent, empty where
        they are there for too short a time.
    """
    table: list = []
    for relation in RELATIONS:
        missing = relation.missing(signals)
        if missing:
            reason = "not recorded: " + "; ".join(
                describe_channel(name, name in relation.formed) for name in missing
            )
        elif (seconds := float(relation.mask(signals).sum() * signals.step)) < relation.shortest:
            together = ", ".join(relation.channels(signals))
            reason = (
                f"{together} are whole together for {seconds:.1f} s of flight; "
                f"{relation.shortest:.0f} s are needed"
            )
        else:
            continue
        table.append((relation.name, relation.title, missing, reason))
    return pd.DataFrame(table, columns=["relation", "title", "missing", "reason"])


def _finite(x: np.ndarray) -> np.ndarray:
    return np.nan_to_num(x, nan=0.0, posinf=0.0, neginf=0.0)


def _rate(s: ResampledChannels, name: str) -> np.ndarray:
    return derivative(s[name], s.step, window=5, order=4 if s.step < 0.15 else 2)


def _angles(s: ResampledChannels) -> tuple[np.ndarray, ...]:
    return np.sin(s["phi"]), np.cos(s["phi"]), np.sin(s["theta"]), np.cos(s["theta"])


def _alpha(s: ResampledChannels) -> np.ndarray:
    """Angle of attack: the vane, else what attitude and climb give in wings-level flight, else
    zero.
    """
    if "alpha_vane" in s:
        return np.clip(s["alpha_vane"], -0.6, 0.6)
    return (
        np.clip(_path_alpha(s), -0.6, 0.6)
        if {"h_baro", "V"} <= set(s.values)
        else np.zeros_like(s.time)
    )


def _path_alpha(s: ResampledChannels) -> np.ndarray:
    """Angle of attack without sideslip from sin(gamma) = cos(alpha) sin(theta) - sin(alpha)
    cos(phi) cos(theta).
    """
    _, cf, st, ct = _angles(s)
    sine = np.clip(_rate(s, "h_baro") / np.maximum(np.abs(s["V"]), 1.0), -1.0, 1.0)
    size = np.maximum(np.hypot(st, cf * ct), 1e-3)
    return np.arctan2(st, cf * ct) - np.arcsin(np.clip(sine / size, -1.0, 1.0))


def _bank_rate(s: ResampledChannels):
    sf, cf, st, ct = _angles(s)
    return _rate(s, "phi"), s["p"] + (s["q"] * sf + s["r"] * cf) * st / np.where(
        np.abs(ct) < 0.1, 0.1, ct
    )


def _pitch_rate(s: ResampledChannels):
    sf, cf, _, _ = _angles(s)
    return _rate(s, "theta"), s["q"] * cf - s["r"] * sf


def _heading_rate(s: ResampledChannels):
    sf, cf, _, ct = _angles(s)
    return _rate(s, "psi"), (s["q"] * sf + s["r"] * cf) / np.where(np.abs(ct) < 0.1, 0.1, ct)


def _inertial(s: ResampledChannels) -> np.ndarray:
    """Acceleration of the ground velocity less gravity, body axes."""
    sf, cf, st, ct = _angles(s)
    sp, cp = np.sin(s["psi"]), np.cos(s["psi"])
    n, e, d = _rate(s, "vn"), _rate(s, "ve"), _rate(s, "vd") - G0
    ahead, right = cp * n + sp * e, cp * e - sp * n
    down = st * ahead + ct * d
    return np.stack([ct * ahead - st * d, cf * right + sf * down, cf * down - sf * right])


def _force(axis: int, channel: str):
    return lambda s: (s[channel], _inertial(s)[axis])


def _vertical(s: ResampledChannels):
    sf, cf, st, ct = _angles(s)
    up = st * s["ax_imu"] - ct * (sf * s["ay_imu"] + cf * s["az_imu"])
    return derivative(_rate(s, "h_baro"), s.step, window=5, order=2), up - G0


def _along(s: ResampledChannels):
    _, cf, st, ct = _angles(s)
    alpha = _alpha(s)
    return _rate(s, "V"), (s["ax_imu"] - G0 * st) * np.cos(alpha) + (
        s["az_imu"] + G0 * ct * cf
    ) * np.sin(alpha)


def _turn(s: ResampledChannels):
    sf, _, _, ct = _angles(s)
    alpha = _alpha(s)
    side = s.values.get("ay_imu", np.zeros_like(alpha))
    return s["V"] * (s["r"] * np.cos(alpha) - s["p"] * np.sin(alpha)), G0 * ct * sf + side


def _pull(s: ResampledChannels):
    _, cf, _, ct = _angles(s)
    return s["q"] * s["V"], -(s["az_imu"] + G0 * ct * cf)


def _heave(s: ResampledChannels):
    _, cf, _, ct = _angles(s)
    V = s["V"]
    return derivative(V * np.sin(s["alpha_vane"]), s.step, window=5, order=2), s["q"] * V * np.cos(
        s["alpha_vane"]
    ) + s["az_imu"] + G0 * ct * cf


def _vane(s: ResampledChannels):
    return s["alpha_vane"], _path_alpha(s)


def _slip(s: ResampledChannels):
    sf, _, _, ct = _angles(s)
    alpha = _alpha(s)
    drift = s["V"] * (s["p"] * np.sin(alpha) - s["r"] * np.cos(alpha)) + G0 * ct * sf + s["ay_imu"]
    return derivative(s["V"] * np.sin(s["beta_vane"]), s.step, window=5, order=2), drift


def _mach(s: ResampledChannels) -> np.ndarray:
    return mach_number(np.clip(s["q_c"], 0.0, 1e6), np.clip(s["p_static"], 1e2, 1e9))


def _sound(s: ResampledChannels) -> np.ndarray:
    return np.sqrt(GAMMA * R_AIR * np.clip(s["temperature"], 1.0, 1e5))


_ATTITUDE = ("phi", "theta", "p", "q", "r")
_EARTH = ("phi", "theta", "psi", "vn", "ve", "vd")
_PRESSURES = (
    "q_c",
    "p_static",
    "temperature",
)  # formed where they are not recorded; V itself never for a relation of air data
_NO_WIND = 0.25  # limit of relations that hold but for wind

RELATIONS: tuple[Relation, ...] = (
    Relation("phi_rate", "rate of bank, and p q r", _ATTITUDE, _bank_rate, "rad s-1", 1.5, 0.005),
    Relation("theta_rate", "rate of pitch attitude, and q r", ("phi", "theta", "q", "r"), _pitch_rate, "rad s-1", 1.5, 0.005),
    Relation("psi_rate", "rate of heading, and q r", ("phi", "theta", "psi", "q", "r"), _heading_rate, "rad s-1", 1.0, 0.005),
    Relation("force_x", "ax, and ground acceleration", (*_EARTH, "ax_imu"), _force(0, "ax_imu"), "m s-2", 0.25, 0.15),
    Relation("force_y", "ay, and ground acceleration", (*_EARTH, "ay_imu"), _force(1, "ay_imu"), "m s-2", 0.25, 0.25, limit=0.45),
    Relation(
        "force_z", "az, and ground acceleration",
        (*_EARTH, "az_imu"), _force(2, "az_imu"), "m s-2", 0.25, 0.25, level=True, limit=0.1,
    ),
    Relation(
        "vertical", "acceleration of height, and ax ay az",
        ("h_baro", "phi", "theta", "ax_imu", "ay_imu", "az_imu"), _vertical, "m s-2", 0.1, 0.6, level=True, limit=0.4,
    ),
    Relation(
        "along", "rate of airspeed, and ax az",
        ("V", "phi", "theta", "ax_imu", "az_imu"), _along, "m s-2", 0.2, 0.25, limit=0.4, optional=("alpha_vane", "h_baro"),
    ),
    Relation(
        "turn", "yaw rate times airspeed, and bank",
        ("V", "phi", "theta", "p", "r"), _turn, "m s-2", 0.08, 0.6, level=True, limit=0.4, optional=("alpha_vane", "ay_imu"),
    ),
    Relation(
        "pull", "pitch rate times airspeed, and az",
        ("V", "phi", "theta", "q", "az_imu"), _pull, "m s-2", 0.08, 0.6, level=True, limit=0.4,
    ),
    Relation(
        "heave", "rate of the alpha vane, and q az",
        ("alpha_vane", "V", "phi", "theta", "q", "az_imu"), _heave, "m s-2", 0.6, 0.7, limit=0.45,
    ),
    Relation(
        "vane", "alpha vane, and attitude less climb",
        ("alpha_vane", "phi", "theta", "h_baro", "V"), _vane, "rad", 0.2, 0.01, level=True,
    ),
    Relation(
        "slip", "rate of the beta vane, and r p bank ay",
        ("beta_vane", "V", "phi", "theta", "p", "r", "ay_imu"), _slip, "m s-2", 0.6, 0.5, limit=0.45, optional=("alpha_vane", "h_baro"),
    ),
    Relation(
        "track_n", "ground velocity north, and heading", ("vn", "V", "psi", "theta"),
        lambda s: (s["vn"], s["V"] * np.cos(s["psi"]) * np.cos(s["theta"])), "m s-1", 0.2, 12.0, level=True, limit=_NO_WIND,
    ),
    Relation(
        "track_e", "ground velocity east, and heading", ("ve", "V", "psi", "theta"),
        lambda s: (s["ve"], s["V"] * np.sin(s["psi"]) * np.cos(s["theta"])), "m s-1", 0.2, 12.0, level=True, limit=_NO_WIND,
    ),
    Relation("climb", "-vd, and rate of pressure height", ("vd", "h_baro"), lambda s: (-s["vd"], _rate(s, "h_baro")), "m s-1", 0.2, 0.5),
    Relation(
        "climb_rate", "climb rate, and rate of pressure height", ("hdot", "h_baro"), lambda s: (s["hdot"], _rate(s, "h_baro")),
        "m s-1", 0.2, 0.5,
    ),
    Relation(
        "heights", "satellite height, and pressure height", ("h_gps", "h_baro"), lambda s: (s["h_gps"], s["h_baro"]),
        "m", 0.2, 5.0, limit=0.2,
    ),
    Relation(
        "airspeed", "true airspeed, and impact pressure", ("V", "q_c", "p_static", "temperature"),
        lambda s: (s["V"], _mach(s) * _sound(s)), "m s-1", 0.5, 5.0, level=True, limit=0.05, formed=_PRESSURES,
    ),
    Relation(
        "mach", "Mach number, and airspeed over speed of sound", ("mach", "V", "temperature"),
        lambda s: (s["mach"], s["V"] / _sound(s)), "1", 0.5, 0.01, level=True, limit=0.05, formed=("temperature",),
    ),
    Relation(
        "mach_pressure", "Mach number, and impact pressure", ("mach", "q_c", "p_static"), lambda s: (s["mach"], _mach(s)),
        "1", 0.5, 0.01, level=True, limit=0.05, formed=("q_c", "p_static"),
    ),
    Relation(
        "calibrated", "calibrated airspeed, and impact pressure", ("V_cas", "q_c"),
        lambda s: (s["V_cas"], calibrated_airspeed(np.clip(s["q_c"], 0.0, 1e6))), "m s-1", 0.5, 5.0, level=True, limit=0.05,
        formed=(),
    ),
    Relation(
        "altitude", "static pressure, and pressure height", ("p_static", "h_baro"),
        lambda s: (s["p_static"], pressure(np.clip(s["h_baro"], -2000.0, 30000.0))), "Pa", 0.5, 100.0, level=True, limit=0.03, formed=(),
    ),
)  # fmt: skip
