"""Thirty deceptions of an evaluator in what a report rests on, and the word that names each.

    aeromatch demo -o out/t37
    python benchmarks/thirty_deceptions.py out/t37

None of them is in `deceptions.py`, `more_deceptions.py` or `ten_deceptions.py`: tests without their
manoeuvre, facts and rows that are taken out, tables of names that correct an answer, records that
are forged or cut, evidence without its origin.  Ten on facts and conditions, ten on departures, ten
on models and records.  Printed: a line each, with the line of the report that names it.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from deceptions import (
    CASES,
    DATA,
    LAT,
    NAMED,
    RUN,
    Bench,
    Deception,
    Outputs,
    count_named,
    judge,
    shifted,
)
from ten_deceptions import recorded_runs, stated

import aerodb
import flightmech
from flightmech.flown_samples import FLOWN_SAMPLES
from pom.cases.case import read_case
from pom.checking.report_checks import with_report_checks
from pom.replaying.batch import replay_all
from pom.replaying.recorded_runs import RecordedRun, RecordedRuns
from pom.tolerances.own_tables import read_own_table
from pom.tolerances.rows import tolerance_rows

Judged = tuple[list[str], str]


def one_case(b: Bench, name: str, *edits: tuple[str, str], more: str = "", **options) -> Judged:
    """Judge one case with texts replaced, by the final model unless another one is given."""
    model = options.pop("model", b.final)
    evidence = options.pop("evidence", None)
    return judge(Deception([b.case(name, *edits, more=more, **options)], model, evidence))


def changed_record(b: Bench, name: str, change: Callable, **options) -> Judged:
    return one_case(b, name, record=b.record(name, change), **options)


# Facts and conditions


def short_period_without_input(b: Bench) -> Judged:
    """The window of a short period ends before the elevator moves."""
    return one_case(b, "21", ("window = [4.5, 16.5]", "window = [0.5, 5.2]"))


def roll_response_without_input(b: Bench) -> Judged:
    """The window of a roll response ends before the ailerons move."""
    (source,) = CASES.glob("22_*.toml")
    window = re.search(r"^window = \[[^\]]*\]", source.read_text(encoding="utf-8"), re.M).group()
    return one_case(b, "22", (window, "window = [0.5, 4.8]"))


def gear_change_without_gear(b: Bench) -> Judged:
    """The record of a flap change shows a gear change."""
    return one_case(b, "29", ('id = "2.c.2"', 'id = "2.c.4"'))


def speedbrake_change_without_speedbrake(b: Bench) -> Judged:
    """The record of a gear change shows a change of the speed brake."""
    return one_case(b, "30", ('id = "2.c.4"', 'id = "2.c.3"'))


def rudder_response_without_rudder(b: Bench) -> Judged:
    """A record in which the rudder rests shows a rudder response."""
    edits = (('id = "2.c.2"', 'id = "2.d.6"'), ("window = [0.5, 20.4]", "window = [0.5, 12.0]"))
    return one_case(b, "29", *edits)


def row_without_its_parameter(b: Bench) -> Judged:
    """The aircraft file states that the aeroplane has no load factor, of which the row fails."""
    craft = b.aircraft(('without = ["spoiler"', 'without = ["normal_acceleration", "spoiler"'))
    return one_case(b, "21", (NAMED, craft), model=b.spoilt(CL__basic=0.6))


def forces_without_a_column(b: Bench) -> Judged:
    """The aircraft file states that the aeroplane has no column, whose force row is not judged."""
    craft = b.aircraft(('without = ["spoiler"', 'without = ["column_force", "spoiler"'))
    return one_case(b, "56", (NAMED, craft))


def configuration_out_of_sight(b: Bench) -> Judged:
    """Full flaps and gear down in place of cruise, and a name map without flaps and gear."""
    text = (CASES / "21_short_period.toml").read_text(encoding="utf-8")
    line = next(item for item in text.splitlines() if item.startswith("additional"))
    names = b.file("_names.toml")
    kept = []
    for row in (DATA / "names.toml").read_text(encoding="utf-8").splitlines():
        if not row.startswith(("delta_f", "gear")):
            kept.append(row)
    names.write_text("\n".join(kept) + "\n", encoding="utf-8")
    edits = ((line + "\n", ""), ('names = "../names.toml"', f'names = "{names}"'))
    return one_case(b, "21", *edits)


def early_stop(b: Bench) -> Judged:
    """The stop of a rejected take-off is stated before the aeroplane stands."""
    return one_case(b, "71", ("full_stop = 46.0", f"full_stop = {b.draw(36, 39)}"))


def two_editions(b: Bench) -> Judged:
    """One case of a report is judged by another edition of the rule."""
    edition = ('edition = "2014-01-01"', 'edition = "2016-05-31 (Amdt 60-4)"')
    other = ('id = "2.c.10"', 'id = "2.c.11"')
    text = [row["test_id"] for row in tolerance_rows() if "Amdt" in row["edition"]]
    test = next((item for item in text if item.startswith("2.")), text[0])
    other = ('id = "2.c.10"', f'id = "{test}"')
    return judge(Deception([b.case("22"), b.case("21", edition, other)], b.final))


# Departures


def share_of_the_flight(b: Bench) -> Judged:
    """A percentage of the flight value that is wider than the printed width."""
    more = f'[tolerance]\npitch_rate = {{ abs = "2 deg/s", percent = {b.draw(60, 90)} }}'
    return one_case(b, "21", more=more, model=b.spoilt(Cm__qhat=0.4))


def alternative_of_a_row(b: Bench) -> Judged:
    """The load factor becomes an alternative of the pitch rate, with its printed width."""
    more = '[tolerance]\nnormal_acceleration = { abs = "0.1 g", group = "pitch" }'
    return one_case(b, "21", more=more, model=b.spoilt(CL__basic=0.6))


def wide_trim(b: Bench) -> Judged:
    """Wide limits of the trim bias, which takes up a wrong drag."""
    more = 'trim = true\nlimits = { thrust = "20000 N", delta_e = "20 deg" }'
    return one_case(b, "30", ("trim = true", more), model=b.spoilt(CD__basic=1.5))


def without_a_trim(b: Bench) -> Judged:
    """No trim: the model starts as recorded, and a wrong pitching moment is not seen there."""
    return one_case(b, "21", ("trim = true", "trim = false"))


def name_table_of_the_answer(b: Bench) -> Judged:
    """A table of names scales the pitch rate of a model with too much of it."""
    names = b.file("_model.toml")
    names.write_text('[outputs]\nq = { variable = "q", scale = 0.8 }\n', encoding="utf-8")
    more = f'[models]\n{RUN} = "{names}"'
    return one_case(b, "21", more=more)


def name_map_of_the_elevator(b: Bench) -> Judged:
    """A name map scales the recorded elevator."""
    text = (DATA / "names.toml").read_text(encoding="utf-8")
    names = b.file("_names.toml")
    new = 'delta_e = { column = "delta_e", scale = 1.15 }'
    names.write_text(text.replace('delta_e = "delta_e"', new), encoding="utf-8")
    return one_case(b, "21", ('names = "../names.toml"', f'names = "{names}"'))


def raised_runway(b: Bench) -> Judged:
    """A runway that lies where the model needs it."""
    return one_case(b, "31", (LAT, f'{LAT}\nrunway_elevation = "{b.draw(4, 9)} m"'))


def wet_runway(b: Bench) -> Judged:
    """A wet runway for a model whose brakes are too strong."""
    return one_case(b, "71", ('trim = "ground"', 'trim = "ground"\nrunway = "wet"'))


def row_taken_out_of_a_table(b: Bench) -> Judged:
    """A tolerance table under the name of the regulation without the row that fails."""
    path = b.file(".csv")
    rows = []
    for row in tolerance_rows():
        if (row["test_id"], row["parameter"]) != ("2.c.10", "normal_acceleration"):
            rows.append(row)
    write_table(path, rows)
    read = read_case(b.case("21"), read_own_table(path))
    return stated(with_report_checks(replay_all([read], {RUN: b.spoilt(CL__basic=0.6)}, jobs=1)))


def window_of_a_table(b: Bench) -> Judged:
    """A tolerance table under the name of the regulation that judges a part of the motion."""
    path = b.file(".csv")
    rows = [dict(row) for row in tolerance_rows()]
    for row in rows:
        if row["test_id"] == "2.d.4":
            row["applies_to"] = "release+3s"
    write_table(path, rows)
    read = read_case(b.case("28"), read_own_table(path))
    return stated(with_report_checks(replay_all([read], {RUN: b.final}, jobs=1)))


def write_table(path: Path, rows: list) -> None:
    lines = [",".join(rows[0])]
    for row in rows:
        cells = ['"' + str(value).replace('"', '""') + '"' for value in row.values()]
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


# Models and records


def _leaking_case(b: Bench) -> Path:
    """A short period from a record that identified the model."""
    (record,) = (DATA / "flight").glob("t37_03_*.nc")
    edit = ("window = [4.5, 16.5]", "window = [5.0, 20.0]")
    return b.case("21", edit, record=record)


def _compiled(b: Bench, database: xr.DataTree) -> Path:
    path = b.file(".fmu")
    aircraft = flightmech.read_aircraft(b.demo / "final.toml")
    flightmech.write_fmu(flightmech.compile(aircraft, database), path)
    return path


def removed_samples(b: Bench) -> Judged:
    """The samples that identified a database are removed from it before it is compiled."""
    database = aerodb.open(b.demo / "final.nc")
    del database.attrs[FLOWN_SAMPLES]
    return judge(Deception([_leaking_case(b)], _compiled(b, database)))


def removed_origin(b: Bench) -> Judged:
    """The same, and the history that states the fits is removed, too."""
    database = aerodb.open(b.demo / "final.nc")
    for name in (FLOWN_SAMPLES, "history"):
        database.attrs.pop(name, None)
    return judge(Deception([_leaking_case(b)], _compiled(b, database)))


def slowed_record(b: Bench) -> Judged:
    """A record that identified the model, on a clock that runs two percent slow."""
    (source,) = (DATA / "flight").glob("t37_03_*.nc")
    tree = xr.open_datatree(source, engine="h5netcdf").load()
    for node in tree.subtree:
        item = node.to_dataset()
        for dim in list(item.dims):
            if dim in item.coords:
                item = item.assign_coords({dim: 1.02 * item[dim]})
        node.dataset = item
    path = b.file(".nc")
    tree.to_netcdf(path, engine="h5netcdf")
    edit = ("window = [4.5, 16.5]", "window = [5.1, 20.4]")
    return judge(Deception([b.case("21", edit, record=path)], b.final))


def uncertain_evidence(b: Bench) -> Judged:
    """Evidence whose standard errors are thirty times as large."""
    evidence = aerodb.open(b.demo / "final.nc")
    leaves = {}
    for name, leaf in aerodb.terms(evidence).items():
        if "stderr" in leaf:
            leaves[name] = leaf.assign(stderr=30.0 * leaf["stderr"])
    evidence = aerodb.replace_terms(evidence, leaves)
    model = b.spoilt(Cm__qhat=0.6, Cm__elevator=0.9)
    return one_case(b, "21", model=model, evidence=evidence)


def evidence_without_the_term(b: Bench) -> Judged:
    """Evidence from which the terms are removed that are wrong in the model."""
    evidence = aerodb.open(b.demo / "final.nc").copy()
    for name in ("Cm/qhat", "Cm/elevator"):
        del evidence[f"terms/{name}" if f"terms/{name}" in evidence else name]
    model = b.spoilt(Cm__qhat=0.7, Cm__elevator=0.93)
    return one_case(b, "21", model=model, evidence=evidence)


def forged_channels(b: Bench) -> Judged:
    """The judged channels of the record are those of a wrong model, with noise."""
    model = b.spoilt(Cm__qhat=0.4)
    answer, time = _answer(b, "21", model)
    names = {"q": "q", "theta": "theta"}

    def change(channel, clock, values):
        if channel not in names:
            return None
        inside = (clock >= time[0]) & (clock <= time[-1])
        forged = values.copy()
        noise = b.rng.normal(0.0, 0.0005, int(inside.sum()))
        forged[inside] = np.interp(clock[inside], time, answer[names[channel]]) + noise
        return forged

    return changed_record(b, "21", change, model=model)


def _answer(b: Bench, name: str, model: Path) -> tuple[Outputs, np.ndarray]:
    (result,) = replay_all([read_case(b.case(name))], {RUN: model}, jobs=1)
    traces = result.signals.sel(run=RUN)
    answer = {str(key): item.values for key, item in traces.data_vars.items()}
    return answer, result.signals["time"].values


def late_rudder(b: Bench) -> Judged:
    return changed_record(b, "27", shifted(("delta_r",), b.sign() * b.draw(0.15, 0.25)))


def wrong_ailerons(b: Bench) -> Judged:
    factor = b.draw(1.15, 1.22)
    names = ("delta_a_left", "delta_a_right")
    return changed_record(
        b, "22", lambda channel, clock, values: values * factor if channel in names else None
    )


def cut_record(b: Bench) -> Judged:
    """A part of the record in which the model is bad is cut out, and the clock closed."""
    (source,) = (DATA / "flight").glob("t37_21_*.nc")
    tree = xr.open_datatree(source, engine="h5netcdf").load()
    for node in tree.subtree:
        item = node.to_dataset()
        for dim in list(item.dims):
            if dim in item.coords:
                clock = item[dim].values
                item = item.isel({dim: (clock < 8.0) | (clock >= 8.6)})
                clock = item[dim].values
                item = item.assign_coords({dim: np.where(clock >= 8.6, clock - 0.6, clock)})
        node.dataset = item
    path = b.file(".nc")
    tree.to_netcdf(path, engine="h5netcdf")
    return one_case(b, "21", ("16.5]", "15.9]"), record=path)


def device_with_other_inputs(b: Bench) -> Judged:
    """A device that was flown by other controls than the flight."""
    case, run = recorded_runs(b, "21", lambda traces: traces)
    (flown,) = replay_all([case], {RUN: b.final}, jobs=1)
    channels = {}
    time = flown.signals["time"].values
    for name in map(str, flown.signals.data_vars):
        channels[name] = (time, flown.signals[name].sel(run=RUN).values)
    clock, elevator = run.channels["delta_e"]
    channels["delta_e"] = (clock, 1.3 * (elevator - elevator[0]) + elevator[0])
    line = RecordedRun(channels, "device.csv, recording, sha256 0", "recording of a device")
    recorded = {case.name: RecordedRuns({RUN: line})}
    return stated(replay_all([case], {}, recorded=recorded, jobs=1))


DECEPTIONS = (
    (1, short_period_without_input, "does not move|no input"),
    (1, roll_response_without_input, "does not move|no input"),
    (1, gear_change_without_gear, "gear does not move"),
    (1, speedbrake_change_without_speedbrake, "speed ?brake does not move|does not move"),
    (1, rudder_response_without_rudder, "rudder"),
    (1, row_without_its_parameter, "without|normal_acceleration"),
    (1, forces_without_a_column, "without|column_force"),
    (1, configuration_out_of_sight, "not recorded|no delta_f|configuration"),
    (1, early_stop, "full_stop|does not stand|stop"),
    (1, two_editions, "edition"),
    (2, share_of_the_flight, "departure: tolerance"),
    (2, alternative_of_a_row, "alternative"),
    (2, wide_trim, "limits_exceeded|trim"),
    (2, without_a_trim, "trim"),
    (2, name_table_of_the_answer, "not driven by its tables|table of names"),
    (2, name_map_of_the_elevator, "times the recorded size|gain"),
    (2, raised_runway, "runway_elevation|runway"),
    (2, wet_runway, "runway"),
    (2, row_taken_out_of_a_table, "in the table of this edition"),
    (2, window_of_a_table, "in the table of this edition"),
    (3, removed_samples, "leak|samples that identified"),
    (3, removed_origin, "leak|samples that identified"),
    (3, slowed_record, "leak"),
    (3, uncertain_evidence, "edited"),
    (3, evidence_without_the_term, "no estimate|not compared|without evidence"),
    (3, forged_channels, "pitch|compat|disagree|record:"),
    (3, late_rudder, "earlier|later|lag"),
    (3, wrong_ailerons, "times the recorded size|aileron"),
    (3, cut_record, "clock|gap|jump|record:"),
    (3, device_with_other_inputs, "input|elevator"),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("demo", type=Path, help="output folder of aeromatch demo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="parts of the names of deceptions, by commas")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(given.demo.resolve(), Path(folder), np.random.default_rng(given.seed))
        trials = []
        for kind, make, word in DECEPTIONS:
            trials.append((f"{kind} {make.__name__}", partial(judge_made, make, bench), word))
        count_named(trials, given.only)


def judge_made(make: Callable[[Bench], Judged], bench: Bench) -> Judged:
    try:
        return make(bench)
    except flightmech.errors.AeromatchError as error:
        return ["refused"], str(error)


if __name__ == "__main__":
    main()
