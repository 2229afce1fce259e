"""A planned programme against the shipped one: flown time, rows that pass, standard errors predicted and achieved.

    python benchmarks/planned_programme.py FOLDER [--seed 18] [--jobs 2] [--free-air]

``--free-air`` leaves out control loading and landing gear, whose runs no plan changes and which take most of the time, with their cases.

`aeromatch flight plan` chooses the free-air manoeuvres of the T-37 from ``planned_programme.toml``; the script ``t37_flight_test.py``
next to the repository flies them, with the same instruments, wind and noise as everything else of the seed: gear and speed brake (09),
low passes and descent (12 to 16), the runs of the control loading and of the landing gear, and those of the cases.  The project is
that of ``data/t37`` with the flights and fits of the plan.  FOLDER keeps recordings and plan; what is there is not made again.
"""

from __future__ import annotations

import argparse
import importlib
import json
import pickle
import re
import shutil
import sys
import warnings
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
from aeromatch import workflow
from aeromatch.project import read_project
from flighttest.planning.catalogue import read_catalogue
from flighttest.planning.plan import Plan, plan_of
from flighttest.planning.prediction import predict, with_assumed

ROOT = Path(__file__).parents[1]
TOOLS = ROOT.parent / "shared" / "tools"
EXAMPLE = ROOT / "data" / "t37"
KEPT = range(9, 17)  # of the shipped programme, without 10 and 11: gear and speed brake, ground effect
FREE_AIR = (*range(1, 12),)
STOPS = {"delta_e": (0.35, 0.30, 1.0), "delta_a": (0.35, 0.35, -1.0), "delta_r": (0.35, 0.35, 1.0)}  # rad at the stops, sign of the command
CONTROL = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder"}
KNOT, FEET = 1852.0 / 3600.0, 0.3048


def tool(name: str) -> Any:
    """Return a script of the tools as a module."""
    sys.path.insert(0, str(TOOLS))
    return importlib.import_module(name)


def errors_of(folder: Path, seed: int) -> dict[str, Any]:
    """Return the errors of all instruments of a seed, those of the cockpit and of the ground runs among them."""
    file = folder / "errors.json"
    if not file.exists():
        errors = tool("t37_flight_test").draw_errors(seed)
        for name in ("t37_control_forces", "t37_ground_handling"):
            module = tool(name)
            more = getattr(module, "draw_errors", tool("t37_flight_test").draw_errors)(seed)
            errors = {**more, **errors, "wind_north_east": {**more["wind_north_east"], **errors["wind_north_east"]}}
            for run in module.PROGRAMME:
                errors["wind_north_east"].setdefault(f"{run['number']:02d}", [1.5, -2.0])
        file.write_text(json.dumps(errors), encoding="utf-8")
    return json.loads(file.read_text(encoding="utf-8"))


def record(folder: Path, run: dict[str, Any], errors: dict[str, Any], *aeroplane: Any) -> float:
    """Fly a run if its recording is not there; return its length. [s]"""
    file = folder / f"t37_{run['number']:02d}_{run['title']}.nc"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        T = tool("t37_flight_test")
        truth, log = T.fly(run, errors, *aeroplane)
        T.save_recording(str(file), run, T.measure(truth, errors, run["number"]), log)
    with xr.open_dataset(file, group="imu") as data:
        return float(data["time"][-1])


def card(candidate: Any) -> list[tuple[Any, ...]]:
    """Return a manoeuvre of the plan in the words of the script."""
    m, signal = candidate.manoeuvre, candidate.signal
    if signal is not None:
        return [("script", m.name, "", float(signal["time"][-1]), played(signal, m.feedback), "planned input")]
    if m.kind == "sideslip":
        return [("sideslip", sign * m.amplitude / STOPS["delta_r"][0], m.duration) for sign in (1.0, -1.0)]
    if m.kind == "pull_up_push_down":
        return [("pupd", m.amplitude, m.duration)]
    return [("speed", -m.amplitude, m.duration), ("speed", m.amplitude, 1.5 * m.duration)]


def played(signal: xr.Dataset, share: float):
    """Return a prepared action that plays a test input: trim plus deflections, with the light hand of the script."""

    def prepare(aeroplane: Any, pilot: Any, d: dict[str, float]):
        pilot.let_go()
        base, theta = dict(aeroplane.want), d["theta"]

        def act(t: float, d: dict[str, float]) -> None:
            for name, control in CONTROL.items():
                up, down, sign = STOPS[name]
                u = float(np.interp(t, signal["time"].values, signal[name].values)) if name in signal else 0.0
                aeroplane.want[control] = base[control] + sign * u / (up if u < 0 else down)
            aeroplane.want["aileron"] -= share * d["phi"]
            aeroplane.want["elevator"] += share * (d["theta"] - theta)

        return act

    return prepare


def runs_of(plan: Plan) -> list[dict[str, Any]]:
    """Return the planned runs for the script, one per condition."""
    T, found = tool("t37_flight_test"), []
    conditions = {c.name: c for c in plan.prediction.catalogue.condition}
    for number, name in enumerate(dict.fromkeys(c for c, _ in plan.items), 1):
        fixed = conditions[name].fixed
        cards: list[tuple[Any, ...]] = [("trim", 8.0)]
        for item in plan.items:
            if item[0] == name:
                cards += [*card(plan.prediction.candidates[item]), ("recover", 8.0)]
        density = float(flightmech.air.atmosphere(fixed["h"]).rho / flightmech.air.atmosphere(0.0).rho)
        title = "plan_" + re.sub(r"[^a-z0-9]+", "_", name.lower())
        flown = {"kcas": fixed["V"] / KNOT * np.sqrt(density), "altitude_ft": fixed["h"] / FEET, "fuel": 320.0}
        found.append(
            T.single(
                number, title, flown["kcas"], flown["altitude_ft"], cards[:-1], fixed["delta_f"] / np.radians(40.0), fixed["gear"], 320.0
            )
        )
    return found


def marks_of(plan: Plan, condition: str, manoeuvre: str) -> list[str]:
    """Return what the script calls a manoeuvre in its records."""
    return list(plan.prediction.candidates[condition, manoeuvre].manoeuvre.marks) or [manoeuvre]


def fits_of(plan: Plan) -> str:
    """Return the fits of the plan as sections of a project file."""
    records = {
        name: f"t37_{run['number']:02d}_{run['title']}"
        for name, run in zip(dict.fromkeys(c for c, _ in plan.items), runs_of(plan), strict=True)
    }
    text = []
    for name, record_name in records.items():
        for fit in plan.prediction.catalogue.fit:
            used = [m for m in fit.manoeuvres if (name, m) in plan.items]
            marks = [mark for m in used for mark in marks_of(plan, name, m)]
            made = {str(one.model.coefficient) for one in plan.prediction.fits(plan.items) if one.name == f"{name}: {fit.name}"}
            models = [model for model in fit.models if model.split("=")[0].strip() in made]
            if models and (not fit.conditions or name in fit.conditions):
                keys = {"name": fit.name, "records": [record_name], "manoeuvres": marks, "models": models}
                text.append("\n".join(["[[fit]]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items()), ""]))
    return "\n".join(text)


def project_of(folder: Path, plan: Plan, free_air: bool) -> Path:
    """Write the project of a planned programme: that of the example with other flights and fits."""
    place = folder / "project"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(EXAMPLE, place, ignore=shutil.ignore_patterns("flight"))
    (place / "flight").mkdir()
    for file in [*(folder / "shared").glob("*.nc"), *(folder / "planned").glob("*.nc")]:
        (place / "flight" / file.name).symlink_to(file.resolve())
    text = (EXAMPLE / "aeromatch.toml").read_text(encoding="utf-8")
    sections = re.split(r"(?m)^(?=\[)", text)
    dropped = tuple(f"t37_{number:02d}_" for number in FREE_AIR if number not in KEPT or number in (10, 11))
    kept = [
        part for part in sections if not (part.startswith(("[[fit]]", "[[ground_effect.flown]]")) and any(name in part for name in dropped))
    ]
    if free_air:
        kept = [part for part in kept if not part.startswith(("[controls", "[[controls", "[gear", "[[gear"))]
        kept[0] = kept[0].replace('"cases/*.toml"', '"cases/[23]*.toml"')
    landing = next(c.name for c in plan.prediction.catalogue.condition if c.fixed.get("gear"))
    number = [c for c in dict.fromkeys(c for c, _ in plan.items)].index(landing)
    run = runs_of(plan)[number]
    marks = [m for c, name in plan.items if c == landing for m in marks_of(plan, c, name) if m != "steady_sideslip"]
    free = f'[[ground_effect.flown]]\nrecords = ["t37_{run["number"]:02d}_{run["title"]}"]\nmanoeuvres = {json.dumps(marks)}\n\n'
    at = max(k for k, part in enumerate(kept) if part.startswith("[[ground_effect.flown]]")) + 1
    first = next(k for k, part in enumerate(kept) if part.startswith("[[fit]]"))
    kept = [*kept[:first], fits_of(plan), "\n", *kept[first:at], free, *kept[at:]]
    (place / "aeromatch.toml").write_text("".join(kept), encoding="utf-8")
    return place / "aeromatch.toml"


def planned(folder: Path, jobs: int) -> tuple[Plan, xr.DataTree]:
    """Return the plan, made when it is not there, and the database before the flights."""
    project = read_project(EXAMPLE / "aeromatch.toml")
    start = workflow.opened(project, workflow.a_priori(project, flightmech.read_aircraft(project.aircraft)))
    file = folder / "plan.pickle"
    if not file.exists():
        catalogue = read_catalogue(Path(__file__).with_suffix(".toml"))
        aircraft = flightmech.read_aircraft(project.aircraft)
        sim = flightmech.compile(workflow.before_flight(project, aircraft), with_assumed(start, catalogue))
        file.write_bytes(pickle.dumps(plan_of(predict(catalogue, sim, aircraft, jobs), start)))
    return pickle.loads(file.read_bytes()), start


def compared(plan: Plan, start: xr.DataTree, final: xr.DataTree) -> pd.DataFrame:
    """Return predicted and achieved standard errors of the wanted nodes, and of all that the plan informs."""
    before, after, rows = aerodb.terms(start), aerodb.terms(final), []
    flown = plan_flown(plan, start)
    for name, expected in plan.expected.items():
        ratio = (after[name]["stderr"].values / expected)[before[name]["stderr"].values > 0]
        where = flown.get(name, np.zeros(expected.shape, bool))[before[name]["stderr"].values > 0]
        rows.append(pd.DataFrame({"term": name, "achieved/expected": ratio, "flown": where}))
    return pd.concat(rows, ignore_index=True)


def plan_flown(plan: Plan, start: xr.DataTree) -> dict[str, np.ndarray]:
    """Return which nodes the planned manoeuvres fly."""
    return aerodb.update.Expectation(start, plan.prediction.catalogue.held).flown(plan.prediction.fits(plan.items))


def within(ratio: pd.Series, part: float = 0.2) -> float:
    """Return the share of ratios within a part of one. [%]"""
    return 100.0 * float(((ratio > 1.0 - part) & (ratio < 1.0 + part)).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--free-air", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore", flightmech.errors.AeromatchWarning)
    given.folder.mkdir(parents=True, exist_ok=True)
    errors, T = errors_of(given.folder, given.seed), tool("t37_flight_test")
    plan, start = planned(given.folder, given.jobs)
    print(plan.report(), flush=True)
    shipped = sum(
        record(given.folder / "shipped", run, errors) for run in T.PROGRAMME if run["number"] in (*FREE_AIR,) and run["number"] != 9
    )
    kept = sum(
        record(given.folder / "shared", run, errors) for run in T.PROGRAMME if run["number"] in KEPT and run["number"] not in (10, 11)
    )
    for run in T.PROGRAMME:
        if run["purpose"] == "validation":
            record(given.folder / "shared", run, errors)
    new = sum(record(given.folder / "planned", run, errors) for run in runs_of(plan))
    share = (new + kept) / (shipped + kept)
    print(
        f"flown: {new + kept:.0f} s with gear, speed brake and ground effect, shipped {shipped + kept:.0f} s: {100 * share:.1f} %",
        flush=True,
    )
    others = () if given.free_air else (("t37_control_forces", "Reversible"), ("t37_ground_handling", "Rolling"))
    for name, aeroplane in others:  # these scripts add channels to the recorder: after all other flights
        module = tool(name)
        for run in module.PROGRAMME:
            record(given.folder / "shared", run, errors, getattr(module, aeroplane))
    project = read_project(project_of(given.folder, plan, given.free_air))
    outcome = workflow.perform(project, given.folder / "out", given.jobs, lambda text: print(text, flush=True) or nullcontext())
    for result in outcome.results:
        worst = {run: (result.status(run), result.worst(run)) for run in result.runs}
        print(
            f"{result.case.id:12s} {result.case.title[:40]:40s}",
            *(f"{run} {s} {w['worst_ratio'] if w else float('nan'):.2f}" for run, (s, w) in worst.items()),
        )
    table = compared(plan, start, aerodb.open(given.folder / "out" / "final.nc"))
    table.to_csv(given.folder / "compared.csv", index=False)
    for name, part in [*table.groupby("term"), ("all", table), ("flown", table[table["flown"]]), ("not flown", table[~table["flown"]])]:
        r = part["achieved/expected"]
        low, middle, high = (r.quantile(q) for q in (0.05, 0.5, 0.95))
        print(f"{name:20s} {len(part):5d} nodes, within 20 %: {within(r):5.1f} %, achieved/expected {low:.2f} {middle:.2f} {high:.2f}")


if __name__ == "__main__":
    main()
