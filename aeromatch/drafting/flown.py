"""Fits and test points of a drafted project, from the manoeuvres of the records."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from aeromatch.drafting.project_files import ProjectFiles
from flightmech.errors import AeromatchError, SchemaError, near_names
from flightmech.quantities import time_text
from pom.cases.case import read_case
from pom.cases.drafting.draft import init_case
from pom.cases.job import ENGINE_DRIVES

# Test of the tolerance table and name of the case, by kind and control of a manoeuvre.
_TESTS = {
    ("3211", "elevator"): ("2.c.10", "short_period"),
    ("doublet", "elevator"): ("2.c.10", "short_period"),
    ("pulse", "elevator"): ("2.c.10", "short_period"),
    ("doublet", "rudder"): ("2.d.7", "dutch_roll"),
    ("3211", "rudder"): ("2.d.7", "dutch_roll"),
    ("pulse", "rudder"): ("2.d.6", "rudder_response"),
    ("doublet", "aileron"): ("2.d.2", "roll_response"),
    ("3211", "aileron"): ("2.d.2", "roll_response"),
    ("pulse", "aileron"): ("2.d.2", "roll_response"),
    ("steady_sideslip", "rudder"): ("2.d.8", "steady_sideslip"),
    ("phugoid", "elevator"): ("2.c.9", "phugoid"),
    ("spiral", "aileron"): ("2.d.4", "spiral_stability"),
    ("power_change", "throttle"): ("2.c.1", "power_change"),
    ("flaps_out", "flaps"): ("2.c.2", "flap_change"),
    ("flaps_in", "flaps"): ("2.c.2", "flap_change"),
    ("speedbrake_out", "speedbrake"): ("2.c.3", "speed_brake_change"),
    ("speedbrake_in", "speedbrake"): ("2.c.3", "speed_brake_change"),
    ("gear_out", "gear"): ("2.c.4", "gear_change"),
    ("gear_in", "gear"): ("2.c.4", "gear_change"),
    ("throttle_chop", "throttle"): ("1.f.2", "engine_deceleration"),
    ("throttle_slam", "throttle"): ("1.f.1", "engine_acceleration"),
    # The T-37 programme marks its manoeuvres by these kinds.
    ("block", "elevator"): ("2.c.10", "short_period"),
    ("block", "aileron"): ("2.d.2", "roll_response"),
    ("block", "rudder"): ("2.d.6", "rudder_response"),
    ("power_lever", "throttle"): ("2.c.1", "power_change"),
    ("controls_fixed", ""): ("2.d.4", "spiral_stability"),
    ("force_column", "column"): ("2.c.10", "short_period"),
    ("force_wheel", "wheel"): ("2.d.2", "roll_response"),
    ("release_pedal", "pedal"): ("2.d.7", "dutch_roll"),
}
# Tests that judge the speed of the engine.
_ENGINE_TESTS = ("1.f.1", "1.f.2")
_AXES = {
    "pitch": {"elevator"},
    "roll and yaw": {"aileron", "rudder"},
}
_IDENTIFYING = (
    "3211",
    "doublet",
    "pulse",
    "sweep",
    "multisine",
    "pull_up_push_down",
    "steady_sideslip",
)
# Least similarity of a misspelled kind and a known one.
_MISSPELLED = 0.8
# Kind of a movement that is not a manoeuvre.
_UNKNOWN = "unknown"
# What a record calls the position of the control that moves a surface.
_HANDS = {"elevator": "column", "aileron": "wheel", "rudder": "pedals"}
_SURFACES = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}
# Steady flight before a manoeuvre that the case includes. [s]
_LEAD = 1.5
# The same before a change of power or configuration, whose rows begin 5 s before it. [s]
_CHANGE_LEAD = 6.0
_CHANGES = ("2.c.1", "2.c.2", "2.c.3", "2.c.4")


@dataclass(frozen=True)
class FitDraft:
    """One ``[[fit]]``: records with the names of their manoeuvres, or windows of one record."""

    name: str
    records: tuple[str, ...]
    manoeuvres: tuple[str, ...]
    windows: tuple[tuple[float, float], ...]
    models: tuple[str, ...]


@dataclass(frozen=True)
class CaseDraft:
    """A case file: its name, the test, the record and the replayed window. [s]"""

    file: str
    test: str
    record: str
    window: tuple[float, float]


def held_for_proof(
    tables: Mapping[str, pd.DataFrame], prove: Sequence[str], with_engine: Collection[str]
) -> list[CaseDraft]:
    """Return the manoeuvres that prove the model.

    These are all manoeuvres of a test in the records `prove`. Without such records they are the
    last manoeuvre of each test, and a single manoeuvre of a test identifies.

    Parameters
    ----------
    tables : mapping of str to DataFrame
        Manoeuvres by record. [s]
    prove : sequence of str
        Records that prove the model.
    with_engine : collection of str
        Records with the speed of an engine, which the tests of the engine require.
    """
    by_test: dict[str, list[tuple[str, str, float, float]]] = {}
    for record, table in tables.items():
        for row in table.to_dict("records"):
            test = _TESTS.get((str(row["manoeuvre"]), str(row["control"])))
            if test is None or (prove and record not in prove):
                continue
            if test[0] in _ENGINE_TESTS and record not in with_engine:
                continue
            manoeuvre = (test[1], record, float(row["start"]), float(row["end"]))
            by_test.setdefault(test[0], []).append(manoeuvre)
    cases = []
    for test_number, manoeuvres in by_test.items():
        proving = manoeuvres
        if not prove:
            # A single manoeuvre is more useful for the identification.
            proving = manoeuvres[-1:] if len(manoeuvres) > 1 else []
        lead = _CHANGE_LEAD if test_number in _CHANGES else _LEAD
        for number, (name, record, start, end) in enumerate(proving, 1):
            if len(proving) > 1:
                name = f"{name}_{number}"
            cases.append(CaseDraft(f"{name}.toml", test_number, record, window=(start - lead, end)))
    return cases


def write_cases(
    chosen: Sequence[CaseDraft],
    records: Mapping[str, Path],
    files: ProjectFiles,
    names: Path | None,
    aircraft: Path,
    drives: Collection[str] | None,
    remarks: list[str],
) -> list[CaseDraft]:
    """Write the case files as `aeromatch pom init` does, and return the cases with a file.

    `drives` has the inputs that can drive the engines of the aircraft, None if not known. Cases
    that cannot be written are a remark for each reason.
    """
    written = []
    refused: dict[str, list[str]] = {}
    for case in chosen:
        if files.is_removed(f"cases/{case.file}"):
            remarks.append(
                f"cases/{case.file}: removed by you, and not drafted again; --force drafts it"
            )
            continue
        # The case is drafted at the depth of its folder, so that its relative paths are right.
        place = files.drafted(f"new_{case.file}")
        try:
            drafted, gaps = init_case(
                records[case.record],
                case.test,
                place,
                names=names,
                aircraft=aircraft,
                window=case.window,
                name=Path(case.file).stem,
                force=True,
            )
            text = place.read_text(encoding="utf-8")
            _demand_drive(drafted.drive.engine, drives)
        except AeromatchError as error:
            # the case is checked under a temporary name
            text = re.sub(
                rf"\S*new_{re.escape(case.file)}[^\s:]*", f"cases/{case.file}", str(error)
            )
            reason = " ".join(text.split())
            refused.setdefault(reason, []).append(f"{case.test} from {case.record}")
            continue
        finally:
            place.unlink(missing_ok=True)
        files.write(f"cases/{case.file}", text)
        written.append(case)
        remarks += [f"{case.file}: {gap}" for gap in gaps]
    for reason, places in refused.items():
        remarks.append(f"no case for {', '.join(places)}: {reason}")
    return written


def _demand_drive(drive: str, drives: Collection[str] | None) -> None:
    """Raise if the engines of the aircraft file do not take the drive of a case."""
    if drive == "none":
        return
    quantity, model_input, _ = ENGINE_DRIVES[drive]
    if drives is None or model_input in drives:
        return
    raise SchemaError(
        "aircraft.toml",
        [
            f"no [[engine]] that engine1.{quantity} can drive; give it what turns it (a propeller, "
            f"a deck, a table of thrust), or map engine1.thrust"
        ],
    )


def describe_unused(
    tables: Mapping[str, pd.DataFrame], taken: Mapping[str, Sequence[tuple[float, float]]]
) -> list[str]:
    """Return a remark for each manoeuvre of a test that neither identifies nor proves.

    `taken` has the windows of the cases, by record [s].  A kind that the author has misspelled has
    the near kinds in its remark.
    """
    known = {*_IDENTIFYING, *(kind for kind, _ in _TESTS)}
    remarks = []
    for record, table in tables.items():
        for row in table.to_dict("records"):
            kind, control = str(row["manoeuvre"]), str(row["control"])
            if kind in _IDENTIFYING or _overlaps(row, taken.get(record, ())):
                continue
            near = near_names(kind, known, cutoff=_MISSPELLED)
            test = _TESTS.get((kind, control))
            remedy = ""
            if kind not in known and near:
                remedy = f"its kind is not known; near it: {', '.join(near)}"
            elif test is not None and test[0] not in _ENGINE_TESTS:
                remedy = f"--prove {record} makes a case of it"
            if remedy:
                name = _manoeuvre_name(row)
                remarks.append(f"{name} of {record} neither identifies nor proves: {remedy}")
    return remarks


def replayed_windows(files: Sequence[Path]) -> dict[str, list[tuple[float, float]]]:
    """Return the windows that case files replay, by record. [s]"""
    windows: dict[str, list[tuple[float, float]]] = {}
    for file in files:
        case = read_case(file)
        windows.setdefault(Path(case.record).stem, []).append(case.window)
    return windows


def fits_of(
    tables: Mapping[str, pd.DataFrame],
    taken: Mapping[str, Sequence[tuple[float, float]]],
    channels: set[str],
    own: Collection[str],
) -> list[FitDraft]:
    """Return the fits of the manoeuvres outside the windows of the cases.

    Parameters
    ----------
    tables : mapping of str to DataFrame
        Manoeuvres by record.
    taken : mapping of str to sequence of (start, end)
        Windows that the cases replay, by record. [s]
    channels : set of str
        All channels of the records.
    own : collection of str
        Records that identify nothing.
    """
    fits: list[FitDraft] = []
    for axis, controls in _AXES.items():
        # Records with the same manoeuvres are one fit.
        grouped: dict[tuple[str, ...], list[str]] = {}
        for record, table in tables.items():
            if record in own:
                continue
            rows = [row for row in table.to_dict("records") if _identifies(row, axis, controls)]
            free = [row for row in rows if not _overlaps(row, taken.get(record, ()))]
            names = tuple(dict.fromkeys(_manoeuvre_name(row) for row in free))
            # The names select exactly the free manoeuvres, or windows have to select them.
            selected = [row for row in rows if _manoeuvre_name(row) in names]
            if free and len(free) == len(selected):
                grouped.setdefault(names, []).append(record)
            elif free:
                fits.append(_window_fit(axis, record, free, channels))
        for names, records in grouped.items():
            name = axis
            if len(grouped) > 1:
                name += f", {records[0]}"
                if len(records) > 1:
                    name += " and others"
            controls_of_fit = [manoeuvre.partition(" ")[2] for manoeuvre in names]
            models = _local_models(axis, controls_of_fit, channels)
            fits.append(FitDraft(name, tuple(records), names, windows=(), models=models))
    return fits


def _window_fit(
    axis: str, record: str, rows: Sequence[Mapping[Any, Any]], channels: set[str]
) -> FitDraft:
    """Return the fit of some manoeuvres of one record, by their windows."""
    return FitDraft(
        name=f"{axis}, {record}",
        records=(record,),
        manoeuvres=(),
        windows=tuple((float(row["start"]), float(row["end"])) for row in rows),
        models=_local_models(axis, [str(row["control"]) for row in rows], channels),
    )


def _identifies(row: Mapping[Any, Any], axis: str, controls: set[str]) -> bool:
    """Return whether a manoeuvre identifies the models of an axis."""
    kind = str(row["manoeuvre"])
    if kind not in _IDENTIFYING:
        return False
    if kind == "pull_up_push_down" and axis == "pitch":
        return True
    return not controls.isdisjoint(str(row["control"]).split())


def _manoeuvre_name(row: Mapping[Any, Any]) -> str:
    return f"{row['manoeuvre']} {row['control']}".strip()


def _overlaps(row: Mapping[Any, Any], spans: Sequence[tuple[float, float]]) -> bool:
    return any(float(row["start"]) < end and start < float(row["end"]) for start, end in spans)


def _local_models(axis: str, controls: Sequence[str], channels: set[str]) -> tuple[str, ...]:
    """Return local models of an axis with the recorded surfaces of the moved controls.

    `controls` has the controls of each manoeuvre, separated by spaces.
    """
    # A surface that does not move, or is not recorded, adds nothing to a model.
    regressors = dict.fromkeys(_SURFACES.values(), "")
    moved = " ".join(controls).split()
    for control, surface in _SURFACES.items():
        is_recorded = surface in channels or f"{surface}_left" in channels
        if control in moved and is_recorded:
            regressors[surface] = f" + {surface}"
    elevator, aileron, rudder = (regressors[name] for name in ("delta_e", "delta_a", "delta_r"))
    if axis == "pitch":
        return (
            f"CL = 1 + alpha + qhat{elevator}",
            f"CD = 1 + alpha + alpha**2{elevator}",
            f"Cm = 1 + alpha + qhat{elevator}",
        )
    return (
        f"CY = 1 + beta + phat + rhat{rudder}",
        f"Cl = 1 + beta + phat + rhat{aileron}{rudder}",
        f"Cn = 1 + beta + phat + rhat{aileron}{rudder}",
    )


def describe_unknown(record: str, found: pd.DataFrame) -> list[str]:
    """Return a remark for each control whose movements are all of unknown kind.

    Parameters
    ----------
    record : str
    found : DataFrame
        Of `find_manoeuvres`.
    """
    known = " ".join(map(str, found["control"][found["manoeuvre"] != _UNKNOWN])).split()
    remarks = []
    for control, hand in _HANDS.items():
        rows = found[(found["manoeuvre"] == _UNKNOWN) & (found["control"] == control)]
        if control in known or rows.empty:
            continue
        first = rows.iloc[0]
        more = f", and in {len(rows) - 1} more places" if len(rows) > 1 else ""
        remarks.append(
            f"{record}: the {control} moves from {time_text(first['start'])} to "
            f"{time_text(first['end'])} s{more}, and no test input was found in it: it does not "
            f"rest around its steps, as with a damper; map the {hand} of the pilot, or write the "
            f"manoeuvres into the table of manoeuvres"
        )
    return remarks


def without_unknown(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table of manoeuvres without the movements of unknown kind."""
    return table[table["manoeuvre"] != _UNKNOWN].reset_index(drop=True)
