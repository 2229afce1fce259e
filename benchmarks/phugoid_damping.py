"""What the damping of the phugoid depends on: Citation II flights of 2018 and 2020, and models
fitted to them.

    python benchmarks/phugoid_damping.py    # docs/evidence/real-flights.md, "Phugoid damping"

Along and normal to the flight path, with X the specific force along it and N the one normal to it,
x = X/V and n = N/V as complex ratios in the mode, V' = X - g gamma and V0 gamma' = N - g give  s^2
- x s + g n / V0 = 0, and so

    zeta = -Re(x) / (2 w)  +  g Im(n) / (2 w^2 V0),      w = |s|:

what drag and thrust take out, and what lift gives back when it lags behind the speed.  The flights
are recordings in ``../shared``.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

import aerodb
import datcom_io
import flightmech
import flighttest
import pom
from flightmech.air import atmosphere
from flightmech.errors import AeromatchWarning
from flightmech.units import DEGREE, G0
from flighttest.maximum_likelihood.fit_job import perform_fit_job
from flighttest.maximum_likelihood.specification import read_specification
from pom.judging.measures.damped_sine import fit_mode
from pom.tolerances.bands import Invalid

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "real"))
import citation  # noqa: E402  (the stations' own records, windows and prior)

FREE = {2018: (20.0, 148.0), 2020: (20.0, 136.0)}  # controls at rest, seconds from the noted start
CASES = {2018: (-4.0, 148.0), 2020: (-4.0, 138.0)}
HELD = ["CL/altitude", "CD/altitude", "Cm/altitude"]
STATES, INPUTS = (
    ("V", "alpha", "q", "theta", "h"),
    ("delta_e", "engine1.thrust_drive", "engine2.thrust_drive"),
)
RESOLUTION = 0.0172 * DEGREE  # smallest step of the recorded elevator


class Measured(NamedTuple):
    """A recorded phugoid: mean condition, eigenvalue, and ratios to the speed in the mode
    (complex).
    """

    point: dict[str, float]
    s: complex
    amplitude: float
    ratio: dict[str, complex]
    drag: tuple[float, float]  # mean drag in the motion, and by the polar of the rest points [N]


class Split(NamedTuple):
    """Damping ratio, period [s], and the two parts of the damping ratio."""

    zeta: float
    period: float
    along: float
    normal: float


def split(s: complex, x: complex, n: complex, V: float) -> Split:
    """Return the damping ratio of an eigenvalue and its two parts."""
    w = abs(s)
    return Split(
        -s.real / w, 2.0 * np.pi / s.imag, -x.real / (2.0 * w), G0 * n.imag / (2.0 * s.imag * w * V)
    )


def measured(year: int) -> Measured:
    """Return a recorded phugoid; specific forces are those of the accelerometers, referred to the
    c.g.
    """
    states = citation.path(year, "phugoid", -5.0, 150.0).states
    t = states["time"].values - citation.start(year, "phugoid")
    now = states.isel(time=(t > FREE[year][0]) & (t < FREE[year][1]))
    t = now["time"].values - now["time"].values[0]
    y = {
        name: now[name].values
        for name in ("V", "h", "alpha", "theta", "gamma", "delta_e", "ax", "az", "qbar", "mass")
    }
    y["T"] = now["engine1.thrust"].values + now["engine2.thrust"].values
    y["X"] = y["ax"] * np.cos(y["alpha"]) + y["az"] * np.sin(y["alpha"])
    y["N"] = y["ax"] * np.sin(y["alpha"]) - y["az"] * np.cos(y["alpha"])
    y["D"] = y["T"] * np.cos(y["alpha"]) - y["mass"] * y["X"]
    CL = (y["mass"] * y["N"] - y["T"] * np.sin(y["alpha"])) / (y["qbar"] * citation.aircraft().S)
    polar = (
        citation.fit("CD = 1 + CL**2", citation.stationary_parts(year)).estimates["estimate"].values
    )
    y["D of the polar"] = y["qbar"] * citation.aircraft().S * (polar[0] + polar[1] * CL**2)
    mode = fit_mode(t, y["V"])
    s = complex(-mode.sigma, mode.wd)
    wave = np.exp(s * t)
    X = np.column_stack([np.ones_like(t), t, wave.real, -wave.imag])
    parts = {name: np.linalg.lstsq(X, x, rcond=None)[0][2:] @ [1.0, 1.0j] for name, x in y.items()}
    mean = {name: float(x.mean()) for name, x in y.items()}
    warmer = float(now["temperature"].mean()) - float(atmosphere(mean["h"]).temperature)
    point = {
        "init.V": mean["V"],
        "init.h": mean["h"],
        "env.delta_T": warmer,
        "mass.mass": mean["mass"],
        "mode.engine": 2.0,
    }
    point["mass.x_cg_b"] = float(now["x_cg_b"].mean())
    ratio = {name: complex(part / parts["V"]) for name, part in parts.items()}
    return Measured(point, s, abs(parts["V"]), ratio, (mean["D"], mean["D of the polar"]))


def databases(folder: Path) -> dict[str, xr.DataTree]:
    """Return the prior, and the models of both flights by regression and by output error of the
    short period.
    """
    corpus = ROOT.parent / "shared" / "data" / "datcom"
    roles = ("clean", "flaps", "elevator", "aileron", "ground")
    listings = {
        role: datcom_io.read(corpus / f"ce500_{role}" / f"ce500_{role}.out") for role in roles
    }
    given = {
        role: listing[0] if role in ("flaps", "ground") else listing
        for role, listing in listings.items()
    }
    maps = citation.HERE / "maps"
    prior = citation.similar(
        aerodb.from_datcom(flightmech.read_aircraft(maps / "ce500.toml"), **given, altitude=0.0)
    )
    found = {"DATCOM": prior}
    aerodb.save(prior, folder / "prior.nc")
    shutil.copy(maps / "citation.toml", folder)
    for year in FREE:
        found[f"regression {year}"] = aerodb.replace_terms(
            prior, aerodb.tabulate(citation.fits_of(year), prior, held=HELD)
        )
        (folder / str(year)).mkdir()
        flighttest.reconstruction.save_path(
            citation.path(year, "short_period", -3.0, 14.0),
            folder / str(year) / "path_short_period.nc",
        )
        shutil.copy(maps / f"fit_pitch_{year}.toml", folder)
        perform_fit_job(read_specification(folder / f"fit_pitch_{year}.toml")).write_database(
            folder / f"{year}.nc"
        )
        found[f"output error {year}"] = aerodb.open(folder / f"{year}.nc")
    return found


class Change(NamedTuple):
    """One change of a model or of what drives it."""

    terms: dict[
        str, Callable[[xr.Dataset, float], float | xr.DataArray]
    ] = {}  # term: added to the table, from leaf and trimmed alpha
    parameters: dict[str, float] = {}
    thrust: complex = 1.0  # factor on the recorded change of thrust with speed
    elevator: complex = 1.0  # factor on the recorded movement of the elevator
    moved: complex = 0.0  # further movement of the elevator over the speed [rad s/m]
    shear: float = 0.0  # tailwind over height [1/s]
    level: bool = False  # height without effect
    lower: float = 0.0  # thrust lines moved down [m]


def mode(db: xr.DataTree, flight: Measured, change: Change | None = None) -> Split:
    """Return the phugoid of a linear model, elevator and thrust moving with the speed as they were
    recorded.
    """
    change, craft = change or Change(), citation.aircraft()
    engines = tuple(
        dataclasses.replace(e, position=(*e.position[:2], e.position[2] + change.lower))
        for e in craft.engines
    )
    craft = dataclasses.replace(craft, engines=engines)
    point = {**flight.point, **change.parameters}
    steps = {
        "alpha": 1.0 * DEGREE
    }  # averages the cells of the tables: alpha moves by 0.1 deg, its level is known to 0.5 deg

    def linear(tables: xr.DataTree) -> xr.Dataset:
        return flightmech.linearize(
            flightmech.compile(craft, tables), point, STATES, INPUTS, ("nz",), steps
        )

    if change.terms:
        alpha = float(linear(db)["x"].sel(state="alpha"))
        leaves = aerodb.terms(db)
        new = {
            name: leaves[name].assign(value=leaves[name]["value"] + add(leaves[name], alpha))
            for name, add in change.terms.items()
        }
        db = aerodb.replace_terms(db, new)
    found = linear(db)
    A, B = found["A"].values.astype(complex), found["B"].values
    A[:, 0] += (B[:, 1] + B[:, 2]) / 2.0 * flight.ratio["T"] * change.thrust
    A[:, 0] += B[:, 0] * (flight.ratio["delta_e"] * change.elevator + change.moved)
    A[0] -= change.shear * A[4]
    if change.level:
        A = A[:4, :4]
    values, vectors = np.linalg.eig(A)
    best = int(np.argmin(np.abs(values - flight.s)))
    s, v = complex(values[best]), vectors[:, best] / vectors[0, best]
    V, gamma = point["init.V"], v[3] - v[1]
    return split(s, s + G0 * gamma, V * s * gamma, V)


def changes(flight: Measured) -> dict[str, Change]:
    """Return what is changed, one standard error or a round figure each."""

    def slope(size: float) -> Callable[[xr.Dataset, float], xr.DataArray]:
        return lambda leaf, alpha: size * (leaf["alpha"] - alpha)

    def all_over(size: float) -> Callable[[xr.Dataset, float], float]:
        return lambda leaf, alpha: size

    CD = flight.drag[1] / (
        0.5 * float(atmosphere(flight.point["init.h"], flight.point["env.delta_T"]).rho)
    )
    CD /= flight.point["init.V"] ** 2 * citation.aircraft().S
    half = RESOLUTION / 2.0 / flight.amplitude
    return {
        "drag level + 5 % (thrust of the deck)": Change({"CD/basic": all_over(0.05 * CD)}),
        "alpha level + 0.5 deg (CL - 0.045)": Change({"CL/basic": all_over(-0.045)}),
        "CL_alpha + 0.13": Change({"CL/basic": slope(0.13)}),
        "CD_alpha + 5 % (0.012)": Change({"CD/basic": slope(0.012)}),
        "Cm_alpha + 0.026": Change({"Cm/basic": slope(0.026)}),
        "Cm_alpha + 0.1": Change({"Cm/basic": slope(0.1)}),
        "Cm_q + 0.6": Change({"Cm/qhat": all_over(0.6)}),
        "Cm_q - 5": Change({"Cm/qhat": all_over(-5.0)}),
        "Cm_alphadot + 2": Change({"Cm/alphadothat": all_over(2.0)}),
        "Iyy + 10 %": Change(parameters={"mass.Iyy": 1.1 * citation.aircraft().Iyy}),
        "c.g. forward 1 cm": Change(parameters={"mass.x_cg_b": flight.point["mass.x_cg_b"] + 0.01}),
        "thrust line 0.3 m lower": Change(lower=0.3),
        "thrust does not change with speed": Change(thrust=0.0),
        "change of thrust with speed + 10 %": Change(thrust=1.1),
        "thrust lags by 1 s": Change(thrust=1.0 / (1.0 + flight.s)),
        "air and thrust do not change with height": Change(level=True),
        "tailwind + 5 m/s per 1000 m": Change(shear=0.005),
        "elevator at rest": Change(elevator=0.0),
        "half a step of the elevator, with the speed": Change(moved=half),
        "half a step of the elevator, a quarter period ahead": Change(moved=1.0j * half),
    }


def replays(
    found: dict[str, xr.DataTree], year: int, folder: Path, held: bool
) -> dict[str, tuple[float, float, float]]:
    """Return damping ratio, period and largest bank off the flight's, of every model flown with the
    recorded inputs.
    """
    path, begin = citation.path(year, "phugoid", -5.0, 150.0), citation.start(year, "phugoid")
    path.states.to_netcdf(folder / "path.nc", engine="h5netcdf")
    window = f"window = [{begin + CASES[year][0]}, {begin + CASES[year][1]}]"
    head = f'[case]\nid = "2.c.9"\nname = "p"\ntitle = "p"\nrecord = "path.nc"\n{window}\n'
    (folder / "case.toml").write_text(
        f"{head}{citation.WINGS_HELD if held else ''}[events]\ninput_end = {begin + 16.0}\n"
    )
    models = {
        name: flightmech.write_fmu(
            flightmech.compile(citation.aircraft(), db), folder / f"{name.replace(' ', '_')}.fmu"
        )
        for name, db in found.items()
    }
    signals = pom.replay(pom.read_case(folder / "case.toml"), models, path).signals
    t = signals["time"].values - signals["time"].values[0] + CASES[year][0]
    late, result = t > FREE[year][0], {}
    for run in map(str, signals["run"].values):
        bank = float(
            np.abs(signals["phi"].sel(run=run) - signals["phi"].sel(run="flight")).max() / DEGREE
        )
        try:
            fitted = fit_mode(t[late], signals["V_cas"].sel(run=run).values[late])
        except Invalid:  # a spiral dive
            result[run] = np.nan, np.nan, bank
        else:
            result[run] = fitted.damping_ratio, fitted.period, bank
    return result


def main() -> None:
    """Print all tables."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    warnings.simplefilter("ignore", AeromatchWarning)
    flights = {year: measured(year) for year in FREE}
    for year, flight in flights.items():
        V, r = flight.point["init.V"], flight.ratio
        own = split(flight.s, r["X"], r["N"], V)
        other = split(flight.s, flight.s + G0 * r["gamma"], V * flight.s * r["gamma"], V)
        print(
            f"\n{year}: {own.period:.2f} s, zeta {own.zeta:.4f}, V {V:.1f} +- "
            f"{flight.amplitude:.1f} m/s"
        )
        for what, parts in (("accelerometers", own), ("speed and height", other)):
            print(f"  {what:20s} along {parts.along:+.4f}  normal {parts.normal:+.4f}")
        for name in ("T", "D", "D of the polar"):
            print(f"  {name} over V {r[name].real:+.1f} {r[name].imag:+.1f}i N s/m")
        for name in ("alpha", "delta_e"):
            print(
                f"  {name} {abs(r[name]) * flight.amplitude / DEGREE:.4f} deg, over V "
                f"{r[name].real:+.2e} {r[name].imag:+.2e}i rad s/m"
            )
        print(f"  drag {flight.drag[0]:.0f} N, by the polar {flight.drag[1]:.0f} N")
    with tempfile.TemporaryDirectory() as name:
        found = databases(Path(name))
        for year, flight in flights.items():
            print(f"\n{year}: linear models       zeta   period   along  normal | both still")
            for model, db in found.items():
                one, still = mode(db, flight), mode(db, flight, Change(thrust=0.0, elevator=0.0))
                print(
                    f"  {model:20s} {one.zeta:8.4f} {one.period:7.1f} {one.along:+8.4f} "
                    f"{one.normal:+8.4f} | {still.zeta:.4f}"
                )
            model = f"output error {year}"
            base = {name: mode(found[name], flight) for name in ("regression 2018", model)}
            print(f"{year}: change of zeta (and of the period) in regression 2018 and {model}")
            for what, change in changes(flight).items():
                moved = {name: mode(found[name], flight, change) for name in base}
                print(
                    f"  {what:52s}"
                    + "".join(
                        f"{moved[m].zeta - b.zeta:+9.4f} ({moved[m].period - b.period:+.2f} s)"
                        for m, b in base.items()
                    )
                )
            free, held = (replays(found, year, Path(name), wings) for wings in (False, True))
            print(f"{year}: replays                recorded surfaces           wings held")
            for run in free:
                print(
                    f"  {run:20s}"
                    + "".join(
                        f"  {z:7.4f} {T:6.1f} s {bank:5.1f} deg"
                        for z, T, bank in (free[run], held[run])
                    )
                )


if __name__ == "__main__":
    main()
