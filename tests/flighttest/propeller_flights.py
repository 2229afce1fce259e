"""Flights of propeller aircraft with a known truth, with physics other than that of the product.

The propeller is a blade-element calculation with the closed induced angle of McCormick
(*Aerodynamics, Aeronautics and Flight Mechanics*, section 6.4), the engines are charts of their
own, the aircraft is a point mass.  The instruments have noise and constant errors, the air has
slow vertical motion.  What the estimator gets is a record, and tables that differ from the truth.

    python tests/flighttest/propeller_flights.py FOLDER

writes nine records and the a-priori aircraft of a light aircraft.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.air import atmosphere
from flightmech.aircraft import Aircraft, Engine, PistonEngine, Propeller
from flightmech.aircraft.writing import write_aircraft
from flightmech.terms import make_term

G = 9.80665
STATIONS = np.linspace(0.2, 0.98, 27)
# Standard deviations: common errors of the instruments, and noise of one sample.
COMMON = {
    "V": 0.005,
    "mass": 0.005,
    "rpm": 0.002,
    "torque": 0.01,
    "manifold_pressure": 0.01,
    "fuel_flow": 0.01,
    "temperature": 1.0,
    "alpha": 0.002,
    "climb": 0.0,
    "theta": 0.004,
}
NOISE = {
    "V": 0.3,
    "h": 0.5,
    "temperature": 0.3,
    "rpm": 0.4,
    "torque": 0.01,  # of the value
    "manifold_pressure": 300.0,
    "fuel_flow": 0.01,  # of the value
    "alpha": 0.002,
    "theta": 0.002,
    "specific force": 0.03,
}
GUST, GUST_TIME = 0.12, 20.0  # m/s, s
RATE = 1.0


@dataclass(frozen=True)
class Blades:
    """A propeller: solidity, twist about the angle at three quarters of the radius, airfoil."""

    diameter: float
    solidity: float
    pitch: float  # geometric pitch over diameter of the design twist
    lift_slope: float = 5.9
    drag: float = 0.011
    offset: float = 0.0  # of the blade angle [rad]
    design: float = 0.0  # blade angle at 3/4 radius of the design twist [rad]

    def coefficients(self, J, angle) -> tuple[np.ndarray, np.ndarray]:
        """Return CT and CP at advance ratios and blade angles at three quarters of the radius."""
        J, angle = np.broadcast_arrays(np.asarray(J, float), np.asarray(angle, float))
        x = STATIONS
        twist = np.arctan(self.pitch / (np.pi * x)) - np.arctan(self.pitch / (np.pi * 0.75))
        beta = angle[..., None] + self.offset + twist
        lam = J[..., None] / np.pi
        phi = np.arctan2(lam, x)
        chord = self.solidity * np.sqrt(np.clip(1.0 - ((x - 0.45) / 0.62) ** 2, 0.05, None))
        a = self.lift_slope
        V_R = np.sqrt(lam**2 + x**2)
        incidence = beta - phi
        A = lam / x + chord * a * V_R / (8.0 * x**2)
        root = np.sqrt(A**2 + chord * a * V_R / (2.0 * x**2) * np.abs(incidence))
        induced = 0.5 * np.sign(incidence) * (root - A)
        alpha = incidence - induced
        lift = 1.3 * np.tanh(a * alpha / 1.3)
        drag = self.drag + 0.012 * lift**2 + 1.1 * np.clip(np.abs(alpha) - 0.25, 0.0, None) ** 2
        flow = (J[..., None] ** 2 + (np.pi * x) ** 2) * chord
        s, c = np.sin(phi + induced), np.cos(phi + induced)
        CT = np.pi / 8.0 * np.trapezoid(flow * (lift * c - drag * s), x)
        CP = np.pi / 8.0 * np.trapezoid(flow * np.pi * x * (lift * s + drag * c), x)
        return CT, CP


@dataclass(frozen=True)
class Craft:
    """Truth of one aircraft and its programme."""

    mass: float
    S: float
    CD0: float
    K: float
    lift_slope: float
    CL0: float
    blades: Blades
    engines: int
    governed: bool
    power_rated: float
    rpm_rated: float  # rad/s
    chart: tuple[float, ...] = ()
    common: dict[str, float] = field(default_factory=dict)

    def piston_power(self, pressure, rpm, temperature, ambient):
        """Return the brake power: mean effective pressure linear in the manifold pressure. [W]"""
        n = rpm / self.rpm_rated
        torque = 1.13 * pressure / 98e3 - 0.13 - 0.05 * (n - 1.0) ** 2 + self.chart[0] * (n - 1.0)
        standard = 288.15 * (ambient / 101325.0) ** 0.190263
        # brake power less the drag of the engine, which the temperature does not change
        return self.power_rated * n * torque * np.sqrt(standard / temperature)

    def turbine_power(self, throttle, mach, density):
        """Return the flat-rated power over the lever. [W]"""
        most = np.minimum(1.0, 1.25 * (density / 1.225) ** 0.7 * (1.0 + 0.3 * mach**2))
        return self.power_rated * np.clip(throttle, 0.0, 1.0) ** 1.15 * most


LOW, HIGH = np.radians(18.0), np.radians(42.0)
ANGLES = np.radians(np.arange(10.0, 43.0, 2.0))
RATIOS = {False: np.linspace(0.0, 1.6, 17), True: np.linspace(0.0, 3.6, 49)}


def make_craft(seed: int, governed: bool) -> Craft:
    """Return an aircraft with constants about those of its class."""
    rng = np.random.default_rng(seed)

    def about(x: float, share: float = 0.05) -> float:
        return float(x * (1.0 + share * rng.standard_normal()))

    common = {name: float(s * rng.standard_normal()) for name, s in COMMON.items()}
    if governed:
        blades = Blades(about(2.6, 0.01), about(0.19), 1.2, about(5.8, 0.03), about(0.012, 0.1))
        return Craft(
            4600.0, about(28.0, 0.01), about(0.030), about(0.045), 5.2, 0.25, blades, 2, True,
            about(450e3, 0.03), 178.0, (0.0,), common,
        )  # fmt: skip
    blades = Blades(
        about(1.90, 0.01), about(0.12), 0.9, about(5.9, 0.03), about(0.011, 0.1), design=0.3648
    )
    return Craft(
        1050.0, about(16.2, 0.01), about(0.031), about(0.058), 4.8, 0.28, blades, 1, False,
        about(120e3, 0.03), 283.0, (0.1 * float(rng.standard_normal()),), common,
    )  # fmt: skip


def truth_tables(craft: Craft) -> dict[str, xr.Dataset]:
    """Return the coefficients of the true propeller as tables of the product."""
    return _coefficient_tables(craft, craft.blades)


def _coefficient_tables(craft: Craft, blades: Blades) -> dict[str, xr.Dataset]:
    J = RATIOS[craft.governed]
    if craft.governed:
        grid = {"J": J, "blade_angle": ANGLES}
        CT, CP = blades.coefficients(J[:, None], ANGLES[None, :])
    else:
        grid = {"J": J}
        CT, CP = blades.coefficients(J, blades.design)
    return {"CT_prop": make_term(CT, grid), "CP_prop": make_term(CP, grid)}


def prior_aircraft(craft: Craft, seed: int) -> Aircraft:
    """Return the a-priori aircraft: other blades, another chart."""
    rng = np.random.default_rng(1000 + seed)
    b = craft.blades
    # The profile drag of governed blades is a thrust that counts as drag; the identification takes
    # 30 % as its a-priori error, which is that of both draws of blades together.
    drag = 0.28 if craft.governed else 0.15
    other = Blades(
        b.diameter,
        b.solidity * (1.0 + 0.06 * rng.standard_normal()),
        b.pitch * (1.0 + 0.03 * rng.standard_normal()),
        b.lift_slope * (1.0 + 0.04 * rng.standard_normal()),
        b.drag * (1.0 + drag * rng.standard_normal()),
        offset=np.radians(0.35) * rng.standard_normal(),
        design=b.design,
    )
    tables = _coefficient_tables(craft, other)
    factor, slope = 1.0 + 0.05 * rng.standard_normal(), 0.03 * rng.standard_normal()
    piston = None
    constants = {"diameter": b.diameter, "inertia": 1.9, "rpm_high": craft.rpm_rated}
    if craft.governed:
        lever, mach = np.linspace(0.0, 1.0, 11), np.array([0.0, 0.2, 0.4])
        power = factor * craft.turbine_power(lever[:, None], mach[None, :], 1.1)
        tables["shaft_power"] = make_term(power, {"throttle": lever, "mach": mach})
        constants |= {"inertia": 12.0, "rpm_low": 140.0, "low_pitch": LOW, "high_pitch": HIGH}
    else:
        pressure, rpm = np.linspace(15e3, 105e3, 5), np.linspace(100.0, 330.0, 12)
        ambient = 101325.0
        chart = craft.piston_power(pressure[:, None], rpm[None, :], 288.15, ambient)
        place = (pressure - 65e3) / 40e3
        chart = chart * (factor + slope * place)[:, None]
        grid = {"manifold_pressure": pressure, "engine_rpm": rpm}
        piston = PistonEngine(
            {"corrected_power": make_term(chart, grid), "bsfc": make_term(8.3e-8)},
            intake_impedance=2e-4,
            throttle_impedance=0.02,
        )
    places = [(0.5, y, 0.0) for y in ((-2.4, 2.4) if craft.engines == 2 else (0.0,))]
    engines = tuple(
        Engine(place, propeller=Propeller(tables, **constants), piston=piston) for place in places
    )
    return Aircraft("test", craft.S, 1.5, 11.0, craft.mass, 1e3, 1e3, 1e3, engines=engines)


def prior_polar(craft: Craft, seed: int) -> tuple[float, float, float, float]:
    """Return CD0, K and their standard errors, 10 % each."""
    rng = np.random.default_rng(2000 + seed)
    CD0, K = (x * (1.0 + 0.1 * rng.standard_normal()) for x in (craft.CD0, craft.K))
    return CD0, K, 0.1 * craft.CD0, 0.1 * craft.K


@dataclass(frozen=True)
class Leg:
    """One manoeuvre: lever, speed, and what the pilot holds: the speed or the height."""

    lever: float
    V: float
    h: float
    held: str = "V"
    seconds: float = 60.0


def programme(craft: Craft) -> list[Leg]:
    """Return climbs, glides, level accelerations and decelerations."""
    if craft.governed:
        slow, mid, fast, h = 62.0, 80.0, 105.0, 2000.0
        full, part, idle = 1.0, 0.55, 0.02
    else:
        slow, mid, fast, h = 36.0, 45.0, 55.0, 1200.0
        full, part, idle = 1.0, 0.6, 0.02
    legs = [Leg(full, V, h) for V in (slow, mid, fast)]
    legs += [Leg(part, V, h) for V in (slow, mid, fast)]
    legs += [Leg(idle, V, h) for V in (slow, mid, fast)]
    legs += [Leg(full, slow, h, "h", 40.0), Leg(idle, fast, h, "h", 24.0)]
    return [*legs, Leg(full, mid, 2.0 * h)]


def fly(craft: Craft, leg: Leg, rng: np.random.Generator) -> xr.Dataset:
    """Return the record of a manoeuvre at `RATE` samples per second."""
    steps = round(leg.seconds * RATE)
    dt = 1.0 / RATE
    V, h, gust, rpm = leg.V, leg.h, 0.0, 0.8 * craft.rpm_rated
    rows = []
    for _ in range(steps):
        air = atmosphere(h)
        T_air, p, rho, sound = (float(x) for x in air)
        now = _propulsion(craft, leg.lever, V, (T_air, p, rho, sound), rpm)
        rpm = now["rpm"]
        q_S = 0.5 * rho * V**2 * craft.S
        gamma = 0.0
        alpha = 0.05
        for _ in range(4):  # lift carries the weight less the lift of the thrust
            CL = (craft.mass * G * np.cos(gamma) - now["T"] * np.sin(alpha)) / q_S
            alpha = (CL - craft.CL0) / craft.lift_slope
            drag = q_S * (craft.CD0 + craft.K * CL**2)
            f = (now["T"] * np.cos(alpha) - drag) / craft.mass
            gamma = np.arcsin(np.clip(f / G, -0.5, 0.5)) if leg.held == "V" else 0.0
        gust += (
            dt / GUST_TIME * -gust + GUST * np.sqrt(2.0 * dt / GUST_TIME) * rng.standard_normal()
        )
        across = G * np.cos(gamma)
        rows.append(
            {
                **now,
                "V": V,
                "h": h,
                "alpha": alpha,
                "f": f,
                "across": across,
                "gamma": gamma,
                "temperature": T_air,
            }
        )
        if leg.held == "h":
            V += f * dt
            h += gust * dt
        else:
            h += (V * np.sin(gamma) + gust) * dt
    return _record(craft, rows, rng)


def _propulsion(craft: Craft, lever: float, V: float, air, rpm: float) -> dict[str, float]:
    """Return thrust of all engines, speed, power, manifold pressure at the balance of the shaft."""
    T_air, p, rho, sound = air
    D = craft.blades.diameter
    if craft.governed:
        power = float(craft.turbine_power(lever, V / sound, rho))
        n = craft.rpm_rated / (2.0 * np.pi)
        J = V / (n * D)
        angle = _governed_angle(craft, J, power / (rho * n**3 * D**5))
        CT, CP = (float(x) for x in craft.blades.coefficients(J, angle))
        if angle <= LOW:  # below the stop the speed falls to where the blades take the power
            n = _balance(lambda m: power - _taken(craft, V, m, rho, LOW), 0.3 * n, n)
            J = V / (n * D)
            CT, CP = _at_angle(craft, J, LOW)
        pressure = 0.0
    else:

        def excess(m: float) -> float:
            w = 2.0 * np.pi * m
            return float(
                craft.piston_power(_manifold(craft, lever, w, p), w, T_air, p)
                - _taken(craft, V, m, rho, craft.blades.design)
            )

        rated = craft.rpm_rated / (2.0 * np.pi)
        n = _balance(excess, 0.25 * rated, 1.5 * rated)
        J = V / (n * D)
        CT, CP = _at_angle(craft, J, craft.blades.design)
        pressure = _manifold(craft, lever, 2.0 * np.pi * n, p)
        power = CP * rho * n**3 * D**5
    thrust = craft.engines * CT * rho * n**2 * D**4
    return {"T": thrust, "rpm": 2.0 * np.pi * n, "P": power, "map": pressure, "lever": lever}


def _manifold(craft: Craft, lever: float, rpm: float, p: float) -> float:
    """Return the pressure behind a butterfly valve. [Pa]"""
    shut = (1.0 - lever) ** 1.5
    return p * (0.98 - 0.76 * shut * (rpm / craft.rpm_rated) ** 0.35)


FINE = np.linspace(0.0, 4.0, 1601)


@lru_cache
def _curves(blades: Blades, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return CT and CP over the advance ratios `FINE` at one blade angle."""
    return blades.coefficients(FINE, angle)


def _at_angle(craft: Craft, J: float, angle: float) -> tuple[float, float]:
    CT, CP = _curves(craft.blades, angle)
    return float(np.interp(J, FINE, CT)), float(np.interp(J, FINE, CP))


def _taken(craft: Craft, V: float, n: float, rho: float, angle: float) -> float:
    _, CP = _at_angle(craft, V / (n * craft.blades.diameter), angle)
    return CP * rho * n**3 * craft.blades.diameter**5


def _balance(excess, low: float, high: float) -> float:
    """Return the root of a falling function by bisection."""
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


def _governed_angle(craft: Craft, J: float, CP: float) -> float:
    """Return the blade angle between the stops at which the propeller takes CP."""
    grid = np.linspace(LOW, HIGH, 57)
    taken = craft.blades.coefficients(J, grid)[1]
    above = np.flatnonzero(taken >= CP)
    if not above.size:
        return HIGH
    k = int(above[0])
    if k == 0:
        return LOW
    share = (CP - taken[k - 1]) / (taken[k] - taken[k - 1])
    return float(grid[k - 1] + share * (grid[k] - grid[k - 1]))


def governed_thrust(craft: Craft, J: float, CP: float) -> float:
    """Return the true CT at an advance ratio and a power coefficient."""
    return float(craft.blades.coefficients(J, _governed_angle(craft, J, CP))[0])


def _record(craft: Craft, rows: list[dict[str, float]], rng: np.random.Generator) -> xr.Dataset:
    """Return what the instruments show."""
    truth = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    count, error = len(rows), craft.common

    def shown(x: np.ndarray, name: str, relative: bool = False) -> np.ndarray:
        noise = NOISE[name] * rng.standard_normal(count) * (np.abs(x) if relative else 1.0)
        return x / (1.0 + error.get(name, 0.0)) + noise

    columns = {
        "V": shown(truth["V"], "V"),
        "h": truth["h"] + NOISE["h"] * rng.standard_normal(count),
        "temperature": truth["temperature"]
        - error["temperature"]
        + 0.3 * rng.standard_normal(count),
        "p_static": np.asarray(atmosphere(truth["h"]).p_static),
        "mass": np.full(count, craft.mass / (1.0 + error["mass"])),
    }
    for number in range(1, craft.engines + 1):
        columns[f"engine{number}.rpm"] = shown(truth["rpm"], "rpm")
        columns[f"engine{number}.throttle"] = truth["lever"]
        torque = truth["P"] / truth["rpm"]
        if craft.governed:
            columns[f"engine{number}.torque"] = shown(torque, "torque", True)
        else:
            columns[f"engine{number}.manifold_pressure"] = shown(truth["map"], "manifold_pressure")
            flow = 8.6e-8 * np.maximum(truth["P"], 0.0)
            columns[f"engine{number}.fuel_flow"] = shown(flow, "fuel_flow", True)
    if craft.governed:
        # Accelerometers at the c.g.: specific force along body x and z, and the vane.
        al, f, n = truth["alpha"], truth["f"], truth["across"]
        noise = NOISE["specific force"] * rng.standard_normal((2, count))
        columns["ax"] = f * np.cos(al) + n * np.sin(al) + noise[0]
        columns["az"] = f * np.sin(al) - n * np.cos(al) + noise[1]
        columns["alpha"] = al - error["alpha"] + NOISE["alpha"] * rng.standard_normal(count)
    else:
        theta = truth["alpha"] + truth["gamma"] - error["theta"]
        columns["theta"] = theta + NOISE["theta"] * rng.standard_normal(count)
    time = np.arange(count) / RATE
    return xr.Dataset({k: ("time", x) for k, x in columns.items()}, {"time": time})


def make_flights(seed: int, governed: bool) -> tuple[Craft, list[xr.Dataset]]:
    """Return the truth and the records of a programme."""
    craft = make_craft(seed, governed)
    rng = np.random.default_rng(5000 + seed)
    records = []
    for number, leg in enumerate(programme(craft)):
        records.append(fly(craft, leg, rng).assign_attrs(record=f"leg {number + 1}"))
    return craft, records


def fly_power_change(
    craft: Craft, truth: dict[str, float], rng: np.random.Generator, rate: float = 10.0
) -> xr.Dataset:
    """Return a slam and a chop at constant airspeed and height, by Euler steps of its own.

    Manifold and shaft: m' = (p / (1 + w z) - m) / tau, I w' = P / w - Q.
    """
    V, h, dt = 45.0, 1200.0, 0.01
    T_air, p, rho, sound = (float(x) for x in atmosphere(h))
    D = craft.blades.diameter
    moves = np.array([(0.0, 0.3), (2.0, 0.3), (2.4, 1.0), (9.0, 1.0), (9.4, 0.3), (16.0, 0.3)]).T
    w, m, rows = 200.0, 0.6 * p, []
    for k in range(round(-15.0 / dt), round(16.0 / dt)):
        t = k * dt
        lever = float(np.interp(t, *moves))
        if k >= 0 and k % round(1.0 / (rate * dt)) == 0:
            rows.append((lever, w, m))
        _, CP = _at_angle(craft, V * 2.0 * np.pi / (w * D), craft.blades.design)
        taken = CP * rho * (w / (2.0 * np.pi)) ** 2 * D**5 / (2.0 * np.pi)
        made = float(craft.piston_power(m, w, T_air, p)) / w
        impedance = 2e-4 + truth["throttle_impedance"] * (1.0 - lever) ** 2
        w, m = (
            w + dt * (made - taken) / truth["inertia"],
            m + dt * (p / (1.0 + w * impedance) - m) / truth["map_time"],
        )
    lever, w, m = np.array(rows).T
    count = len(lever)
    columns = {
        "throttle": lever,
        "rpm": w + 0.4 * rng.standard_normal(count),
        "manifold_pressure": m + 200.0 * rng.standard_normal(count),
        "mach": np.full(count, V / sound),
        "h": np.full(count, h),
    }
    return xr.Dataset(
        {k: ("time", x) for k, x in columns.items()}, {"time": np.arange(count) / rate}
    )


def write_flights(folder: Path, seed: int = 2) -> None:
    """Write records and a-priori aircraft of one programme of three powers and three speeds."""
    folder.mkdir(parents=True, exist_ok=True)
    craft, rng = make_craft(seed, False), np.random.default_rng(seed)
    for lever, power in ((1.0, "full"), (0.6, "part"), (0.02, "idle")):
        for V in (36.0, 45.0, 55.0):
            record = fly(craft, Leg(lever, V, 1200.0, seconds=36.0), rng)
            record.to_netcdf(folder / f"{power}_{V:.0f}.nc", engine="h5netcdf")
    write_aircraft(prior_aircraft(craft, seed), folder / "prior.toml")
    print(f"written: 9 records and prior.toml in {folder}")


if __name__ == "__main__":
    write_flights(Path(sys.argv[1]))
