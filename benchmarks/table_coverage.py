"""Tables from flight against the aeroplane that was flown: are the standard errors of the nodes
true?

    python benchmarks/table_coverage.py FOLDER --seeds 1-20 [--make] [--jobs 2] [--way
    tabulate|direct|join|all]

Simulated T-37 programmes of other seeds (the script ``t37_flight_test.py`` next to the repository,
``--make``), each through the identification of ``data/t37``; then every node of the final database
against the value of the aircraft of the pip package ``jsbsim``. Per term: nodes from flight and
others within 15 deg of incidence, the share within two standard errors, rms of error over standard
error, rms error and that of DATCOM.  FOLDER keeps recordings and reconstructed paths, one folder
per seed.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import itertools
import json
import os
import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
import flighttest
from aeromatch.project.project import Project, read_project
from aeromatch.project.sections import Controls
from aeromatch.workflow.aerodynamics import (
    WAYS,
    a_priori,
    add_missing_terms,
    coefficients_of,
    final_database,
    fit_records,
    samples_of,
)
from aeromatch.workflow.windows import select_windows
from flightmech import terms
from flightmech.units import DEGREE, FOOT
from flighttest.records.sensors.instruments import surface_errors

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT.parent / "shared" / "tools" / "t37_flight_test.py"
FULL_FLAP = 40 * DEGREE  # as data/t37/names.toml has it
HIGH = 1000.0  # out of ground effect [m]
# what a regressor is set to where a term multiplies it; the value of the table is the contribution
# over this
STEP = {
    "alpha": 4 * DEGREE, "beta": 4 * DEGREE, "phat": 0.02, "qhat": 0.002, "rhat": 0.01,
    "alphadothat": 0.002, "delta_e": 0.1,
    "delta_a": 0.1, "delta_r": 0.1, "delta_f": FULL_FLAP, "gear": 1.0, "speedbrake": 1.0,
}  # fmt: skip
REST = {"alpha": 3 * DEGREE, "mach": 0.3, "h_agl": HIGH, "h": 3000.0}
COMMAND = {
    "delta_e": ("fcs/elevator-cmd-norm", 0.35, 0.30),
    "delta_a": ("fcs/aileron-cmd-norm", -0.35, -0.35),
    "delta_r": ("fcs/rudder-cmd-norm", 0.35, 0.35),
}
AT_MOST = 15 * DEGREE
# Channels of the surfaces whose scale errors the script does not draw.
PICK_UPS = {"delta_a": ("delta_a_left", "delta_a_right"), "delta_r": ("delta_r",)}


@contextlib.contextmanager
def silent():
    """Keep the greeting that JSBSim prints from the file descriptor."""
    sink, saved = os.open(os.devnull, os.O_WRONLY), os.dup(1)
    os.dup2(sink, 1)
    try:
        yield
    finally:
        os.dup2(saved, 1)
        os.close(sink)
        os.close(saved)


class Aeroplane:
    """Coefficients of the aircraft T37 of JSBSim at given conditions, about its reference point,
    lift and drag in stability axes.
    """

    def __init__(self) -> None:
        import jsbsim

        with silent():
            self.f = jsbsim.FGFDMExec(os.path.dirname(jsbsim.__file__))
            self.f.set_debug_level(0)
            self.f.load_model("T37")
        lines = self.f.query_property_catalog("aero/coefficient").strip().split("\n")
        self.functions = [line.split(" ")[0] for line in lines]
        self.known: dict[tuple, dict[str, float]] = {}

    def at(self, **where: float) -> dict[str, float]:
        """Return CL CD CY Cl Cm Cn; what is not given is at rest, as `REST` has it. [SI]"""
        key = tuple(sorted((name, round(float(x), 12)) for name, x in where.items()))
        if key not in self.known:
            self.known[key] = self._evaluated({**REST, **where})
        return self.known[key]

    def _evaluated(self, where: dict[str, float]) -> dict[str, float]:
        f = self.f
        f["ic/h-sl-ft"], f["ic/mach"] = (
            5000.0,
            max(where["mach"], 0.05),
        )  # nothing in this aircraft depends on Mach numbers below
        f["ic/terrain-elevation-ft"] = 5000.0 - (where["h_agl"] - 0.2235) / FOOT
        f["ic/gamma-deg"], f["ic/alpha-rad"], f["ic/beta-rad"] = (
            0.0,
            where["alpha"],
            where.get("beta", 0.0),
        )
        f["ic/p-rad_sec"] = f["ic/q-rad_sec"] = f["ic/r-rad_sec"] = 0.0
        for name, (prop, low, high) in COMMAND.items():
            x = where.get(name, 0.0)
            f[prop] = x / (high if x > 0 else low)
        for name, prop, full in (
            ("delta_f", "fcs/flap", FULL_FLAP),
            ("gear", "gear/gear", 1.0),
            ("speedbrake", "fcs/speedbrake", 1.0),
        ):
            f[f"{prop}-cmd-norm"] = f[f"{prop}-pos-norm"] = where.get(name, 0.0) / full
        with silent():
            f.run_ic()
            twice = {
                "p": 1.0 / f["aero/bi2vel"],
                "q": 1.0 / f["aero/ci2vel"],
                "r": 1.0 / f["aero/bi2vel"],
            }
            for rate, scale in twice.items():
                f[f"ic/{rate}-rad_sec"] = where.get(f"{rate}hat", 0.0) * scale
            if any(where.get(f"{rate}hat", 0.0) for rate in twice):
                f.run_ic()
        self._demand(where)
        area = f["aero/qbar-psf"] * f["metrics/Sw-sqft"]
        b, c = f["metrics/bw-ft"], f["metrics/cbarw-ft"]
        total = dict.fromkeys(("CD", "CY", "CL", "Cl", "Cm", "Cn"), 0.0)
        for name in self.functions:
            short = name.rpartition("/")[2].lstrip("dD")
            coefficient, value = short[:2], f[name] / area
            if short.endswith("adot"):  # the rate that it starts with is not the one that is wanted
                value *= where.get("alphadothat", 0.0) / (
                    f["aero/alphadot-rad_sec"] * f["aero/ci2vel"]
                )
            total[coefficient] += value / {"Cl": b, "Cm": c, "Cn": b}.get(coefficient, 1.0)
        beta = where.get("beta", 0.0)
        drag, side = total["CD"], total["CY"]
        return {
            **total,
            "CD": drag * np.cos(beta) + side * np.sin(beta),
            "CY": side * np.cos(beta) - drag * np.sin(beta),
        }

    def _demand(self, where: dict[str, float]) -> None:
        """The aeroplane must be where it was put."""
        f = self.f
        seen = {
            "alpha": f["aero/alpha-rad"],
            "beta": f["aero/beta-rad"],
            "delta_e": f["fcs/elevator-pos-rad"],
            "delta_a": -f["fcs/left-aileron-pos-rad"],
            "delta_r": f["fcs/rudder-pos-rad"],
            "delta_f": f["fcs/flap-pos-norm"] * FULL_FLAP,
            "gear": f["gear/gear-pos-norm"],
            "speedbrake": f["fcs/speedbrake-pos-norm"],
            "phat": f["velocities/p-aero-rad_sec"] * f["aero/bi2vel"],
            "qhat": f["velocities/q-aero-rad_sec"] * f["aero/ci2vel"],
            "rhat": f["velocities/r-aero-rad_sec"] * f["aero/bi2vel"],
        }
        for name, x in seen.items():
            assert abs(x - where.get(name, 0.0)) < 1e-6, (name, x, where)


def true_table(name: str, leaf: xr.Dataset, aeroplane: Aeroplane) -> np.ndarray:
    """Return the true nodes of a term, NaN where the aeroplane cannot get: what its variables do
    together, over the regressors.

    A term is an increment in all its variables but incidence, Mach number and altitude, so its
    value is the alternating sum over their being at rest or not.
    """
    coefficient = name.split("/")[0]
    multipliers = terms.list_regressors(leaf)
    dims = [str(dim) for dim in leaf["value"].dims]
    # the yaw of gear and flaps is even in sideslip, which is another term; nothing in this aircraft
    # depends on the altitude
    if name in ("Cn/beta_gear", "Cn/beta_flap") or name.endswith("/altitude"):
        return np.zeros(leaf["value"].shape)
    found = np.empty(leaf["value"].shape)
    for at in np.ndindex(*found.shape):
        given = {dim: float(leaf[dim].values[i]) for dim, i in zip(dims, at)}
        steps = {variable: STEP[variable] for variable in multipliers}
        where = {**given, **steps}
        moving = [
            variable
            for variable in where
            if variable not in ("mach", "h") and (variable != "alpha" or "alpha" in multipliers)
        ]
        if -where.get("delta_e", 0.0) > 0.3501 or where.get("delta_e", 0.0) > 0.3001:
            found[at] = np.nan
            continue
        total = 0.0
        for there in itertools.product((True, False), repeat=len(moving)):
            point = {k: x for k, x in where.items() if k not in moving} | {
                k: where[k] for k, on in zip(moving, there) if on
            }
            if "alpha" in moving and "alpha" not in point:
                point["alpha"] = 0.0
            total += (-1.0) ** there.count(False) * aeroplane.at(**point)[coefficient]
        found[at] = total / np.prod([*steps.values(), 1.0])
    return found


def true_tables(db: xr.DataTree, names: list[str]) -> dict[str, np.ndarray]:
    """Return the true nodes of terms of a database."""
    aeroplane, leaves = Aeroplane(), aerodb.terms(db)
    return {name: true_table(name, leaves[name], aeroplane) for name in names}


def write_errors(file: Path, seed: int, aircraft: flightmech.Aircraft) -> None:
    """Write the errors of the instruments of a seed for the script.

    The script draws no scale error of the pick-ups of aileron and rudder, and the aircraft declares
    one.  Without it the standard errors of their derivatives are of an error that no flight has.
    """
    sys.path.insert(0, str(SCRIPT.parent))
    errors = importlib.import_module(SCRIPT.stem).draw_errors(seed)
    declared = surface_errors(aircraft.instruments)
    rng = np.random.default_rng([seed, *b"scale of surfaces"])
    for surface, channels in PICK_UPS.items():
        factor = 1.0 + declared[surface][1] * rng.standard_normal()
        errors["factor"] |= dict.fromkeys(channels, factor)
    file.write_text(json.dumps(errors, indent=1), encoding="utf-8")


def programme(
    folder: Path, seed: int, project: Project, aircraft: flightmech.Aircraft, make: bool, jobs: int
) -> dict[str, Any]:
    """Return recordings and reconstructed paths of a seed by record, made when they are not there
    and `make` is set.
    """
    here = folder / f"seed{seed}"
    if make and not (here / "paths.pickle").exists():
        runs = ",".join(f"{k:02d}" for k in range(1, 17))
        here.mkdir(parents=True, exist_ok=True)
        write_errors(here / "errors.json", seed, aircraft)
        job = [
            sys.executable,
            str(SCRIPT),
            "--only",
            runs,
            "--out",
            str(here / "recordings"),
            "--errors",
            str(here / "errors.json"),
        ]
        subprocess.run(job, check=True, stdout=subprocess.DEVNULL)
        files = sorted((here / "recordings").glob("*.nc"))
        paths = flighttest.reconstruct_programme(
            [flighttest.read(file, project.names) for file in files], aircraft, jobs=jobs
        )
        with open(here / "paths.pickle", "wb") as file:
            pickle.dump({name.stem: path for name, path in zip(files, paths)}, file)
    with open(here / "paths.pickle", "rb") as file:
        paths = pickle.load(file)
    records = {
        file.stem: flighttest.read(file, project.names)
        for file in sorted((here / "recordings").glob("*.nc"))
    }
    return {"paths": paths, "records": records}


def nodes_of(
    seed: int, start: xr.DataTree, tabulation: Any, truth: dict[str, np.ndarray]
) -> pd.DataFrame:
    """Return one row per free node: term, error, standard error, error of DATCOM, and whether it is
    from flight.
    """
    rows = []
    before = aerodb.terms(start)
    for name, leaf in tabulation.items():
        old = before[name]
        free = (old["stderr"].values > 0) & np.isfinite(truth[name])
        alpha = (
            xr.broadcast(abs(old["alpha"]), old["value"])[0].transpose(*old["value"].dims)
            if "alpha" in old
            else xr.zeros_like(old["value"])
        )
        free &= alpha.values < AT_MOST + 1e-6
        rows.append(
            pd.DataFrame(
                {
                    "seed": seed,
                    "term": name,
                    "flight": leaf["source"].values[free] == terms.SOURCES.index("flight"),
                    "error": (leaf["value"].values - truth[name])[free],
                    "stderr": leaf["stderr"].values[free],
                    "before": (old["value"].values - truth[name])[free],
                    "stderr_before": old["stderr"].values[free],
                    "place": np.flatnonzero(free),
                }
            )
        )
    return pd.concat(rows)


def summary(nodes: pd.DataFrame, by: str = "term") -> pd.DataFrame:
    """Return coverage and errors by group, nodes from flight and others side by side."""
    found = {}
    for (group, flight), part in nodes.groupby([by, "flight"]):
        z = part["error"] / part["stderr"]
        found[group, "flight" if flight else "other"] = {
            "nodes": len(part) / part["seed"].nunique(),
            "within 2": 100 * float((z.abs() < 2).mean()),
            "rms z": float(np.sqrt((z**2).mean())),
            "max z": float(z.abs().max()),
            "rms error": float(np.sqrt((part["error"] ** 2).mean())),
            "DATCOM": float(np.sqrt((part["before"] ** 2).mean())),
            "DATCOM within 2": 100
            * float(((part["before"] / part["stderr_before"]).abs() < 2).mean()),
        }
    return pd.DataFrame(found).T


def seeds_of(text: str) -> list[int]:
    """``1-3,7`` is 1 2 3 7."""
    ends = (part.partition("-") for part in text.split(","))
    return [seed for low, _, high in ends for seed in range(int(low), int(high or low) + 1)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="1-20")
    parser.add_argument("--make", action="store_true", help="fly and reconstruct what is not there")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--way",
        choices=[*WAYS, "all"],
        default="tabulate",
        help="how the flights enter the tables",
    )
    given = parser.parse_args()
    warnings.simplefilter("ignore", flightmech.errors.AeromatchWarning)
    # the sixteen runs of the free-air aerodynamics; engine, controls, gear and ground effect need
    # others
    project = read_project(ROOT / "data" / "t37" / "aeromatch.toml").with_changes(
        engine=None,
        controls=Controls(),
        gear=None,
        ground_effect=None,
    )
    aircraft = flightmech.read_aircraft(project.aircraft)
    start = add_missing_terms(project, a_priori(project, aircraft))
    ways = list(WAYS) if given.way == "all" else [given.way]
    found, truth = {way: [] for way in ways}, {}
    for seed in seeds_of(given.seeds):
        flown = programme(given.folder, seed, project, aircraft, given.make, given.jobs)
        windows = select_windows(project, flown["records"])
        data = coefficients_of(project, aircraft, flown["paths"], windows)
        fits = fit_records(project, data, windows)
        samples = samples_of(project, start, data, windows) if "direct" in ways else []
        for way in ways:
            _, tabulation = final_database(
                project.with_changes(tabulation=way), start, fits, samples
            )
            truth |= true_tables(start, [name for name in tabulation if name not in truth])
            found[way].append(nodes_of(seed, start, tabulation, truth))
            print(seed, way, line(found[way][-1]), flush=True)
    for way in ways:
        nodes = pd.concat(found[way])
        nodes["coefficient"] = nodes["term"].str.partition("/")[0]
        nodes["all"] = "all"
        # The standard errors of the others are mostly those of the handbook, whose errors are the
        # same for every seed.
        is_halved = nodes["stderr"] < 0.5 * nodes["stderr_before"]
        nodes["standard error"] = np.where(is_halved, "less than half of DATCOM", "more")
        print(f"\n{way}: {line(nodes)}")
        with pd.option_context(
            "display.width",
            200,
            "display.max_rows",
            None,
            "display.max_columns",
            None,
            "display.float_format",
            "{:.4g}".format,
        ):
            for by in ("term", "coefficient", "standard error", "all"):
                print(summary(nodes, by), end="\n\n")


def line(nodes: pd.DataFrame) -> str:
    """Return what counts in one line: coverage of nodes from flight and of others, rms error over
    the a-priori standard error.
    """
    inside = [
        f"{100 * float((part['error'].abs() < 2 * part['stderr']).mean()):.1f}"
        for _, part in nodes.groupby("flight")
    ]
    return (
        f"within 2: others {inside[0]}, flight {inside[-1]}; error "
        f"{np.sqrt(((nodes['error'] / nodes['stderr_before']) ** 2).mean()):.3f}"
    )


if __name__ == "__main__":
    main()
