"""Bench records of actuators, simulated: a PWM servo with limits and dead time, and a DC motor on a
torque cell.

Truth for the study of `flighttest.actuators`, independent of it: steps of 0.2 ms, each exact for a
held input, clipped at the limits.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.linalg import expm

STEP = 2e-4  # of the simulation [s]
FRAME = 0.02  # of a PWM signal [s]


@dataclass(frozen=True)
class Actuator:
    """Ma v' + Ca v + Ka p + tau = B [u(t - delay) - neutral], with limits; a motor has no
    stiffness.
    """

    Ma: float = 2.5e-5  # [kg m2]
    Ca: float = 1.4e-3  # [N m s]
    Ka: float = 0.04  # [N m]
    B: float = 4.8e-5  # [N m per unit of the command]
    neutral: float = 1500.0
    delay: float = 0.018  # [s]
    rate_limit: float = math.inf  # [rad/s]
    stops: tuple[float, float] = (-math.inf, math.inf)  # [rad]


SERVO = Actuator()
LIMITED = Actuator(rate_limit=5.5, stops=(-0.27, 0.30))
MOTOR = Actuator(Ma=2.5e-4, Ca=8.0e-4, Ka=0.0, B=0.05, neutral=0.1, delay=0.0)  # command: throttle


@dataclass(frozen=True)
class Campaign:
    """What is recorded, and with which noise."""

    duration: float = 8.0  # [s]
    rate: float = 250.0  # [Hz]
    amplitude: float = 350.0  # of the pulses, in units of the command
    position: float | None = 0.003  # noise, None where it is not recorded [rad]
    speed: float | None = None  # noise of the rate, None where it is not recorded [rad/s]
    torque: float | None = None  # noise of the torque cell, None where there is none [N m]
    load: float = 2e-3  # size of the load on the torque cell [N m]


def log(actuator: Actuator, campaign: Campaign, seed: int) -> xr.Dataset:
    """Return one log: a train of pulses of random height and length, sent in frames."""
    rng = np.random.default_rng(seed)
    count, every = round(campaign.duration / STEP), round(1.0 / (campaign.rate * STEP))
    time = STEP * np.arange(count)
    edges = np.cumsum(rng.uniform(0.15, 0.6, int(campaign.duration / 0.15) + 2))
    levels = actuator.neutral + campaign.amplitude * rng.uniform(-1.0, 1.0, len(edges) + 1)
    frame = round(FRAME / STEP)
    command = levels[np.searchsorted(edges, time)][np.arange(count) // frame * frame]
    torque = np.zeros(count)
    if campaign.torque is not None:
        knots = np.arange(0.0, campaign.duration + 0.2, 0.1)
        torque = np.interp(time, knots, campaign.load * rng.standard_normal(len(knots)))
    position, rate = _response(actuator, command, torque)
    measured = {"command": command[::every]}
    for name, truth, noise in (
        ("position", position, campaign.position),
        ("rate", rate, campaign.speed),
        ("torque", torque, campaign.torque),
    ):
        if noise is not None:
            measured[name] = truth[::every] + noise * rng.standard_normal(len(truth[::every]))
    return xr.Dataset(
        {name: ("time", x) for name, x in measured.items()},
        {"time": time[::every]},
        {"record": f"bench {seed}"},
    )


def _response(
    actuator: Actuator, command: np.ndarray, torque: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    late = round(actuator.delay / STEP)
    delayed = np.concatenate([np.full(late, command[0]), command[: len(command) - late]])
    load = np.append(
        0.5 * (torque[1:] + torque[:-1]), torque[-1]
    )  # linear between samples, the command is held
    drive = (actuator.B * (delayed - actuator.neutral) - load) / actuator.Ma
    k, c = actuator.Ka / actuator.Ma, actuator.Ca / actuator.Ma
    E = expm(STEP * np.array([[0.0, 1.0, 0.0], [-k, -c, 1.0], [0.0, 0.0, 0.0]])).tolist()
    (pp, pv, pf), (vp, vv, vf) = E[0], E[1]
    limit, (low, high) = actuator.rate_limit, actuator.stops
    p = min(max(drive[0] / k, low), high) if k else 0.0
    v = 0.0 if k else drive[0] / c
    positions, rates = np.empty(len(drive)), np.empty(len(drive))
    for i, f in enumerate(drive.tolist()):
        positions[i], rates[i] = p, v
        moved = min(max(pp * p + pv * v + pf * f, p - limit * STEP), p + limit * STEP)
        v = min(max(vp * p + vv * v + vf * f, -limit), limit)
        p = min(max(moved, low), high)
        if (moved - p) * v > 0.0:
            v = 0.0
    return positions, rates


def main(folder: Path) -> None:
    """Write two logs each of a servo and of one at its limits, and two of a motor on a torque cell,
    as CSV files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cell = Campaign(amplitude=0.3, position=None, speed=1.0, torque=1e-4)
    for name, actuator, campaign in (
        ("servo", SERVO, Campaign()),
        ("limited", LIMITED, Campaign()),
        ("motor", MOTOR, cell),
    ):
        for seed in (1, 2):
            table = log(actuator, campaign, seed).to_dataframe().reset_index()
            if "position" in table:
                table["angle"] = np.degrees(table.pop("position"))
            table.round(6).to_csv(folder / f"{name}_{seed}.csv", index=False)
    print(f"written: 6 logs in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "bench"))
