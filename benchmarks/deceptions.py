"""Thirty deceptions of an evaluator, and the word of the program that names each.

    aeromatch demo -o out/t37
    python benchmarks/deceptions.py out/t37

Every deception is a case, a record, an aircraft file or a model that looks like an honest one and
would prove too much: ten on facts and conditions, ten on departures, ten on models and records.
Sizes are drawn from a seed.  It is named if its word stands in the notices, in the status, or in
the refusal.  Printed: a line each, then the false alarms on the honest cases they are made of.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.ndimage import gaussian_filter1d

import aerodb
import flightmech
from flightmech.errors import AeromatchError
from pom.cases.case import read_case
from pom.checking.batch_check import check_batch
from pom.checking.case_check import with_record_checks
from pom.checking.report_checks import with_report_checks
from pom.fmu.models import Models
from pom.probing import model_probes
from pom.replaying import batch, replay_case
from pom.replaying.batch import replay_all
from pom.result_notices import run_notices

DATA = Path(__file__).parents[1] / "data" / "t37"
CASES = DATA / "cases"
RUN = "m"

Outputs = dict[str, np.ndarray]


@dataclass
class Deception:
    """What is judged: case files, a model, and what the answers of the model become.

    Attributes
    ----------
    cases : list of path
    model : path
    evidence : DataTree or None
    answer : callable or None
        (honest outputs of the record, honest outputs of this flight, traces of the record) to the
        outputs of the model.
    """

    cases: list[Path]
    model: Path
    evidence: xr.DataTree | None = None
    answer: Callable[[Outputs, Outputs, Outputs], Outputs] | None = None


@dataclass
class Bench:
    """Folder of the demo, folder of the deceptions, and their seed."""

    demo: Path
    folder: Path
    rng: np.random.Generator
    count: int = 0
    models: dict[str, Path] = field(default_factory=dict)

    def file(self, suffix: str) -> Path:
        self.count += 1
        return self.folder / f"d{self.count:03}{suffix}"

    def case(
        self, name: str, *edits: tuple[str, str], more: str = "", record: Path | None = None
    ) -> Path:
        """Write a copy of a shipped case with texts replaced and lines added."""
        (source,) = CASES.glob(f"{name}_*.toml")
        text = source.read_text(encoding="utf-8")
        if record is not None:
            text = re.sub(r"^record = .*$", f'record = "{record}"', text, flags=re.M)
        for old, new in edits:
            if old not in text:
                raise ValueError(f"{old!r} is not in {source.name}")
            text = text.replace(old, new, 1)
        text = text.replace('"../', f'"{DATA}/').replace('"drives/', f'"{CASES}/drives/')
        path = self.file(".toml")
        path.write_text(f"{text}\n{more}\n", encoding="utf-8")
        return path

    def aircraft(self, *edits: tuple[str, str], circuits: bool = True) -> str:
        """Write a copy of the aircraft file and return the text that puts it into a case."""
        text = (DATA / "aircraft.toml").read_text(encoding="utf-8")
        for old, new in edits:
            if old not in text:
                raise ValueError(f"{old!r} is not in the aircraft file")
            text = text.replace(old, new, 1)
        if not circuits:
            text = re.sub(r"^\[circuit\.\w+\]\n(?:[^\[\n].*\n|\n)*", "", text, flags=re.M)
        path = self.file("_aircraft.toml")
        path.write_text(text.replace('"engine.nc"', f'"{DATA}/engine.nc"'), encoding="utf-8")
        return f'aircraft = "{path}"'

    def record(self, name: str, change: Callable[[str, np.ndarray, np.ndarray], Any]) -> Path:
        """Write a copy of a record; `change` returns the new values of a channel or None."""
        (source,) = (DATA / "flight").glob(f"t37_{name}_*.nc")
        tree = xr.open_datatree(source, engine="h5netcdf").load()
        for node in tree.subtree:
            item = node.to_dataset().copy()
            for channel in list(item.data_vars):
                old = item[channel]
                if old.dims and old.dtype.kind == "f":
                    clock = item[old.dims[0]].values.astype(float)
                    new = change(str(channel), clock, old.values.astype(float))
                    if new is not None:
                        item[channel] = (old.dims, new, old.attrs)
            node.dataset = item
        path = self.file(".nc")
        tree.to_netcdf(path, engine="h5netcdf")
        return path

    def window_of(self, name: str, start: float, stop: float, late: float) -> Path:
        """Write a part of a record on a clock of its own: a trimmed copy under another name."""
        (source,) = (DATA / "flight").glob(f"t37_{name}_*.nc")
        tree = xr.open_datatree(source, engine="h5netcdf").load()
        for node in tree.subtree:
            item = node.to_dataset()
            for dim in list(item.dims):
                if dim in item.coords:
                    clock = item[dim].values
                    item = item.isel({dim: (clock >= start) & (clock <= stop)})
                    item = item.assign_coords({dim: item[dim] + late})
            node.dataset = item
        path = self.file(".nc")
        tree.to_netcdf(path, engine="h5netcdf")
        return path

    @property
    def final(self) -> Path:
        return self.demo / "final.fmu"

    def spoilt(self, craft: Callable[[Any], Any] | None = None, **factors: float) -> Path:
        """Write the final model with terms scaled (``Cm__qhat=0.4``) and its aircraft changed."""
        database = aerodb.open(self.demo / "final.nc")
        for term, factor in factors.items():
            database = aerodb.edit.scale(database, term.replace("__", "/"), factor, note="spoiled")
        aircraft = flightmech.read_aircraft(self.demo / "final.toml")
        if craft is not None:
            aircraft = craft(aircraft)
        path = self.file(".fmu")
        aerodb.save(database, path.with_suffix(".nc"))
        flightmech.write_fmu(flightmech.compile(aircraft, database), path)
        return path

    def draw(self, least: float, most: float) -> float:
        return round(float(self.rng.uniform(least, most)), 3)

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))


def scaled(name: str, factor: float):
    return lambda channel, clock, values: values * factor if channel == name else None


def shifted(names: tuple[str, ...], late: float):
    def change(channel, clock, values):
        return np.interp(clock - late, clock, values) if channel in names else None

    return change


NAMED = 'aircraft = "../aircraft.toml"'
FACT = "reversible_controls = true"
LAT = 'lat = "45 deg"'


# Facts and conditions


def denied_controls(b: Bench) -> Deception:
    """The aircraft file denies reversible controls and keeps its circuits."""
    craft = b.aircraft((FACT, "reversible_controls = false"))
    return Deception([b.case("25", (NAMED, craft))], b.final)


def removed_circuits(b: Bench) -> Deception:
    """The same, with the circuits removed: the model still has the hinge moments."""
    craft = b.aircraft((FACT, "reversible_controls = false"), circuits=False)
    return Deception([b.case("22", (NAMED, craft))], b.final)


def silent_controls(b: Bench) -> Deception:
    """The aircraft file does not state whether the controls are reversible."""
    craft = b.aircraft((FACT + "\n", ""))
    return Deception([b.case("22", (NAMED, craft))], b.final)


def two_aircraft_files(b: Bench) -> Deception:
    """One case of a report denies what another one claims."""
    craft = b.aircraft((FACT, "reversible_controls = false"), circuits=False)
    return Deception([b.case("22", (NAMED, craft)), b.case("54")], b.final)


def light_largest_weight(b: Bench) -> Deception:
    """The largest take-off weight is lowered, so that the flown mass is near it."""
    craft = b.aircraft(('mtow = "6600 lb"', f'mtow = "{b.draw(4400, 4650):.0f} lb"'))
    return Deception([b.case("71", (NAMED, craft))], b.final)


def third_engine(b: Bench) -> Deception:
    """A case states other engines than the aircraft."""
    return Deception([b.case("26", more="[facts]\nengines = 4")], b.final)


def band_of_its_own(b: Bench) -> Deception:
    """A wide band of the case file stands in for an official row that has no value."""
    edit = ('"2 deg/s"', f'"{b.draw(4, 8)} deg/s"')
    return Deception([b.case("72", edit)], b.final)


def brake_of_one_side(b: Bench) -> Deception:
    """A model that leaves the runway; distance and time are right."""
    factor = b.draw(1.05, 1.08)

    def craft(aircraft):
        contacts = []
        for item in aircraft.gear.contacts:
            part = {"left": factor, "right": 2.0 - factor}.get(item.name, 1.0)
            contacts.append(replace(item, brake_friction=item.brake_friction * part))
        gear = replace(aircraft.gear, contacts=tuple(contacts))
        return replace(aircraft, gear=gear)

    return Deception([b.case("71")], b.spoilt(craft))


def other_configuration(b: Bench) -> Deception:
    """Flaps full and gear down in place of cruise, without the word that the case is additional."""
    text = (CASES / "21_short_period.toml").read_text(encoding="utf-8")
    line = next(item for item in text.splitlines() if item.startswith("additional"))
    return Deception([b.case("21", (line + "\n", ""))], b.final)


def computer_controls(b: Bench) -> Deception:
    """A condition of computer-controlled aeroplanes is claimed."""
    more = 'id = "2.h.5"\nfeatures = ["computer_controlled_airplane"]'
    return Deception([b.case("22", ('id = "2.d.2"', more))], b.final)


# Departures


def wide_tolerance(b: Bench) -> Deception:
    more = f'[tolerance]\npitch_angle = "{b.draw(2, 9)} deg"\nnormal_acceleration = "0.5 g"'
    return Deception([b.case("21", more=more)], b.spoilt(Cm__qhat=0.4))


def narrow_window(b: Bench) -> Deception:
    stop = b.draw(5.6, 6.0)
    more = (
        f'[tolerance]\nnormal_acceleration = {{ abs = "0.1 g", window = [4.6, {stop}] }}\n'
        f'pitch_angle = {{ abs = "1.5 deg", window = [4.6, {stop}] }}'
    )
    return Deception([b.case("21", more=more)], b.spoilt(Cm__qhat=0.4))


def short_record(b: Bench) -> Deception:
    edit = ("window = [0.5, 20.4]", f"window = [4.5, {b.draw(9, 12)}]")
    return Deception([b.case("29", edit)], b.final)


def rationale_of_a_word(b: Bench) -> Deception:
    more = '[rationale]\n"trim.thrust" = "ok"'
    return Deception([b.case("30", more=more)], b.spoilt(CD__basic=b.draw(1.3, 1.5)))


def mass_of_the_case(b: Bench) -> Deception:
    mass = 2099.5 * (1.0 + b.sign() * b.draw(0.02, 0.04))
    return Deception([b.case("21", (LAT, f"{LAT}\nmass = {mass:.1f}"))], b.final)


def centre_of_gravity(b: Bench) -> Deception:
    edit = (LAT, f"{LAT}\nx_cg_b = {b.sign() * b.draw(0.02, 0.05)}")
    return Deception([b.case("21", edit)], b.final)


def start_of_the_case(b: Bench) -> Deception:
    edit = (LAT, f'{LAT}\nV = "{b.draw(55.5, 56.5)} m/s"')
    return Deception([b.case("21", edit)], b.final)


def one_flight_two_titles(b: Bench) -> Deception:
    """One flight shows a test twice, the second time in a slightly other window."""
    first = b.case("27")
    edits = (
        ('name = "dutch_roll"', 'name = "dutch_roll_2"'),
        ("Dutch roll, clean", "Dutch roll, approach"),
        ("window = [5.5, 28.2]", f"window = [5.5, {b.draw(24, 28)}]"),
    )
    return Deception([first, b.case("27", *edits)], b.final)


def one_flight_two_records(b: Bench) -> Deception:
    """The same with a trimmed copy of the record on another clock."""
    late = b.draw(50, 150)
    start = 5.5 + late
    edits = (
        ('name = "dutch_roll"', 'name = "dutch_roll_2"'),
        ("window = [5.5, 28.2]", f"window = [{start:.3f}, {start + 20.0:.3f}]"),
        ("input_end = 8.6", f"input_end = {8.6 + late:.3f}"),
    )
    record = b.window_of("27", 1.0, 28.4, late)
    return Deception([b.case("27"), b.case("27", *edits, record=record)], b.final)


def other_mode_channel(b: Bench) -> Deception:
    edit = ('title = "Dutch roll, clean"', 'title = "Dutch roll"\nmode_channel = "beta"')
    return Deception([b.case("27", edit)], b.final)


# Models and records


def wrong_mass(b: Bench) -> Deception:
    factor = 1.0 + b.sign() * b.draw(0.055, 0.08)
    return Deception([b.case("21", record=b.record("21", scaled("mass", factor)))], b.final)


def wrong_mass_of_one_record(b: Bench) -> Deception:
    """One record of four; the vane of a phugoid is known to less than the mass error."""
    factor = 1.0 + b.draw(0.06, 0.08)
    late = b.case("26", record=b.record("26", scaled("mass", factor)))
    return Deception([b.case("21"), b.case("32"), b.case("30"), late], b.final)


def warm_air(b: Bench) -> Deception:
    """Outside air too warm, with the true airspeed that follows from it."""
    more = b.draw(20, 30)

    def change(channel, clock, values):
        if channel == "temperature":
            return values + more
        if channel == "V_tas":
            return values * np.sqrt((281.0 + more) / 281.0)
        return None

    return Deception([b.case("21", record=b.record("21", change))], b.final)


def warm_air_of_one_record(b: Bench) -> Deception:
    """The same by 12 to 15 K only, among records of one day."""
    more = b.draw(-15, -12)

    def change(channel, clock, values):
        if channel == "temperature":
            return values + more
        if channel == "V_tas":
            return values * np.sqrt((281.0 + more) / 281.0)
        return None

    late = b.case("27", record=b.record("27", change))
    return Deception([b.case("21"), b.case("26"), b.case("30"), late], b.final)


def late_elevator(b: Bench) -> Deception:
    late = b.draw(0.15, 0.25)
    return Deception([b.case("21", record=b.record("21", shifted(("delta_e",), late)))], b.final)


def wrong_pick_up(b: Bench) -> Deception:
    factor = b.draw(1.13, 1.2)
    return Deception([b.case("21", record=b.record("21", scaled("delta_e", factor)))], b.final)


def record_that_identified(b: Bench) -> Deception:
    """A part of a record that identified the model, on another clock and under another name."""
    late = b.draw(100, 200)
    record = b.window_of("03", 0.0, 60.0, late)
    edits = (("window = [4.5, 16.5]", f"window = [{late + 5:.3f}, {late + 20:.3f}]"),)
    return Deception([b.case("21", *edits, record=record)], b.final)


def stored_answer(b: Bench) -> Deception:
    """The smoothed flight in place of an answer: no noise of the record is in it."""

    def answer(honest, own, flight):
        stored = {name: gaussian_filter1d(values, 12.0) for name, values in flight.items()}
        return {name: stored.get(name, values) for name, values in own.items()}

    return Deception([b.case("26")], b.final, answer=answer)


def guided_answer(b: Bench) -> Deception:
    """A model whose error about the record, smoothed, is taken off: it follows its inputs."""

    def answer(honest, own, flight):
        out = dict(own)
        for name, values in own.items():
            if name in flight and name in honest:
                out[name] = values + gaussian_filter1d(flight[name] - honest[name], 12.0)
        return out

    return Deception([b.case("26")], b.spoilt(Cm__qhat=0.5), answer=answer)


def compensating_pair(b: Bench) -> Deception:
    """Two wrong terms that compensate each other, with the edited database as its own evidence."""
    model = b.spoilt(Cm__qhat=0.4, Cm__elevator=0.75)
    evidence = aerodb.open(model.with_suffix(".nc"))
    return Deception([b.case("21")], model, evidence=evidence)


# kind, deception, word
DECEPTIONS = (
    (1, denied_controls, "reversible_controls"),
    (1, removed_circuits, "reversible_controls"),
    (1, silent_controls, "reversible"),
    (1, two_aircraft_files, "reversible_controls"),
    (1, light_largest_weight, "mtow|take-off mass"),
    (1, third_engine, "engines"),
    (1, band_of_its_own, "invalid"),
    (1, brake_of_one_side, "flown track|heading"),
    (1, other_configuration, "flaps|gear at"),
    (1, computer_controls, "computer_controlled"),
    (2, wide_tolerance, "times as wide"),
    (2, narrow_window, "is judged in"),
    (2, short_record, "called short"),
    (2, rationale_of_a_word, "limits_exceeded|rationale|trim"),
    (2, mass_of_the_case, "mass"),
    (2, centre_of_gravity, "x_cg_b"),
    (2, start_of_the_case, "by the conditions of the case"),
    (2, one_flight_two_titles, "the same flight"),
    (2, one_flight_two_records, "the same flight"),
    (2, other_mode_channel, "mode_channel"),
    (3, wrong_mass, "mass"),
    (3, wrong_mass_of_one_record, "mass"),
    (3, warm_air, "temperature"),
    (3, warm_air_of_one_record, "temperature"),
    (3, late_elevator, "earlier|later|lag"),
    (3, wrong_pick_up, "times the recorded size"),
    (3, record_that_identified, "leak"),
    (3, stored_answer, "not driven"),
    (3, guided_answer, "noise of the record"),
    (3, compensating_pair, "edited|evidence"),
)
HONEST = ("21", "22", "23", "26", "27", "28", "29", "30", "32", "53", "54", "55", "56")


def judge(item: Deception) -> tuple[list[str], str]:
    """Return the statuses of the cases, and all that the program states with them."""
    undo = put_answer(item.answer) if item.answer is not None else lambda: None
    try:
        cases = [read_case(path) for path in item.cases]
        runs = {RUN: item.model}
        checks = check_batch(cases, Models(runs, None))
        results = replay_all(cases, runs, jobs=1, evidence=item.evidence)
        results = with_record_checks(with_report_checks(results), checks)
    except AeromatchError as error:
        return ["refused"], str(error)
    finally:
        undo()
    texts = []
    for result in results:
        notices = [*run_notices(result, RUN)]
        texts += [result.case.name, result.status(RUN), *notices, result.failure]
    return [result.status(RUN) for result in results], "\n".join(texts)


def put_answer(answer: Callable[[Outputs, Outputs, Outputs], Outputs]) -> Callable[[], None]:
    """Put an answer in place of that of the model, in flights and probes; return what undoes it."""
    flown, perform = replay_case.fly_job, replay_case.perform_plan
    seen: dict[str, Any] = {}

    def fly(model, job, names, **options):
        outputs, failure = flown(model, job, names, **options)
        honest = seen.setdefault("honest", outputs)
        return answer(honest, outputs, seen["flight"]), failure

    def plan(plan_, *given, **options):
        seen.clear()
        seen["flight"] = model_probes.flight_traces(plan_.states)
        return perform(plan_, *given, **options)

    agreement, tables = replay_case._table_agreement, model_probes.tables_of
    replay_case.fly_job = model_probes.fly_job = fly
    # Such a model is of another program: it holds no tables.
    replay_case._table_agreement = lambda *given: ()
    model_probes.tables_of = replay_case.tables_of = lambda given: None
    batch.perform_plan = plan

    def undo() -> None:
        replay_case.fly_job = model_probes.fly_job = flown
        replay_case._table_agreement = agreement
        model_probes.tables_of = replay_case.tables_of = tables
        batch.perform_plan = perform

    return undo


def _judge_made(make: Callable[[Bench], Deception], bench: Bench) -> tuple[list[str], str]:
    return judge(make(bench))


def count_named(
    trials: Sequence[tuple[str, Callable[[], tuple[list[str], str]], str]], only: str
) -> None:
    """Run deceptions, and print by which line each is named.

    Parameters
    ----------
    trials : sequence of tuple
        Name; function that returns the statuses and the text of the report; pattern of the line
        that names the deception.
    only : str
        Parts of the names of those to run, by commas.
    """
    parts = only.split(",")
    chosen = [trial for trial in trials if any(map(trial[0].__contains__, parts))]
    named = 0
    for name, run, pattern in chosen:
        start = time.perf_counter()
        statuses, text = run()
        line = next((one for one in text.splitlines() if re.search(pattern, one)), "")
        is_named = re.search(pattern, text) is not None
        named += is_named
        state = "named " if is_named else "SILENT"
        seconds = time.perf_counter() - start
        print(f"{state} {name:30} {', '.join(statuses):40} {seconds:4.0f} s")
        print(f"       {(line or text.replace(chr(10), ' | '))[:300]}", flush=True)
    print(f"{named} of {len(chosen)} named")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("demo", type=Path, help="output folder of aeromatch demo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="parts of the names of deceptions, by commas")
    parser.add_argument("--honest", action="store_true", help="the honest cases alone")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(given.demo.resolve(), Path(folder), np.random.default_rng(given.seed))
        trials = []
        for kind, make, word in DECEPTIONS:
            run = partial(_judge_made, make, bench)
            trials.append((f"{kind} {make.__name__}", run, word))
        if not given.honest:
            count_named(trials, given.only)
        if given.only:
            return
        cases = [next(CASES.glob(f"{name}_*.toml")) for name in HONEST]
        statuses, text = judge(Deception(cases, bench.final))
        print(f"honest cases: {', '.join(statuses)}")
        for line in text.splitlines():
            if "departure:" in line or "record:" in line or "driven" in line:
                print(f"           {line[:160]}")


if __name__ == "__main__":
    main()
