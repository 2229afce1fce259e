"""A first name map for recordings: columns by their names, units by file, name or size, less the
mistakes that its check finds.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from aeromatch.drafting.columns import Guess, guess_quantity, stated_unit, unit_from_size
from aeromatch.project.editing import schema_lines
from flightmech.errors import SchemaError, UnitError
from flightmech.names import lookup
from flightmech.units import G0, fitted_unit, known_unit, parse_unit
from flighttest.records.readers.channel_correction import line_of
from flighttest.records.readers.columns import unit_of_column
from flighttest.records.readers.name_map import Channel, Clock, Facts, NameMap
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.readers.opening import FORMATS, open_recording, recognise_recording
from flighttest.records.readers.recording import CLOCK_NAMES, RecordedTable, clock_name
from flighttest.records.record import needs_names

LOGS = {"ulog": "px4", "dataflash": "ardupilot"}
"""Formats whose names are known, and the shipped map."""
_GROUPS = {
    "imu": ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu"),
    "vanes": ("alpha_vane", "beta_vane"),
    "air_data": ("V", "V_cas", "mach", "q_c", "p_static", "temperature", "h_baro", "hdot"),
    "gps": ("vn", "ve", "vd", "h_gps", "lat", "lon", "north", "east", "V_ground"),
    "radio_altimeter": ("h_radio",),
    "mass": ("mass", "x_cg_b", "y_cg_b", "z_cg_b"),
}
_CLOCK_WORDS = ("time", "zeit", "stamp", "utc", "clock", "sec")
_REPAIRED = ("sign", "unit", "axis", "definition")
_ROUNDS, _RECORDS = 4, 4  # of checks, and how many records are checked
_CONFIRM = "CONFIRM"


@dataclass(frozen=True)
class NameMapRow:
    """One line of a name map with the reason for it."""

    leaf: str
    name: str
    channel: Channel
    reason: str = ""


@dataclass(frozen=True)
class NamesDraft:
    """A name map before it is written.

    Attributes
    ----------
    rows : tuple of Row
    clock, clocks : Clock, dict of str to Clock
        Of the file, and of tables with stamps of their own.
    clock_reason : str
    facts : dict
        ``[record]``.
    constants : dict of str to float
        ``[constants]``. [SI]
    extends : str
        A shipped map, empty for none.
    identity : bool
        Whether the files speak canonical names with units, so that no map is needed.
    left_out : tuple of str
        Columns that no quantity was found for.
    remarks : tuple of str
        What the author has to confirm.
    own : NameMap or None
        The author's name map, which is used as it stands.
    file : str
        Its file, or the name of a shipped one.
    """

    rows: tuple[NameMapRow, ...] = ()
    clock: Clock = field(default_factory=Clock)
    clocks: dict[str, Clock] = field(default_factory=dict)
    clock_reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    extends: str = ""
    identity: bool = False
    left_out: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    own: NameMap | None = None
    file: str = ""

    def mapping(self) -> NameMap | None:
        """Return the map that `flighttest.read` takes; None where none is needed."""
        if self.own is not None:
            return self.own
        if self.identity:
            return None
        if self.extends:
            base = read_names(self.extends)
            return replace(base, facts=Facts(**self.facts), constants=self.constants)
        leaves: dict[str, dict[str, Channel]] = {}
        for row in self.rows:
            leaves.setdefault(row.leaf, {})[row.name] = row.channel
        return NameMap(
            leaves, self.clock, Facts(**self.facts), "draft", self.clocks, constants=self.constants
        )


def own_names(names: str | Path) -> NamesDraft:
    """Return the author's name map as a draft that stays as it is.

    Parameters
    ----------
    names : str or Path
        TOML file, or the name of a shipped map.

    Raises
    ------
    SchemaError
        The map is faulty, with all problems.
    """
    mapping = read_names(names)
    return NamesDraft(
        facts=mapping.facts.stated(), constants=mapping.constants, own=mapping, file=str(names)
    )


def draft_names(files: Sequence[Path], flap: float | None = None) -> NamesDraft:
    """Return a name map for recordings of one recorder.

    Parameters
    ----------
    files : sequence of Path
    flap : float, optional
        Largest deflection of the flaps in the listings, for records that show a position 0 ... 1.
        [rad]

    Raises
    ------
    SchemaError
        Files of several formats, bus words without a table, or files in which no quantity is
        recognised.
    """
    kinds = {recognise_recording(file) for file in files}
    if len(kinds) > 1:
        names = ", ".join(sorted(FORMATS[kind][1] for kind in kinds))
        raise SchemaError(
            "recordings",
            [
                f"several formats ({names}); one name map serves one recorder: give the "
                f"files of one of them"
            ],
        )
    (kind,) = kinds
    if kind == "chapter10":
        raise SchemaError(
            "recordings",
            [
                "Chapter 10 holds words of a bus; write their [decode] tables first "
                "(docs/explanation/flight-test/records.md)"
            ],
        )
    if kind in LOGS:
        remark = (
            f"surface angles are not in a {FORMATS[kind][1]} log: add the bench table of "
            f"each surface to [controls] of names.toml, "
        )
        remark += (
            "then write manoeuvres.csv with 'aeromatch flight manoeuvres RECORD --names "
            "names.toml -o manoeuvres.csv'"
        )
        return NamesDraft(extends=LOGS[kind], remarks=(remark,))
    if not any(needs_names(file) for file in files):
        return NamesDraft(identity=True)
    recordings = {file: open_recording(file, NameMap({})) for file in files}
    tables: dict[str, RecordedTable] = {}
    for recording in recordings.values():
        tables |= {name: table for name, table in recording.tables.items() if name not in tables}
    clocks = {
        name: stamps
        for name, table in tables.items()
        if (stamps := _clock_of(name, table)) is not None
    }
    found, left_out, remarks, constants = _assigned(
        tables, flap, {clock.column for clock, _ in clocks.values() if clock.column}
    )
    if not found:
        raise SchemaError(
            "recordings",
            [
                f"no column of {files[0].name} has the name of a quantity; see 'aeromatch "
                f"flight info'"
            ],
        )
    everywhere = [
        {f"{t}/{c}" for t, table in recording.tables.items() for c in table.columns}
        for recording in recordings.values()
    ]
    rows = _rows(found, tables, everywhere, flap, remarks)
    first = next(iter(clocks.values()), (Clock(), ""))
    several = {name: clock for name, (clock, _) in clocks.items() if clock != first[0]}
    facts = _facts(found, tables, rows)
    return NamesDraft(
        tuple(rows),
        first[0],
        several,
        first[1],
        facts,
        constants,
        left_out=tuple(left_out),
        remarks=tuple(remarks),
    )


def _clock_of(name: str, table: RecordedTable) -> tuple[Clock, str] | None:
    """Return the clock of a table that has none of its own, and why; None where the reader needs no
    help.
    """
    if table.time is not None:
        return None
    known = clock_name(table.columns)
    columns = (
        [known]
        if known
        else [
            column
            for column in table.columns
            if any(word in column.lower() for word in _CLOCK_WORDS)
        ]
    )
    columns += [] if known else [column for column in table.columns if column not in columns]
    for column in columns:
        stamps = np.asarray(table.columns[column], float)
        steps = np.diff(stamps[np.isfinite(stamps)])
        if len(steps) and np.mean(steps > 0.0) > 0.95:
            unit = unit_of_column(table, column, "time") or ""
            word = next((text for text in ("us", "ms", "ns") if column.lower().endswith(text)), "")
            step = float(np.median(steps))
            sized = "s" if step < 2.0 else "ms" if step < 2e3 else "us" if step < 2e6 else "ns"
            chosen = unit or word or sized
            if known and chosen == "s":
                return None
            return Clock(
                column=column, unit=chosen
            ), f"{column} rises by {step:.6g} at each sample: taken as {chosen}"
    raise SchemaError(
        "recordings",
        [
            f"table {name}: no column that rises all along; state the clock: [time] rate = "
            f'"50 Hz" in a name map'
        ],
    )


def _assigned(
    tables: Mapping[str, RecordedTable], flap: float | None, stamps: set[str | None]
) -> tuple[dict[str, tuple[str, str, Guess]], list[str], list[str], dict[str, float]]:
    """Return table, column and guess of every quantity, the columns without one, remarks, and what
    stood still.
    """
    found: dict[str, tuple[str, str, Guess]] = {}
    left_out, remarks = [], []
    for table, content in tables.items():
        clock = clock_name(content.columns)
        for column in content.columns:
            if column in stamps or column in CLOCK_NAMES or column == clock:
                continue
            one = guess_quantity(f"{table}/{column}")
            one = (
                None
                if one is not None and _of_another_kind(content.units.get(column), one.name)
                else one
            )
            place = f"{table}/{column}" if len(tables) > 1 else column
            if one is None:
                left_out.append(place)
            elif _is_fraction(content, column, one) and (flap is None or one.name != "delta_f"):
                left_out.append(
                    f'{place}: a position 0 ... 1; {one.name} = {{ column = "{place}", scale '
                    f'= "40 deg" }} with the angle at 1'
                )
                remarks.append(
                    f"{one.name}: column {place} is a position 0 ... 1: give its angle at 1 "
                    f"as scale in names.toml"
                )
            elif one.name in found and found[one.name][2].rank <= one.rank:
                left_out.append(f"{place} (another {one.name})")
            else:
                if one.name in found:
                    left_out.append(f"{found[one.name][1]} (another {one.name})")
                found[one.name] = table, column, one
    for name in ("p", "q", "r", "phi", "theta", "ax_imu", "ay_imu", "az_imu"):
        if name not in found:
            remarks.append(
                f"no column was recognised as {name} ({lookup(name).long_name}); the "
                f"reconstruction needs it: add it to names.toml"
            )
    constants = {}
    if flap is not None and not {"delta_f", "delta_f_left"} & set(found):
        constants["delta_f"] = 0.0
        remarks.append(
            "no column shows the flaps and the listings have them: delta_f = 0 stands in "
            "[constants] of names.toml; confirm it"
        )
    return found, left_out, remarks, constants


def _is_fraction(table: RecordedTable, column: str, one: Guess) -> bool:
    """Return whether a control is recorded as a share of its travel: flaps without a unit between 0
    and 1.
    """
    unit = table.units.get(column)
    x = np.asarray(table.columns[column], float)
    between = bool(np.nanmin(x) >= 0.0 and np.nanmax(x) <= 1.0)
    fraction = (
        known_unit(unit) in ("1", "%")
        if unit
        else one.unit is None and one.name.startswith("delta_f")
    )
    return lookup(one.name).units == "rad" and fraction and between


def _of_another_kind(unit: str | None, name: str) -> bool:
    """Return whether the file states a unit, and it is none of the quantity."""
    try:
        units = lookup(name).units
        return bool(unit) and parse_unit(fitted_unit(str(unit), units))[0] != parse_unit(units)[0]
    except UnitError:
        return False


def _rows(
    found: Mapping[str, tuple[str, str, Guess]],
    tables: Mapping[str, RecordedTable],
    everywhere: Sequence[set[str]],
    flap: float | None,
    remarks: list[str],
) -> list[NameMapRow]:
    values = {
        name: np.asarray(tables[table].columns[column], float)
        for name, (table, column, _) in found.items()
    }
    in_file = {
        name: stated_unit(tables[table].units.get(column), name)
        for name, (table, column, _) in found.items()
    }
    in_name = {
        name: stated_unit(_force(guess.unit, name), name) for name, (_, _, guess) in found.items()
    }
    sized = unit_from_size(
        {name: values[name] for name in found if in_file[name] is None and in_name[name] is None}
    )
    rows = []
    for name, (table, column, one) in sorted(
        found.items(),
        key=lambda item: (_order(item[0])[0], _leaf(item[0], item[1][0], tables), _order(item[0])),
    ):
        unit, reason = (
            (in_file[name], "")
            if in_file[name]
            else (in_name[name], "")
            if in_name[name]
            else sized[name]
        )
        keys: dict[str, Any] = {} if in_file[name] else {"unit": unit}
        if _is_fraction(tables[table], column, one):
            keys = {"scale": f"{np.degrees(flap or 0.0):.6g} deg"}
            reason = (
                f"{_CONFIRM}: a position 0 ... 1, taken as the largest deflection of the "
                f"listings at 1"
            )
        if name == "az_imu":
            keys |= _normal_force(values[name], str(unit))
            reason = reason or ("recorded positive up" if keys.get("sign") == -1 else "")
        elif one.sign < 0:
            keys["sign"] = -1
            reason = "; ".join(
                filter(None, (reason, "the heading states the opposite positive sense"))
            )
        if any(f"{table}/{column}" not in there for there in everywhere):
            keys["optional"] = True
        if one.rank > 2:
            reason = f"{_CONFIRM}: by a part of its name{'; ' + reason if reason else ''}"
        if reason.startswith(_CONFIRM):
            remarks.append(
                f"{name} from column {column!r}{f' in {unit}' if unit else ''}: {reason}"
            )
        place = f"{table}/{column}" if len(tables) > 1 else column
        rows.append(
            NameMapRow(_leaf(name, table, tables), name, Channel(column=place, **keys), reason)
        )
    return rows


def _force(unit: str | None, name: str) -> str | None:
    """A pound of force where the quantity is one."""
    return "lbf" if unit == "lb" and lookup(name).units == "N" else unit


def _normal_force(x: np.ndarray, unit: str) -> dict[str, Any]:
    """Return sign and offset that make of a normal acceleration the specific force, positive down."""
    middle = float(np.nanmedian(x)) * parse_unit(unit)[1] / G0
    if middle > 0.5:
        return {"sign": -1}
    return {"sign": -1, "offset": "-1 g"} if abs(middle) < 0.5 else {}


def _order(name: str) -> tuple[int, int]:
    for number, names in enumerate(_GROUPS.values()):
        if name in names:
            return number, names.index(name)
    return len(_GROUPS), 0


def _leaf(name: str, table: str, tables: Mapping[str, RecordedTable]) -> str:
    """Return the leaf of a channel: its subject, with the table where there are several, because a
    leaf has one clock.
    """
    subject = next(
        (group for group, names in _GROUPS.items() if name in names),
        "engine" if name.startswith("engine") else "controls",
    )
    word = "".join(letter if letter.isalnum() else "_" for letter in table)
    return subject if len(tables) == 1 else word if subject in word else f"{subject}_{word}"


def _facts(
    found: Mapping[str, tuple[str, str, Guess]],
    tables: Mapping[str, RecordedTable],
    rows: Sequence[NameMapRow],
) -> dict[str, Any]:
    if "lat" not in found:
        return {}
    table, column, _ = found["lat"]
    row = next(row for row in rows if row.name == "lat")
    shown = row.channel.convert(
        np.asarray(tables[table].columns[column], float), tables[table].units.get(column), "lat"
    )
    return {"latitude": float(np.nanmedian(shown))}


def check_draft(
    draft: NamesDraft, files: Sequence[Path]
) -> tuple[NamesDraft, dict[str, xr.DataTree], list[str]]:
    """Return a map with the mistakes undone that the check of the records finds, the records, and
    what remains wrong.

    Notes
    -----
    The remedy of a finding is a line of the name map; it takes the place of the line it names, as long as no other one explains the
    record as well.  Columns without a stated unit and sign are corrected so; the reason of a corrected line states the finding.
    """
    left: list[str] = []
    if draft.own is not None:
        found = {
            file: _findings(draft, file)
            for file in sorted(files, key=lambda file: -file.stat().st_size)[:_RECORDS]
        }
        left = [
            f"{file.name}: {one.name}: {one.text}; {one.remedy}"
            for file, findings in found.items()
            for one in findings
        ]
        return draft, {file.stem: flighttest.read(file, draft.mapping()) for file in files}, left
    looked_at = sorted(files, key=lambda file: -file.stat().st_size)[:_RECORDS]
    for file in looked_at:
        for _ in range(_ROUNDS):
            findings = _findings(draft, file)
            repaired = _repaired(
                draft,
                [
                    one
                    for one in findings
                    if one.kind in _REPAIRED and not one.evidence.get("instead")
                ],
            )
            if repaired is None:
                left += [
                    f"{file.name}: {one.name}: {one.text}; {one.remedy}"
                    for one in findings
                    if one.severity == "error"
                ]
                break
            draft = repaired
    return draft, {file.stem: flighttest.read(file, draft.mapping()) for file in files}, left


def _findings(draft: NamesDraft, file: Path) -> list[Any]:
    record = flighttest.read(file, draft.mapping())
    try:
        return [one for one in flighttest.assess(record).findings if one.severity == "error"]
    except SchemaError:  # no channel of motion: nothing to compare
        return []


def _repaired(draft: NamesDraft, findings: Sequence[Any]) -> NamesDraft | None:
    """Return the draft with the lines that findings give; None when there is none to change."""
    changed = {}
    for one in findings:
        try:
            lines = tomllib.loads(one.remedy)
        except tomllib.TOMLDecodeError:
            continue
        for name, entry in _flat(lines).items():
            channel = Channel(**(entry if isinstance(entry, dict) else {"column": entry}))
            changed[name] = channel, one.text.split(" (")[0]
    rows = tuple(
        _corrected(row, *changed[row.name]) if row.name in changed else row for row in draft.rows
    )
    return None if rows == draft.rows else replace(draft, rows=rows)


def _corrected(row: NameMapRow, channel: Channel, text: str) -> NameMapRow:
    old = row.channel.optional
    return replace(
        row, channel=channel.changed(optional=old), reason=f"by the check of the record: {text}"
    )


def _flat(lines: Mapping[str, Any]) -> dict[str, Any]:
    return {
        f"{name}.{key}"
        if name.startswith("engine") and isinstance(entry, dict) and "column" not in entry
        else name: item
        for name, entry in lines.items()
        for key, item in (
            entry.items()
            if name.startswith("engine") and isinstance(entry, dict) and "column" not in entry
            else [("", entry)]
        )
    }


def names_text(draft: NamesDraft, files: Sequence[Path]) -> str:
    """Return a draft as the text of a name map."""
    lines = [
        *schema_lines("names"),
        f"# Name map of "
        f"{', '.join(file.name for file in files[:3])}{' and others' if len(files) > 3 else ''}.",
        "# Drafted by `aeromatch init` from the names and sizes of the columns: confirm "
        "units, signs, then run `aeromatch flight check`.",
        "# Keys of a channel: column, unit, sign, scale, offset, polynomial, table, delay, "
        "lag, optional (docs/reference/project-keys.md).",
    ]
    if draft.extends:
        lines += [f'extends = "{draft.extends}"', ""]
    lines += ["", "[record]", *(f"{key} = {_fact(key, item)}" for key, item in draft.facts.items())]
    absent = {"latitude": '"45 deg"', "runway_elevation": '"120 m"'}
    lines += [f"# {key} = {example}" for key, example in absent.items() if key not in draft.facts]
    if draft.constants:
        lines += [
            "",
            "[constants]   # channels that no column shows and that did not change; CONFIRM",
        ]
        lines += [
            f"{name} = {item:.6g}   # {lookup(name).long_name} [{lookup(name).units}]"
            for name, item in draft.constants.items()
        ]
    if draft.extends:
        lines += [
            "",
            "# [controls]                      # bench table of each surface: demand against angle",
            *_BENCH,
        ]
    if draft.clock.column:
        lines += [
            "",
            "[time]",
            f"column = {_text(draft.clock.column)}",
            f"unit = {_text(str(draft.clock.unit))}   # {draft.clock_reason}",
        ]
    for name, clock in draft.clocks.items():
        lines += [
            "",
            f"[time.{_text(name)}]",
            f"column = {_text(str(clock.column))}",
            f"unit = {_text(str(clock.unit))}",
        ]
    leaf = ""
    for row in draft.rows:
        if row.leaf != leaf:
            leaf = row.leaf
            lines += ["", f"[{leaf}]"]
        about = f"{lookup(row.name).long_name}{'; ' + row.reason if row.reason else ''}"
        lines.append(f"{line_of(row.name, row.channel)}   # {about}")
    if draft.left_out:
        lines += ["", "# Columns without a quantity:"] + [
            f"#   {column}" for column in draft.left_out
        ]
    return "\n".join(lines) + "\n"


_BENCH = (
    '# delta_e = { column = "actuator_servos/control[2]", unit = "deg", table = [[-1, 21.5], '
    "[0, 0.8], [1, -24.0]] }",
    '# A demand that the actuator follows late: lag = "-0.05 s" makes it the position.',
)


def _fact(key: str, item: Any) -> str:
    if key == "latitude":
        return f'"{np.degrees(item):.6g} deg"'
    if key == "temperature":
        return f'"{item:.6g} K"'
    return _text(item) if isinstance(item, str) else f"{item:.8g}"


def _text(item: str) -> str:

    return json.dumps(item, ensure_ascii=False)
