"""Stall of JSBSim's T-37: a separation identified from its flights, against its own stall.

The aerodynamics of that aircraft hold the stall as a table of the lift over the angle of attack: it
rises to 14.9 deg and falls linearly from there on.  The table has no memory and both wing halves
are one, so that neither hysteresis, lag nor a roll-off can be shown with it.  The steady break,
the stall speed and the recovery can.

    python benchmarks/t37_stall.py [seed]

flies four stalls that train the model and two others, which it replays open loop from 12 s before
the break with the recorded elevator and thrust.  Coefficients are those of the generator with
coloured noise.  Needs the pip package ``jsbsim``; nothing of its files is copied.
"""

from __future__ import annotations

import os
import sys

import jsbsim
import numpy as np
import scipy
import xarray as xr

import flightmech
from flightmech import air
from flightmech.aircraft.engine import Engine
from flightmech.terms import make_term
from flightmech.units import KNOT
from flighttest.submodels.stall.identification import identify_stall

FT, LBF, SLUG = 0.3048, 4.4482216152605, 14.593902937206
RATE, FRAMES = 25, 8
STEP = 1.0 / RATE
NOISE = {"CL": 0.015, "CD": 0.003, "Cm": 0.004}  # rms, correlated over 0.15 s
BEFORE = 12.0  # [s] of the replay before the break
RECOVERED = np.deg2rad(10.0)  # angle of attack after the stall


class Generator:
    """JSBSim's T-37, trimmed for level flight."""

    def __init__(self, height: float, speed: float):
        self.model = model = jsbsim.FGFDMExec(os.path.dirname(jsbsim.__file__))
        model.set_debug_level(0)
        model.load_model("T37")
        model.set_dt(STEP / FRAMES)
        model["ic/h-sl-ft"], model["ic/vc-kts"], model["ic/gamma-deg"] = height / FT, speed, 0.0
        model["propulsion/set-running"] = -1
        model.run_ic()
        model.do_trim(1)
        self.trim = model["fcs/elevator-cmd-norm"], model["fcs/throttle-cmd-norm"]

    def read(self) -> dict[str, float]:
        """Return motion, controls and coefficients about the c.g. [SI]"""
        get = self.model.get_property_value
        row = {name: get(f"velocities/{name}-rad_sec") for name in "pqr"}
        row |= {name: get(f"attitude/{name}-rad") for name in ("phi", "theta")}
        row |= {"alpha": get("aero/alpha-rad"), "beta": get("aero/beta-rad")}
        row |= {"V": FT * get("velocities/vt-fps"), "h": FT * get("position/h-sl-ft")}
        row |= {"delta_e": get("fcs/elevator-pos-rad"), "V_cas": get("velocities/vc-kts")}
        S, cbar = self.geometry[:2]
        qS = get("aero/qbar-psf") * LBF / FT**2 * S
        fx, fz = (LBF * get(f"forces/fb{axis}-aero-lbs") for axis in "xz")
        sa, ca = np.sin(row["alpha"]), np.cos(row["alpha"])
        row |= {"CL": (fx * sa - fz * ca) / qS, "CD": -(fx * ca + fz * sa) / qS}
        row["Cm"] = LBF * FT * get("moments/m-aero-lbsft") / (qS * cbar)
        row["thrust"] = LBF * get("forces/fbx-prop-lbs")
        row["thrust_moment"] = LBF * FT * get("moments/m-prop-lbsft")
        row["mass"] = SLUG * get("inertia/mass-slugs")
        return row

    @property
    def geometry(self) -> tuple[float, float, float]:
        """Area, chord and span. [m2, m, m]"""
        get = self.model.get_property_value
        area, chord, span = (get(f"metrics/{name}") for name in ("Sw-sqft", "cbarw-ft", "bw-ft"))
        return area * FT * FT, chord * FT, span * FT

    def inertia(self) -> dict[str, float]:
        """Return the moments of inertia. [kg m2]"""
        get = self.model.get_property_value
        return {f"I{i}{i}": SLUG * FT**2 * get(f"inertia/i{i}{i}-slugs_ft2") for i in "xyz"}

    def fly(self, rng: np.random.Generator, up: float, top: float, hold: float) -> xr.Dataset:
        """Return a stall: to the angle of attack `top` in `up` seconds, held, and recovered."""
        model = self.model
        start = model["aero/alpha-rad"]
        times = np.cumsum([0.0, 3.0, up, hold, 2.0, 6.0])
        wanted_at = [start, start, top, top, start, start]
        phase = rng.uniform(0.0, 6.28, 3)
        rows = []
        for k in range(int(times[-1] * RATE)):
            t = k * STEP
            rows.append({"time": t, **self.read()})
            wanted = np.interp(t, times, wanted_at)
            # wobbles separate pitch rate, elevator and angle of attack
            wobble = 0.02 * np.sin(2.0 * np.pi * np.array([0.35, 0.6, 0.9]) * t + phase).sum()
            error = wanted - model["aero/alpha-rad"]
            elevator = self.trim[0] - 3.0 * error - 2.5 * (wanted - start) + wobble
            elevator += 1.0 * model["velocities/q-rad_sec"]
            bank, roll = model["attitude/phi-rad"], model["velocities/p-rad_sec"]
            model["fcs/elevator-cmd-norm"] = float(np.clip(elevator, -1.0, 1.0))
            model["fcs/aileron-cmd-norm"] = float(np.clip(-bank - 0.4 * roll, -0.5, 0.5))
            idle = self.trim[1] * np.interp(t, [1.0, 3.0], [1.0, 0.1])
            model["fcs/throttle-cmd-norm"] = model["fcs/throttle-cmd-norm[1]"] = idle
            for _ in range(FRAMES):
                model.run()
        columns = {name: ("time", np.array([row[name] for row in rows])) for name in rows[0]}
        return xr.Dataset(columns).set_coords("time")


def measured(rng: np.random.Generator, truth: xr.Dataset, cbar: float) -> xr.Dataset:
    """Return a flight with the noise of its coefficients and with the reduced pitch rate."""
    noisy = {"qhat": truth["q"] * cbar / (2.0 * truth["V"])}
    decay = np.exp(-STEP / 0.15)
    for name, rms in NOISE.items():
        white = rng.normal(size=truth.sizes["time"] + 200) * rms * np.sqrt(1.0 - decay**2)
        coloured = scipy.signal.lfilter([1.0], [1.0, -decay], white)[200:]
        noisy[name] = truth[name] + coloured
    return truth.assign(noisy)


def compiled(found, plane: Generator, flights: list[xr.Dataset]) -> flightmech.SimModel:
    """Return the identified model as a simulation of the generator's mass and thrust line."""
    leaves = dict(found.leaves())
    for model in found.fit.models:
        for term, shapes in model.shapes.items():
            if not shapes:
                names = {"1": [], "alpha^2": ["alpha", "alpha"]}.get(term, [term])
                value = found.term_value(model.target, term)[0]
                label = "_".join(names) or "basic"
                leaves[f"{model.target}/attached_{label}"] = make_term(value, regressors=names)
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    S, cbar, span = plane.geometry
    thrust = np.concatenate([flight["thrust"].values for flight in flights])
    moment = np.concatenate([flight["thrust_moment"].values for flight in flights])
    arm = float(thrust @ moment / (thrust @ thrust))
    mass = float(np.mean([flight["mass"].mean() for flight in flights]))
    craft = flightmech.Aircraft(
        "t37",
        S,
        cbar,
        span,
        mass,
        engines=(Engine((0.0, 0.0, arm)),),
        stall=found.separation(),
        **plane.inertia(),
    )
    return flightmech.compile(craft, tree)


def replay(model: flightmech.SimModel, flight: xr.Dataset) -> xr.Dataset:
    """Return the motion of the model from the start of a flight with its elevator and thrust."""
    first = flight.isel(time=0)
    names = ("V", "alpha", "q", "theta", "h")
    start = {f"init.{name}": float(first[name]) for name in names}
    start |= {"mode.earth": 0.0, "mode.engine": 2.0, "mode.trim": 0.0}
    inputs = flight[["delta_e"]].assign({"engine1.thrust_drive": flight["thrust"]})
    return flightmech.simulate(model, inputs.assign_coords(time=flight.time - first.time), start)


def figures(flight: xr.Dataset) -> dict[str, float]:
    """Return what a stall row compares. [kt, deg, m, s]"""
    alpha, CL = flight["alpha"].values, flight["CL"].values
    k = int(np.argmax(CL))
    time, h = flight["time"].values - float(flight["time"][0]), flight["h"].values
    low = np.flatnonzero((alpha < RECOVERED) & (np.arange(len(alpha)) > int(np.argmax(alpha))))
    back = int(low[0]) if len(low) else -1
    return {
        "largest CL": CL[k],
        "alpha at largest CL, deg": np.rad2deg(alpha[k]),
        "largest alpha, deg": np.rad2deg(alpha.max()),
        "airspeed at largest CL, kt": flight["V_cas"].values[k],
        "least airspeed, kt": float(flight["V_cas"].min()),
        "alpha below 10 deg after the stall, s": time[back] if len(low) else np.nan,
        "height lost from largest CL to there, m": h[k] - h[back] if len(low) else np.nan,
    }


def with_airspeed(own: xr.Dataset) -> xr.Dataset:
    """Return a replay with its calibrated airspeed; compressibility is left out below 120 kt."""
    air_there = air.atmosphere(own["h"].values)
    equivalent = own["V"] * np.sqrt(air_there.rho / air.atmosphere(0.0).rho)
    return own.assign(V_cas=equivalent / KNOT)


def main(seed: int = 1) -> None:
    """Identify, replay and print."""
    rng = np.random.default_rng(seed)
    plans = [(14.0, 19.0, 2.0), (11.0, 22.0, 1.5), (4.0, 21.0, 1.0), (3.0, 24.0, 1.0)]
    plans += [(12.0, 20.5, 2.0), (5.0, 22.5, 1.0)]
    flights = []
    for up, top, hold in plans:
        plane = Generator(3000.0, 110.0)
        flights.append(plane.fly(rng, up, np.deg2rad(top), hold))
    _, cbar, span = plane.geometry
    training = [measured(rng, flight, cbar) for flight in flights[:4]]
    found = identify_stall(training, 0.25 * span, cbar, coefficients=("CL", "CD", "Cm"))
    print(found.report())
    model = compiled(found, plane, flights)
    for number, flight in enumerate(flights[4:], 1):
        k = int(np.argmax(flight["CL"].values))
        part = flight.isel(time=slice(max(0, k - int(BEFORE * RATE)), None))
        pairs = figures(part), figures(with_airspeed(replay(model, part)))
        print(f"unseen stall {number}:  generator  model")
        for name, value in pairs[0].items():
            print(f"  {name:42s}{value:10.3f}{pairs[1][name]:10.3f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
