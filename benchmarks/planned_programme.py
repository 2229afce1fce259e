"""A planned programme against the shipped one: flown time, rows that pass, standard errors
predicted and achieved.

    python benchmarks/planned_programme.py FOLDER [--seed 18] [--jobs 2] [--first 3] [--shipped]

`flighttest.planning` chooses the free-air manoeuvres of the T-37 from ``planned_programme.toml``,
knowing the fits of the runs that no plan changes: gear and speed brake (09), low passes and descent
(12 to 16).  The script ``t37_flight_test.py`` next to the repository flies the plan with the same
instruments, wind and noise as everything else of the seed: those runs, the ones of the control
loading and of the landing gear, and those of the cases.  The project is that of ``data/t37`` with
the flights and fits of the plan; ``--shipped`` performs that of ``data/t37`` itself with the
flights of the seed, for comparison.

Standard errors of the nodes are compared with those predicted before the flights, and with those
predicted after the first of the planned conditions (``--first``), as `flight coverage` does.
FOLDER keeps recordings and plan; what is there is not made again.
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
import flighttest
from aeromatch.project.project import Project, read_project
from aeromatch.project.sections import Controls
from aeromatch.workflow.aerodynamics import (
    a_priori,
    add_missing_terms,
    before_flight,
    coefficients_of,
    fit_records,
    reconstruct_records,
)
from aeromatch.workflow.steps import perform_match
from aeromatch.workflow.windows import records_of, select_windows
from flighttest.flight_programme.planning.catalogue import read_catalogue
from flighttest.flight_programme.planning.coverage import identify_database
from flighttest.flight_programme.planning.plan import ProgrammePlan, plan_predicted_flights
from flighttest.flight_programme.planning.prediction import predict, with_assumed

ROOT = Path(__file__).parents[1]
TOOLS = ROOT.parent / "shared" / "tools"
EXAMPLE = ROOT / "data" / "t37"
KEPT = range(
    9, 17
)  # of the shipped programme, without 10 and 11: gear and speed brake, ground effect
FREE_AIR = (*range(1, 12),)
STOPS = {
    "delta_e": (0.35, 0.30, 1.0),
    "delta_a": (0.35, 0.35, -1.0),
    "delta_r": (0.35, 0.35, 1.0),
}  # rad at the stops, sign of the command
CONTROL = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder"}
LEAVES = {
    "Reversible": "cockpit",
    "Rolling": "ground",
}  # that the scripts of other aeroplanes add to every recording
KNOT, FEET = 1852.0 / 3600.0, 0.3048


def tool(name: str) -> Any:
    """Return a script of the tools as a module."""
    sys.path.insert(0, str(TOOLS))
    return importlib.import_module(name)


def errors_of(folder: Path, seed: int) -> dict[str, Any]:
    """Return the errors of all instruments of a seed, those of the cockpit and of the ground runs
    among them.
    """
    file = folder / "errors.json"
    if not file.exists():
        errors = tool("t37_flight_test").draw_errors(seed)
        for name in ("t37_control_forces", "t37_ground_handling"):
            module = tool(name)
            more = getattr(module, "draw_errors", tool("t37_flight_test").draw_errors)(seed)
            errors = {
                **more,
                **errors,
                "wind_north_east": {**more["wind_north_east"], **errors["wind_north_east"]},
            }
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
        groups = dict(T.GROUPS)
        foreign = set(LEAVES.values()) - {LEAVES.get(one.__name__) for one in aeroplane}
        T.GROUPS = {name: leaf for name, leaf in groups.items() if name not in foreign}
        truth, log = T.fly(run, errors, *aeroplane)
        T.save_recording(str(file), run, T.measure(truth, errors, run["number"]), log)
        T.GROUPS = groups
    with xr.open_dataset(file, group="imu") as data:
        return float(data["time"][-1])


def card(candidate: Any) -> list[tuple[Any, ...]]:
    """Return a manoeuvre of the plan in the words of the script."""
    m, signal = candidate.manoeuvre, candidate.signal
    if signal is not None:
        return [
            (
                "script",
                m.name,
                "",
                float(signal["time"][-1]),
                played(signal, m.feedback),
                "planned input",
            )
        ]
    if m.kind == "sideslip":
        return [
            ("sideslip", sign * m.amplitude / STOPS["delta_r"][0], m.duration)
            for sign in (1.0, -1.0)
        ]
    if m.kind == "pull_up_push_down":
        return [("pupd", m.amplitude, m.duration)]
    return [("speed", -m.amplitude, m.duration), ("speed", m.amplitude, 1.5 * m.duration)]


def played(signal: xr.Dataset, share: float):
    """Return a prepared action that plays a test input: trim plus deflections, with the light hand
    of the script.
    """

    def prepare(aeroplane: Any, pilot: Any, d: dict[str, float]):
        pilot.let_go()
        base, theta = dict(aeroplane.want), d["theta"]

        def act(t: float, d: dict[str, float]) -> None:
            for name, control in CONTROL.items():
                up, down, sign = STOPS[name]
                u = (
                    float(np.interp(t, signal["time"].values, signal[name].values))
                    if name in signal
                    else 0.0
                )
                aeroplane.want[control] = base[control] + sign * u / (up if u < 0 else down)
            aeroplane.want["aileron"] -= share * d["phi"]
            aeroplane.want["elevator"] += share * (d["theta"] - theta)

        return act

    return prepare


def runs_of(plan: ProgrammePlan) -> list[dict[str, Any]]:
    """Return the planned runs for the script, one per condition."""
    T, found = tool("t37_flight_test"), []
    conditions = {c.name: c for c in plan.prediction.catalogue.condition}
    for number, name in enumerate(dict.fromkeys(c for c, _ in plan.items), 1):
        fixed = conditions[name].fixed
        cards: list[tuple[Any, ...]] = [("trim", 8.0)]
        for item in plan.items:
            if item[0] == name:
                cards += [*card(plan.prediction.candidates[item]), ("recover", 8.0)]
        density = float(
            flightmech.air.atmosphere(fixed["h"]).rho / flightmech.air.atmosphere(0.0).rho
        )
        title = "plan_" + re.sub(r"[^a-z0-9]+", "_", name.lower())
        flown = {
            "kcas": fixed["V"] / KNOT * np.sqrt(density),
            "altitude_ft": fixed["h"] / FEET,
            "fuel": 320.0,
        }
        found.append(
            T.single(
                number,
                title,
                flown["kcas"],
                flown["altitude_ft"],
                cards[:-1],
                fixed["delta_f"] / np.radians(40.0),
                fixed["gear"],
                320.0,
            )
        )
    return found


def marks_of(plan: ProgrammePlan, condition: str, manoeuvre: str) -> list[str]:
    """Return what the script calls a manoeuvre in its records."""
    return list(plan.prediction.candidates[condition, manoeuvre].manoeuvre.marks) or [manoeuvre]


def fits_of(plan: ProgrammePlan) -> str:
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
            made = {
                str(one.model.coefficient)
                for one in plan.prediction.fits(plan.items)
                if one.name == f"{name}: {fit.name}"
            }
            models = [model for model in fit.models if model.split("=")[0].strip() in made]
            if models and (not fit.conditions or name in fit.conditions):
                keys = {
                    "name": fit.name,
                    "records": [record_name],
                    "manoeuvres": marks,
                    "models": models,
                }
                text.append(
                    "\n".join(
                        [
                            "[[fit]]",
                            *(f"{key} = {json.dumps(value)}" for key, value in keys.items()),
                            "",
                        ]
                    )
                )
    return "\n".join(text)


def place_of(folder: Path, *flights: str) -> Path:
    """Return a folder with the files of the example and links to some flights of a programme."""
    place = folder / f"project_{flights[-1]}"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(EXAMPLE, place, ignore=shutil.ignore_patterns("flight"))
    (place / "flight").mkdir()
    for file in [one for name in flights for one in (folder / name).glob("*.nc")]:
        (place / "flight" / file.name).symlink_to(file.resolve())
    return place


def project_of(folder: Path, plan: ProgrammePlan) -> Path:
    """Write the project of a planned programme: that of the example with other flights and fits."""
    place = place_of(folder, "shared", "planned")
    sections = re.split(r"(?m)^(?=\[)", (EXAMPLE / "aeromatch.toml").read_text(encoding="utf-8"))
    dropped = tuple(
        f"t37_{number:02d}_" for number in FREE_AIR if number not in KEPT or number in (10, 11)
    )
    kept = [
        part
        for part in sections
        if not (
            part.startswith(("[[fit]]", "[[ground_effect.flown]]"))
            and any(name in part for name in dropped)
        )
    ]
    landing = next(c.name for c in plan.prediction.catalogue.condition if c.fixed.get("gear"))
    number = [c for c in dict.fromkeys(c for c, _ in plan.items)].index(landing)
    run = runs_of(plan)[number]
    pitch = {
        name
        for fit in plan.prediction.catalogue.fit
        if fit.name == "pitch"
        for name in fit.manoeuvres
    }
    marks = [
        mark
        for c, name in plan.items
        if c == landing and name in pitch
        for mark in marks_of(plan, c, name)
    ]
    free = (
        f"[[ground_effect.flown]]\nrecords = "
        f'["t37_{run["number"]:02d}_{run["title"]}"]\nmanoeuvres = {json.dumps(marks)}\n\n'
    )
    at = max(k for k, part in enumerate(kept) if part.startswith("[[ground_effect.flown]]")) + 1
    first = next(k for k, part in enumerate(kept) if part.startswith("[[fit]]"))
    kept = [*kept[:first], fits_of(plan), "\n", *kept[first:at], free, *kept[at:]]
    (place / "aeromatch.toml").write_text("".join(kept), encoding="utf-8")
    return place / "aeromatch.toml"


def local_fits(project: Project, jobs: int) -> list[Any]:
    """Return the fits of a project, from its free-air records alone."""
    project = project.with_changes(
        engine=None, controls=Controls(), gear=None, ground_effect=None, cases=[]
    )
    aircraft = flightmech.read_aircraft(project.aircraft)
    records = {
        name: flighttest.read(project.flights[name], project.names) for name in records_of(project)
    }
    windows = select_windows(project, records)
    data = coefficients_of(
        project, aircraft, reconstruct_records(project, aircraft, records, jobs), windows
    )
    return fit_records(project, data, windows)


def before(project: Project) -> tuple[Any, xr.DataTree]:
    """Return aircraft and database as they are before the flights."""
    aircraft = flightmech.read_aircraft(project.aircraft)
    return before_flight(project, aircraft), add_missing_terms(project, a_priori(project, aircraft))


def planned(folder: Path, jobs: int) -> ProgrammePlan:
    """Return the plan, made when it is not there; it knows the fits of the runs that it does not
    change.
    """
    file = folder / "plan.pickle"
    if not file.exists():
        project = read_project(EXAMPLE / "aeromatch.toml")
        unchanged = [f"t37_{number:02d}_" for number in KEPT]
        flights = {path.stem: path for path in (folder / "shared").glob("*.nc")}
        fits = [
            fit
            for fit in project.fit
            if all(name.startswith(tuple(unchanged)) for name in fit.records)
        ]
        flown = local_fits(
            project.with_changes(
                flights=flights, fit=[fit for fit in fits if fit.name[:9] != "multisine"]
            ),
            jobs,
        )
        catalogue, (known, start) = (
            read_catalogue(Path(__file__).with_suffix(".toml")),
            before(project),
        )
        sim, aircraft = (
            flightmech.compile(known, with_assumed(start, catalogue)),
            flightmech.read_aircraft(project.aircraft),
        )
        file.write_bytes(
            pickle.dumps(
                plan_predicted_flights(predict(catalogue, sim, aircraft, jobs), start, flown)
            )
        )
    found: ProgrammePlan = pickle.loads(file.read_bytes())
    return found


def after_first(
    plan: ProgrammePlan, project: Project, fits: list[Any], first: int, jobs: int
) -> dict[str, np.ndarray]:
    """Return the standard errors predicted after the first planned conditions, with what these have
    identified.
    """
    known, start = before(project)
    catalogue, conditions = plan.prediction.catalogue, list(dict.fromkeys(c for c, _ in plan.items))
    later = {f"t37_{run['number']:02d}_{run['title']}" for run in runs_of(plan)[first:]}
    flown = [fit for fit in fits if str(fit.name).split(":")[0] not in later]
    learnt = aerodb.tabulate(flown, start, catalogue.held)
    rest = [item for item in plan.items if item[0] in conditions[first:]]
    sim = flightmech.compile(known, identify_database(learnt, start, catalogue))
    prediction = predict(catalogue, sim, flightmech.read_aircraft(project.aircraft), jobs, rest)
    return aerodb.update.Expectation(start, catalogue.held, learnt=learnt).stderr(
        [*flown, *prediction.fits(rest)]
    )


def compared(
    expected: dict[str, np.ndarray],
    start: xr.DataTree,
    final: xr.DataTree,
    flown: dict[str, np.ndarray],
) -> pd.DataFrame:
    """Return predicted and achieved standard errors of all nodes that had one before and whose
    table the final database keeps.
    """
    before, after, rows = aerodb.terms(start), aerodb.terms(final), []
    for name, errors in expected.items():
        known = before[name]["stderr"].values > 0
        if (
            name in after
            and "stderr" in after[name]
            and after[name]["stderr"].shape == errors.shape
        ):
            ratio = after[name]["stderr"].values[known] / errors[known]
            where = flown.get(name, np.zeros(errors.shape, bool))[known]
            rows.append(pd.DataFrame({"term": name, "achieved/expected": ratio, "flown": where}))
    return pd.concat(rows, ignore_index=True)


def within(ratio: pd.Series, part: float = 0.2) -> float:
    """Return the share of ratios within a part of one. [%]"""
    return 100.0 * float(((ratio > 1.0 - part) & (ratio < 1.0 + part)).mean())


def shares(title: str, table: pd.DataFrame, by_term: bool = False) -> None:
    """Print how many nodes came out within 20 % of their prediction."""
    groups = table.groupby("term") if by_term else ()
    for name, part in [
        *groups,
        ("all", table),
        ("flown", table[table["flown"]]),
        ("not flown", table[~table["flown"]]),
    ]:
        r = part["achieved/expected"]
        ratios = " ".join(f"{r.quantile(q):.2f}" for q in (0.05, 0.5, 0.95))
        print(
            f"{title}: {name:20s} {len(part):5d} nodes, within 20 %: {within(r):5.1f} %, "
            f"achieved/expected {ratios}"
        )


def performed(toml: Path, folder: Path, jobs: int) -> Project:
    """Do the whole job of a project and print the worst of every case."""
    project = read_project(toml)
    outcome = perform_match(
        project, folder, jobs, lambda text: print(text, flush=True) or nullcontext()
    )
    for result in outcome.results:
        worst = {run: (result.status(run), result.worst(run)) for run in result.runs}
        print(
            f"{result.case.id:8s} {result.case.title:62s}",
            *(
                f"{run} {s} {w['worst_ratio']:.2f} {w['criterion']}" if w else f"{run} {s}"
                for run, (s, w) in worst.items()
            ),
        )
    return project


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--first", type=int, default=3)
    parser.add_argument("--shipped", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore", flightmech.errors.AeromatchWarning)
    folder: Path = given.folder
    folder.mkdir(parents=True, exist_ok=True)
    free_air = list(tool("t37_flight_test").PROGRAMME)  # the other scripts put theirs in its place
    errors = errors_of(folder, given.seed)
    changed = [run for run in free_air if run["number"] in FREE_AIR and run["number"] != 9]
    shipped = sum(record(folder / "shipped", run, errors) for run in changed)
    kept = sum(
        record(folder / "shared", run, errors)
        for run in free_air
        if run["number"] in KEPT and run not in changed
    )
    used = "".join(
        file.read_text(encoding="utf-8")
        for file in [EXAMPLE / "aeromatch.toml", *(EXAMPLE / "cases").glob("*.toml")]
    )
    control, ground = tool("t37_control_forces"), tool("t37_ground_handling")
    for programme, aeroplane in (
        (free_air, ()),
        (control.PROGRAMME, (control.Reversible,)),
        (ground.PROGRAMME, (ground.Rolling,)),
    ):
        for run in programme:
            if f"t37_{run['number']:02d}_" in used and run not in changed:
                record(folder / "shared", run, errors, *aeroplane)
    if given.shipped:
        performed(
            place_of(folder, "shared", "shipped") / "aeromatch.toml",
            folder / "out_shipped",
            given.jobs,
        )
        return
    plan = planned(folder, given.jobs)
    print(plan.report(), flush=True)
    new = sum(record(folder / "planned", run, errors) for run in runs_of(plan))
    share = (new + kept) / (shipped + kept)
    text = (
        f"flown: {new + kept:.0f} s with gear, speed brake and ground effect, shipped "
        f"{shipped + kept:.0f} s: {100 * share:.1f} %"
    )
    print(text, flush=True)
    project = performed(project_of(folder, plan), folder / "out", given.jobs)
    fits, (_, start), final = (
        local_fits(project, given.jobs),
        before(project),
        aerodb.open(folder / "out" / "final.nc"),
    )
    flown = aerodb.update.Expectation(start, plan.prediction.catalogue.held).flown(fits)
    shares("before the flights", compared(plan.expected, start, final, flown))
    later = after_first(plan, project, fits, given.first, given.jobs)
    shares(f"after {given.first} conditions", compared(later, start, final, flown), by_term=True)


if __name__ == "__main__":
    main()
