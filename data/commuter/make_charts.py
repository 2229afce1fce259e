"""Make the a-priori charts of propeller and engine, ``propeller.nc`` and ``engine.nc``.

    python make_charts.py [FOLDER]

Test-stand runs of the aeroplane of `aeroplane.py` at nodes of our own, with errors of 2 % in the
level, 1 % in the slope over the advance ratio, and 1 % of the largest value per node: what a
maker's chart has.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import aeroplane
import numpy as np

from flightmech.aircraft.propulsion.engine_deck import write_tables
from flightmech.terms import make_term

J = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3, 2.6, 3.0, 3.4])
ANGLES = np.radians([14.0, 18.0, 22.0, 26.0, 30.0, 34.0, 38.0, 42.0, 47.0, 52.0])


def propeller_tables(rng: np.random.Generator) -> dict:
    """Return CT, CP, force in the disk and P-factor."""
    pairs = [[aeroplane.coefficients(x, y) for y in ANGLES] for x in J]
    tables = {}
    for name, values, level in zip(
        ("CT_prop", "CP_prop"), np.moveaxis(np.array(pairs), 2, 0), (1.02, 0.98)
    ):
        size = 0.3
        noise = 0.01 * size * rng.standard_normal(values.shape) * (values > 0.02)
        slope = 1.0 + 0.01 * (J[:, None] - 1.2)
        tables[name] = make_term(
            np.round(level * slope * values + 0.3 * noise, 4), {"J": J, "blade_angle": ANGLES}
        )
    ends = {"J": [0.0, 3.4]}
    tables["CN_prop"] = make_term([0.10, 0.20], ends)
    tables["CM_prop"] = make_term([0.013, 0.050], ends)
    tables["shaft_power"] = make_term(*power_chart())
    return tables


def power_chart() -> tuple[np.ndarray, dict]:
    """Return the power over gas generator speed, ambient pressure and Mach number. [W]"""
    heights, numbers = (6000.0, 4000.0, 2000.0, 0.0), [0.0, 0.3]
    speeds = [0.0, 0.12, 0.55, 0.65, 0.75, 0.85, 0.95, 1.0]
    power = np.zeros((len(speeds), len(heights), len(numbers)))
    ratios = []
    for k, h in enumerate(heights):
        pressure, _, density, _ = aeroplane.air(h)
        ratios.append(round(pressure / aeroplane.P0, 4))
        for i, n1 in enumerate(speeds[2:], 2):
            power[i, k] = [aeroplane.engine_power(n1, mach, density) for mach in numbers]
    axes = {"n1": speeds, "pressure_ratio": ratios, "mach": numbers}
    return np.round(1.02 * power, -1), axes


def engine_tables() -> dict:
    """Return the gas generator: speed over the lever, its lags."""
    lever = np.array([0.0, 0.1, 0.25, 0.5, 0.75, 1.0])
    speed = aeroplane.IDLE + (1.0 - aeroplane.IDLE) * lever**0.85
    return {
        "n1_command": make_term(np.round(speed, 4), {"throttle": lever}),
        "n1_up_time": make_term(0.95),
        "n1_down_time": make_term(0.75),
        "corrected_n1_windmill": make_term(0.12),
        "thrust": make_term(0.0),
    }


def main(folder: Path) -> None:
    """Write both files."""
    rng = np.random.default_rng(743)
    write_tables(propeller_tables(rng), folder / "propeller.nc")
    write_tables(engine_tables(), folder / "engine.nc")
    print(
        f"written: propeller.nc engine.nc; stops {math.degrees(aeroplane.LOW):g} and "
        f"{math.degrees(aeroplane.HIGH):g} deg"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
