"""Print the charts of engine and propeller of ``aircraft.toml``.

    pip install jsbsim==1.3.3 numpy
    python make_charts.py

They stand for the charts of the makers: test-stand runs of the engine and the propeller of the
aircraft ``c182`` of the pip package ``jsbsim``, with the errors that such charts have.
"""

from __future__ import annotations

import os

import jsbsim
import numpy as np

FT, INCH, LBF = 0.3048, 0.0254, 4.4482216152605
HORSEPOWER, INHG = 745.69987, 3386.389
DIAMETER = 81.0 * INCH
# errors of the charts: thrust and power of the propeller, power of the engine
THRUST_ERROR, TORQUE_ERROR, POWER_ERROR = 1.015, 0.99, 1.01
ADVANCE = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4]
ANGLES = [17.0, 20.0, 24.0, 28.0, 31.8]  # between the stops [deg]
PRESSURES = [6.0, 12.0, 18.0, 24.0, 30.0]  # [inHg]
SPEEDS = [1000.0, 1500.0, 2000.0, 2500.0]  # [rpm]
# pressure heights of the chart of the engine [ft]: its mixture stays full rich, so its power falls
# faster with height than the air that it breathes
HEIGHTS = [3000.0, 4000.0, 5000.0, 6000.0, 7000.0]


def run(
    kcas: float,
    throttle: float,
    lever: float = 1.0,
    *,
    angle: float | None = None,
    height: float = HEIGHTS[0],
) -> list[dict[str, float]]:
    """Return what the stand reads every half second of five, at first at a speed of the air, by the
    governor or at a blade angle [deg]."""
    f = jsbsim.FGFDMExec(os.path.dirname(jsbsim.__file__))
    f.set_debug_level(0)
    f.load_model("c182")
    f.set_dt(1.0 / 200.0)
    start = {
        "lat-geod-deg": 45.0,
        "terrain-elevation-ft": 0.0,
        "h-sl-ft": height,
        "vc-kts": kcas,
        "gamma-deg": 0.0,
    }
    for name, value in start.items():
        f["ic/" + name] = value
    f["fcs/throttle-cmd-norm"], f["fcs/advance-cmd-norm"] = 1.0, lever
    f.run_ic()
    f["propulsion/set-running"] = -1
    f["propulsion/engine/constant-speed-mode"] = float(angle is None)
    readings = []
    for k in range(1, 1001):
        if angle is not None:
            f["propulsion/engine/blade-angle"] = angle
        f["fcs/throttle-cmd-norm"], f["fcs/advance-cmd-norm"] = throttle, lever
        f.run()
        if k % 100 == 0 and f["propulsion/engine/propeller-rpm"] > 300.0:
            readings.append(read(f))
    return readings


def read(f: jsbsim.FGFDMExec) -> dict[str, float]:
    """Return coefficients of the propeller, and power of the engine at standard temperature."""
    engine = {
        name: f["propulsion/engine/" + name]
        for name in ("propeller-rpm", "thrust-lbs", "propeller-power-ftlbps", "power-hp", "map-pa")
    }
    n, rho = engine["propeller-rpm"] / 60.0, f["atmosphere/rho-slugs_ft3"] * LBF / FT**4
    pressure = f["atmosphere/P-psf"] * LBF / FT**2
    warm = np.sqrt(f["atmosphere/T-R"] / 1.8 / (288.15 * (pressure / 101325.0) ** 0.190263))
    return {
        "J": f["velocities/u-aero-fps"] * FT / (n * DIAMETER),
        "CT": engine["thrust-lbs"] * LBF / (rho * n**2 * DIAMETER**4),
        "CP": engine["propeller-power-ftlbps"] * LBF * FT / (rho * n**3 * DIAMETER**5),
        "rpm": 60.0 * n,
        "map": engine["map-pa"] / INHG,
        "air": pressure / INHG,
        "power": engine["power-hp"] * HORSEPOWER * warm,
    }


def propeller_chart() -> dict[str, np.ndarray]:
    """Return CT and CP over advance ratio and blade angle."""
    chart = {
        "CT": np.empty((len(ADVANCE), len(ANGLES))),
        "CP": np.empty((len(ADVANCE), len(ANGLES))),
    }
    for k, angle in enumerate(ANGLES):
        runs = []
        for kcas in (10.0, 30.0, 60.0, 90.0, 120.0, 145.0):
            for throttle in (1.0, 0.4, 0.0):
                runs += run(kcas, throttle, angle=angle)
        runs.sort(key=lambda item: item["J"])
        for name, error in (("CT", THRUST_ERROR), ("CP", TORQUE_ERROR)):
            chart[name][:, k] = error * continued(
                np.array([r["J"] for r in runs]), np.array([r[name] for r in runs])
            )
    return chart


def continued(J: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the readings at `ADVANCE`; beyond the last one their line goes on to zero thrust."""
    slope = np.polyfit(J[-6:], values[-6:], 1)[0]
    beyond = np.maximum(
        values[-1] + min(slope, 0.0) * (np.array(ADVANCE) - J[-1]), min(0.0, values.min())
    )
    return np.where(np.array(ADVANCE) > J[-1], beyond, np.interp(ADVANCE, J, values))


def engine_chart(height: float) -> np.ndarray:
    """Return the brake power at a height [ft] over manifold pressure and engine speed [W]."""
    runs = []
    for lever in (0.0, 0.3, 0.6, 1.0):
        for kcas in (40.0, 80.0, 120.0):
            for throttle in (0.1, 0.3, 0.5, 0.65, 0.8, 1.0):
                runs += run(kcas, throttle, lever, height=height)[4:]
    runs = [item for item in runs if item["rpm"] > 900.0]
    pressure, speed, power = (np.array([r[name] for r in runs]) for name in ("map", "rpm", "power"))
    speed = speed / 1000.0

    def columns(pressure: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return np.stack([speed, speed**2, pressure * speed, pressure * speed**2], axis=1)

    fit, *_ = np.linalg.lstsq(columns(pressure, speed), power, rcond=None)
    print(
        f"# {height:g} ft: rms of the fit [W]:",
        round(np.std(power - columns(pressure, speed) @ fit)),
    )
    grid = np.array([(p, n / 1000.0) for p in PRESSURES for n in SPEEDS])
    return POWER_ERROR * (columns(*grid.T) @ fit).reshape(len(PRESSURES), len(SPEEDS))


def pressure_ratio(height: float) -> float:
    """Return the pressure of the standard atmosphere at a height [ft] over that at sea level."""
    return (1.0 - 0.0065 * height * FT / 288.15) ** 5.25588


def manifold() -> np.ndarray:
    """Return the impedances of MAP = p / (1 + w (z_i + z_t (1 - throttle)^2)) [s]."""
    rows, losses = [], []
    for throttle in (0.2, 0.4, 0.6, 0.8, 1.0):
        last = run(80.0, throttle, 0.6)[-1]
        w = last["rpm"] * np.pi / 30.0
        rows.append([w, w * (1.0 - throttle) ** 2])
        losses.append(last["air"] / last["map"] - 1.0)
    return np.linalg.lstsq(np.array(rows), np.array(losses), rcond=None)[0]


def rows(table: np.ndarray, form: str, margin: int = 4) -> str:
    """Return the rows of a table as lines of TOML."""
    lines = [" " * margin + "[" + ", ".join(form.format(x) for x in row) + "]," for row in table]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for name, table in propeller_chart().items():
        print(f"\n[engine.propeller.tables.{name}_prop]")
        print("J =", ADVANCE)
        print("blade_angle = [" + ", ".join(f'"{angle:g} deg"' for angle in ANGLES) + "]")
        print("value = [\n" + rows(table, "{:.4f}") + "]\n")
    charts = [engine_chart(height) / 1000.0 for height in HEIGHTS]
    # the axes of a table rise: the greatest height has the least pressure
    charts.reverse()
    print("\n[engine.piston.tables.corrected_power]")
    print("pressure_ratio = [" + ", ".join(f"{pressure_ratio(h):.4f}" for h in HEIGHTS[::-1]) + "]")
    print(
        "manifold_pressure = [" + ", ".join(f'"{pressure:g} inHg"' for pressure in PRESSURES) + "]"
    )
    print("engine_rpm = [" + ", ".join(f'"{speed:g} rpm"' for speed in SPEEDS) + "]")
    print("value = [")
    for height, power in zip(HEIGHTS[::-1], charts):
        print(f"    [    # {height:g} ft")
        print(rows(power, '"{:.1f} kW"', margin=8), end="")
        print("    ],")
    print("]")
    print("# impedances [s]:", manifold())
