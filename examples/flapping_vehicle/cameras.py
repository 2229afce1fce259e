"""Markers on a flapping fuselage as cameras record them, simulated: a heaving, pitching, rolling
body with analytic rates.

Truth for the study of `flighttest.motion_capture`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

FLAPPING = 5.0  # [Hz]
NOISE = 5e-4  # of a coordinate of a marker [m]
MARKERS = {
    "nose": (0.20, 0.0, 0.0), "left": (0.02, -0.09, -0.03), "right": (0.01, 0.09, -0.03),
    "back": (-0.15, 0.01, -0.05),
    "belly": (-0.03, 0.0, 0.06),
}  # fmt: skip
SETUP = "\n".join(
    ['flapping_frequency = "5 Hz"', "multiples = 8", 'axes = "north west up"', "",
        "[body.fuselage]"]
    + [f"{name} = [{', '.join(f'{x}' for x in place)}]" for name, place in MARKERS.items()]
) + "\n"  # fmt: skip


def truth(time: np.ndarray) -> dict[str, np.ndarray]:
    """Return position and velocity north-east-down, Euler angles, body rates and specific force
    over time.
    """
    w = 2.0 * np.pi * FLAPPING
    heave = [(0.06, w, 0.3), (0.012, 2.0 * w, 1.1), (0.003, 3.0 * w, 0.2)]
    place = {
        "north": (4.0 * time, 4.0, 0.0),
        "east": (0.2 * np.sin(0.9 * time), 0.18 * np.cos(0.9 * time), -0.162 * np.sin(0.9 * time)),
    }
    down = [sum(a * f(k * time + c) * g for a, k, c in heave) for f, g in ((np.sin, 1.0),)]
    d_down = sum(a * k * np.cos(k * time + c) for a, k, c in heave)
    dd_down = sum(-a * k**2 * np.sin(k * time + c) for a, k, c in heave)
    angles = {"phi": (0.08, 1.7, 0.5), "theta": (0.12, w, 1.0), "psi": (0.10, 0.8, 0.2)}
    e = {
        name: (a * np.sin(k * time + c), a * k * np.cos(k * time + c))
        for name, (a, k, c) in angles.items()
    }
    (phi, phid), (theta, thetad), (psi, psid) = e["phi"], e["theta"], e["psi"]
    p = phid - psid * np.sin(theta)
    q = thetad * np.cos(phi) + psid * np.sin(phi) * np.cos(theta)
    r = -thetad * np.sin(phi) + psid * np.cos(phi) * np.cos(theta)
    to_ned = Rotation.from_euler("ZYX", np.stack([psi, theta, phi], axis=1))
    a = np.stack([np.zeros(len(time)) + place["north"][2], place["east"][2], dd_down], axis=1)
    force = to_ned.inv().apply(a - [0.0, 0.0, 9.80665])
    position = np.stack([place["north"][0], place["east"][0], down[0]], axis=1)
    return {
        "position": position, "turn": to_ned, "phi": phi, "theta": theta, "psi": psi, "p": p,
        "q": q, "r": r,
        "vn": np.full(len(time), 4.0), "ve": place["east"][1], "vd": d_down, "h": -position[:, 2],
        "ax": force[:, 0], "ay": force[:, 1], "az": force[:, 2],
    }  # fmt: skip


def record(
    seed: int, duration: float = 1.6, rate: float = 500.0, missing: float = 0.03
) -> pd.DataFrame:
    """Return what the cameras record, x north, y west, z up; a share of the markers is not seen."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration * rate)) / rate
    true = truth(time)
    columns = {"time": time}
    for name, place in MARKERS.items():
        seen = (
            true["position"]
            + true["turn"].apply(np.array(place))
            + NOISE * rng.standard_normal((len(time), 3))
        )
        seen[rng.random(len(time)) < missing] = np.nan
        columns |= dict(zip((f"{name}_x", f"{name}_y", f"{name}_z"), (seen * [1.0, -1.0, -1.0]).T))
    return pd.DataFrame(columns)


def main(folder: Path) -> None:
    """Write one recording and its setup."""
    folder.mkdir(parents=True, exist_ok=True)
    record(1).round(6).to_csv(folder / "cameras.csv", index=False)
    (folder / "markers.toml").write_text(SETUP, encoding="utf-8")
    print(f"written: a recording of {len(MARKERS)} markers and its setup in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "cameras"))
