"""Which manoeuvres identify and which prove: fits and test points from the manoeuvres of the
records.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from flightmech.errors import AeromatchError
from pom.cases.drafting.draft import init_case

# what a manoeuvre proves: kind and control, the tests of the tolerance table, and the name of the
# case
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
    **{(f"flaps_{way}", "flaps"): ("2.c.2", "flap_change") for way in ("out", "in")},
    **{
        (f"speedbrake_{way}", "speedbrake"): ("2.c.3", "speed_brake_change")
        for way in ("out", "in")
    },
    **{(f"gear_{way}", "gear"): ("2.c.4", "gear_change") for way in ("out", "in")},
    ("throttle_chop", "throttle"): ("1.f.2", "engine_deceleration"),
    ("throttle_slam", "throttle"): ("1.f.1", "engine_acceleration"),
    # marks of the T-37 programme
    ("block", "elevator"): ("2.c.10", "short_period"),
    ("block", "aileron"): ("2.d.2", "roll_response"),
    ("block", "rudder"): ("2.d.6", "rudder_response"),
    ("power_lever", "throttle"): ("2.c.1", "power_change"),
    ("controls_fixed", ""): ("2.d.4", "spiral_stability"),
    ("force_column", "column"): ("2.c.10", "short_period"),
    ("force_wheel", "wheel"): ("2.d.2", "roll_response"),
    ("release_pedal", "pedal"): ("2.d.7", "dutch_roll"),
}
_OF_ENGINE = ("1.f.1", "1.f.2")  # the speed of the engine is judged
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
_DROPPED = "unknown"
_SURFACES = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}
_LEAD = 1.5  # s of steady flight before a manoeuvre that the case may use
_CHANGE_LEAD = 6.0  # s before a change of power or configuration: its rows begin 5 s before it
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
    """A case file: its name, the test, the record and what it replays."""

    file: str
    test: str
    record: str
    window: tuple[float, float]


def held_for_proof(
    tables: Mapping[str, pd.DataFrame], prove: Sequence[str], with_engine: Collection[str]
) -> list[CaseDraft]:
    """Return the manoeuvres that prove the model: all that fit a test in the records `prove`;
    without them the last of each test.

    A test of which there is one manoeuvre only is left to the identification.  Tests of the engine
    need one of the records `with_engine`, in which the speed of an engine is recorded.
    """
    by_test: dict[str, list[tuple[str, str, float, float]]] = {}
    for record, table in tables.items():
        for row in table.to_dict("records"):
            test = _TESTS.get((str(row["manoeuvre"]), str(row["control"])))
            if (
                test is not None
                and (not prove or record in prove)
                and (test[0] not in _OF_ENGINE or record in with_engine)
            ):
                by_test.setdefault(test[0], []).append(
                    (test[1], record, float(row["start"]), float(row["end"]))
                )
    chosen = []
    for number_of_test, rows in by_test.items():
        taken = rows if prove else rows[-1:] if len(rows) > 1 else []
        for number, (word, record, start, end) in enumerate(taken, 1):
            name = word if len(taken) == 1 else f"{word}_{number}"
            lead = _CHANGE_LEAD if number_of_test in _CHANGES else _LEAD
            chosen.append(CaseDraft(f"{name}.toml", number_of_test, record, (start - lead, end)))
    return chosen


def written_cases(
    chosen: Sequence[CaseDraft],
    records: Mapping[str, Path],
    folder: Path,
    names: Path | None,
    aircraft: Path,
    remarks: list[str],
) -> dict[str, tuple[float, float]]:
    """Write the case files, as `aeromatch pom init` does, and return record and window of each by
    file name.
    """
    windows = {}
    for case in chosen:
        try:
            made, left = init_case(
                records[case.record],
                case.test,
                folder / case.file,
                names=names,
                aircraft=aircraft,
                window=case.window,
                name=Path(case.file).stem,
                force=True,
            )
        except AeromatchError as error:
            remarks.append(
                f"no case for {case.test} from {case.record}: {' '.join(str(error).split())}"
            )
            continue
        windows[case.file] = made.window
        remarks += [f"{case.file}: {text}" for text in left]
    return windows


def fits_of(
    tables: Mapping[str, pd.DataFrame],
    taken: Mapping[str, Sequence[tuple[float, float]]],
    channels: set[str],
    own: set[str],
) -> list[FitDraft]:
    """Return the fits of the manoeuvres outside the windows of the cases.

    Parameters
    ----------
    tables : mapping of str to DataFrame
        Manoeuvres by record.
    taken : mapping of str to sequence of (start, end)
        By record, what the cases replay. [s]
    channels : set of str
        All channels of the records.
    own : set of str
        Records of which nothing identifies.
    """
    fits: list[FitDraft] = []
    for axis, controls in _AXES.items():
        grouped: dict[tuple[str, ...], list[str]] = {}
        for record, table in tables.items():
            if record in own:
                continue
            rows = [row for row in table.to_dict("records") if _identifies(row, axis, controls)]
            free = [row for row in rows if not _overlap(row, taken.get(record, ()))]
            names = tuple(dict.fromkeys(_name(row) for row in free))
            if free and len(free) == sum(_name(row) in names for row in rows):
                grouped.setdefault(names, []).append(record)
            elif free:
                windows = tuple((float(row["start"]), float(row["end"])) for row in free)
                fits.append(
                    FitDraft(
                        f"{axis}, {record}", (record,), (), windows, _models(axis, free, channels)
                    )
                )
        for names, records in grouped.items():
            moved: list[Mapping[Any, Any]] = [{"control": name.partition(" ")[2]} for name in names]
            name = (
                axis
                if len(grouped) == 1
                else f"{axis}, {records[0]}{' and others' if len(records) > 1 else ''}"
            )
            fits.append(FitDraft(name, tuple(records), names, (), _models(axis, moved, channels)))
    return fits


def _identifies(row: Mapping[Any, Any], axis: str, controls: set[str]) -> bool:
    kind, moved = str(row["manoeuvre"]), set(str(row["control"]).split())
    if kind not in _IDENTIFYING:
        return False
    return bool(moved & controls) or (kind == "pull_up_push_down" and axis == "pitch")


def _name(row: Mapping[Any, Any]) -> str:
    return f"{row['manoeuvre']} {row['control']}".strip()


def _overlap(row: Mapping[Any, Any], taken: Sequence[tuple[float, float]]) -> bool:
    return any(float(row["start"]) < end and start < float(row["end"]) for start, end in taken)


def _models(axis: str, rows: Sequence[Mapping[Any, Any]], channels: set[str]) -> tuple[str, ...]:
    """Return local models of an axis with the controls that moved and are recorded."""
    moved = {word for row in rows for word in str(row["control"]).split()}
    known = [
        surface
        for word, surface in _SURFACES.items()
        if word in moved and _recorded(surface, channels)
    ]
    if axis == "pitch":
        elevator = " + delta_e" if "delta_e" in known else ""
        return tuple(
            f"{name} = 1 + alpha{' + alpha**2' if name == 'CD' else ' + qhat'}{elevator}"
            for name in ("CL", "CD", "Cm")
        )
    rudder = " + delta_r" if "delta_r" in known else ""
    aileron = " + delta_a" if "delta_a" in known else ""
    return (
        f"CY = 1 + beta + phat + rhat{rudder}",
        *(f"{name} = 1 + beta + phat + rhat{aileron}{rudder}" for name in ("Cl", "Cn")),
    )


def _recorded(surface: str, channels: set[str]) -> bool:
    return surface in channels or f"{surface}_left" in channels


def without_unknown(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table of found manoeuvres without the movements that are none."""
    return table[table["manoeuvre"] != _DROPPED].reset_index(drop=True)
