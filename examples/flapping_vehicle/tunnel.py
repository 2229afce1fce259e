"""A tail on a wind-tunnel balance, simulated: cycled through its range at several airspeeds, with
tare, strut and noise.

Truth for the study of `flighttest.wind_tunnel`; the coefficients are the averages of Grauer and
others, AIAA 2010-7632, Table 2.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

CL = {
    "1": 0.0623,
    "alpha": 1.1436,
    "alpha*beta": -0.2075,
    "alpha**3": -0.4560,
    "alpha**2*beta**2": 0.2454,
}
CD = {"1": 0.0872, "alpha**2": 0.3325}
S, B, C = 0.032, 0.40, 0.10  # reference area, span [m2, m], chord
RHO = 1.2  # [kg/m3]
OFFSET = np.array([-0.12, 0.0, 0.02])  # centre of the balance from the moment reference point [m]
WEIGHT, ARM = (
    1.6,
    np.array([0.05, 0.0, 0.0]),
)  # of the model on the balance [N], its c.g. from the balance [m]
ZERO = np.array([0.02, -0.01, 0.05])  # of the balance [N]
STRUT = 0.03  # lift of the interference of the strut [1]
NOISE = 0.025  # of CL and CD at 10 m/s, as the paper's fits leave it
SETUP = """rho = "1.2 kg/m3"

[reference]
S = "0.032 m2"
b = "0.40 m"
c = "0.10 m"

[balance]
rotation = ["0 deg", "180 deg", "0 deg"]
offset = ["-0.12 m", "0 m", "0.02 m"]

[columns]
alpha = "alpha [deg]"
beta = "beta [deg]"
V = "speed"
Fx = "fx"
Fy = "fy"
Fz = "fz"
Mx = "mx"
My = "my"
Mz = "mz"
strut = "strut"

[errors]
alpha = "0.1 deg"
V = "0.05 m/s"

[nuisance]
CL = ["strut"]
"""


def record(
    seed: int,
    speed: float,
    alpha_error: float = 0.0,
    speed_error: float = 0.0,
    duration: float = 40.0,
) -> pd.DataFrame:
    """Return a record: ten seconds without wind, then the tail cycled at `speed` with the strut in
    for half of the time.

    Angle and airspeed are recorded with an error of calibration, `alpha_error` [rad] and
    `speed_error` [m/s].
    """
    rate, wind_off = 50.0, 10.0
    rng = np.random.default_rng(seed)
    time = np.arange(round((duration + wind_off) * rate)) / rate
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    alpha = -0.45 + 0.25 * np.sin(0.83 * time + phase[0]) + 0.15 * np.sin(2.61 * time + phase[1])
    beta = 0.45 * np.sin(0.57 * time + phase[2]) + 0.30 * np.sin(1.93 * time + phase[3])
    V = np.where(time < wind_off, 0.0, speed)
    inserted = (time // 5.0) % 2.0 == 1.0
    lift = (
        sum(value * _regressor(term, alpha, beta) for term, value in CL.items()) + STRUT * inserted
    )
    drag = sum(value * _regressor(term, alpha, beta) for term, value in CD.items())
    turbulence = np.where(V > 0.0, 1.0, 0.1)  # without wind only the noise of the balance is left
    scatter = turbulence * NOISE * rng.standard_normal((2, len(time))) * 0.5 * RHO * 10.0**2 * S
    qS = 0.5 * RHO * V**2 * S
    L, D = qS * lift + scatter[0], qS * drag + scatter[1]
    ca, sa = np.cos(alpha), np.sin(alpha)
    force = np.stack([L * sa - D * ca, np.zeros(len(time)), -L * ca - D * sa], axis=1)  # body axes
    moment = np.cross(-OFFSET, force)  # about the balance: all acts at the moment reference point
    gravity = WEIGHT * np.stack([-sa, np.zeros(len(time)), ca], axis=1)
    force, moment = force + gravity, moment + np.cross(ARM, gravity)
    turn = np.diag([-1.0, 1.0, -1.0])  # half a turn about y: axes of the balance
    force, moment = force @ turn.T + ZERO, moment @ turn.T
    columns = {
        "time": time,
        "speed": V + speed_error * (V > 0.0),
        "alpha": np.degrees(alpha + alpha_error),
        "beta": np.degrees(beta),
        "strut": inserted.astype(float),
    }
    columns |= dict(
        zip(("fx", "fy", "fz", "mx", "my", "mz"), np.concatenate([force, moment], axis=1).T)
    )
    return pd.DataFrame(columns)


def _regressor(term: str, alpha: np.ndarray, beta: np.ndarray) -> np.ndarray:
    return np.broadcast_to(eval(term, {"alpha": alpha, "beta": beta}), alpha.shape)


def main(folder: Path) -> None:
    """Write two records and the setup of the balance."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, speed in enumerate((8.0, 11.0), 1):
        record(k, speed).round(6).to_csv(folder / f"tail_{k}.csv", index=False)
    (folder / "balance.toml").write_text(SETUP, encoding="utf-8")
    print(f"written: 2 records and the setup of the balance in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "tunnel"))
