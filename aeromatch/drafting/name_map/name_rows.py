"""Rows of a drafted name map: the quantity, the unit and the sign of each column."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from aeromatch.drafting.name_map.column_units import stated_unit, unit_from_size
from aeromatch.drafting.name_map.columns import (
    Guess,
    explain_unit,
    explain_unknown,
    guess_quantity,
    lever_by_unit,
    load_factor_by_unit,
)
from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.support.toml_quantities import CONFIRM
from flightmech.units import G0, fitted_unit, known_unit, parse_unit
from flighttest.records.readers.name_map import Channel
from flighttest.records.readers.recording import CLOCK_NAMES, RecordedTable, clock_name

GROUPS = {
    "imu": ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu"),
    "vanes": ("alpha_vane", "beta_vane"),
    "air_data": ("V", "V_cas", "mach", "q_c", "p_static", "temperature", "h_baro", "hdot"),
    "gps": ("vn", "ve", "vd", "h_gps", "lat", "lon", "north", "east", "V_ground"),
    "radio_altimeter": ("h_radio",),
    "mass": ("mass", "x_cg_b", "y_cg_b", "z_cg_b"),
}
REQUIRED = ("p", "q", "r", "phi", "theta", "ax_imu", "ay_imu", "az_imu")
"""Channels without which the reconstruction is not possible."""
# Rank of a guess above which the author has to confirm it.
_CERTAIN_RANK = 2
AS_WRITTEN = "as you wrote it"
"""Confidence of a line that the author wrote."""
# Correlation from which two columns are two readings of one quantity.
_SAME_MOVEMENT = 0.98


@dataclass(frozen=True)
class NameMapRow:
    """One line of a name map with the reason for it.

    Attributes
    ----------
    leaf, name : str
    channel : Channel
    reason : str
    unit : str
        Unit of the column, also where the file states it and the map does not.
    confidence : str
        ``stated`` (name and unit in heading or file), ``by size`` (unit or sign by the values),
        ``CONFIRM``, ``by the check`` (corrected by the check of the record), or `AS_WRITTEN`.
    """

    leaf: str
    name: str
    channel: Channel
    reason: str = ""
    unit: str = ""
    confidence: str = "stated"


@dataclass(frozen=True)
class LeftColumn:
    """A column of a recording from which no channel is drafted, and the reason."""

    column: str
    reason: str


@dataclass
class AssignedColumns:
    """Quantities of the columns of a recording.

    Attributes
    ----------
    assigned : dict of str to (str, str, Guess)
        Table, column and guess of every quantity.
    left_out : list of LeftColumn
        Columns without a quantity, or with one that another column has.
    remarks : list of str
        Values that the author has to give or confirm.
    constants : dict of str to float
        Quantities without a column that are taken as constant. [SI]
    rivals : dict of str to list of str
        Columns of other values whose heading fits a quantity as well as that of its column.
    """

    assigned: dict[str, tuple[str, str, Guess]] = field(default_factory=dict)
    left_out: list[LeftColumn] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    constants: dict[str, float] = field(default_factory=dict)
    rivals: dict[str, list[str]] = field(default_factory=dict)

    def assign(
        self,
        guess: Guess,
        table: str,
        column: str,
        location: str,
        tables: Mapping[str, RecordedTable],
    ) -> None:
        """Assign a column to a quantity, if no better column has it."""
        if guess.name in self.assigned:
            former_table, former, former_guess = self.assigned[guess.name]
            if former_guess.rank <= guess.rank:
                is_rival = former_guess.rank == guess.rank and former_table == table
                if is_rival and _have_other_values(tables[table], former, column):
                    self.rivals.setdefault(guess.name, []).append(column)
                self.left_out.append(LeftColumn(location, f"another {guess.name}"))
                return
            self.left_out.append(LeftColumn(former, f"another {guess.name}"))
            self.rivals.pop(guess.name, None)
        self.assigned[guess.name] = table, column, guess


def assign_columns(
    tables: Mapping[str, RecordedTable],
    flap: float | None,
    stamps: set[str],
    confirmed: Mapping[str, Collection[str]],
    removed: Collection[str] = (),
) -> AssignedColumns:
    """Return the quantities of all columns.

    Parameters
    ----------
    tables : mapping of str to RecordedTable
    flap : float or None
        Largest deflection of the flaps in the listings. [rad]
    stamps : set of str
        Columns that are clocks.
    confirmed : mapping of str to collection of str
        Quantities that the author has mapped, with their columns.
    removed : collection of str
        Columns whose line the author has removed from the map.
    """
    result = AssignedColumns()
    used = set(chain.from_iterable(confirmed.values()))
    for table, content in tables.items():
        excluded = {*stamps, *CLOCK_NAMES, clock_name(content.columns)}
        for column in content.columns:
            location = f"{table}/{column}" if len(tables) > 1 else column
            if column in excluded or used & {column, location, f"{table}/{column}"}:
                continue
            stated = content.units.get(column)
            guess = load_factor_by_unit(guess_quantity(f"{table}/{column}"), stated)
            if guess is not None and stated:
                guess = replace(guess, name=lever_by_unit(guess.name, known_unit(stated)))
            reason = _reason_to_leave(content, column, guess, flap)
            if guess is None or reason:
                result.left_out.append(LeftColumn(location, reason))
            elif location in removed:
                result.left_out.append(LeftColumn(location, "you removed its line"))
            elif guess.name in confirmed:
                result.left_out.append(LeftColumn(location, f"another {guess.name}, by your map"))
            else:
                result.assign(guess, table, column, location=location, tables=tables)
            is_position = guess is not None and _is_fraction(content, column, guess)
            if guess is not None and reason and is_position:
                result.remarks.append(
                    f"{guess.name}: column {location} is a position 0 ... 1: give its angle at 1 "
                    f"as scale in names.toml"
                )
    _remark_absent_quantities(result, flap, confirmed)
    return result


def _have_other_values(content: RecordedTable, one: str, other: str) -> bool:
    """Return whether two columns do not move together, in whatever units they are."""
    first = np.asarray(content.columns[one], float)
    second = np.asarray(content.columns[other], float)
    both = np.isfinite(first) & np.isfinite(second)
    x, y = first[both], second[both]
    if len(x) < 2 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return not np.array_equal(x, y)
    return bool(np.corrcoef(x, y)[0, 1] < _SAME_MOVEMENT)


def _reason_to_leave(
    content: RecordedTable, column: str, guess: Guess | None, flap: float | None
) -> str:
    """Return why a column gives no channel; an empty text if it gives one."""
    if guess is None:
        return explain_unknown(column) or explain_unit(column) or "its heading is not known"
    unit = content.units.get(column)
    is_fraction = _is_fraction(content, column, guess)
    if not is_fraction and _contradicts_unit(unit, guess.name):
        expected = lookup(guess.name).units
        return f"its unit {unit} contradicts {guess.name}, which is in {expected}"
    if is_fraction and (flap is None or guess.name != "delta_f"):
        return (
            f"a position 0 ... 1; {guess.name} = {{ column = {column!r}, "
            f'scale = "40 deg" }} with the angle at 1'
        )
    return ""


def _remark_absent_quantities(
    result: AssignedColumns, flap: float | None, confirmed: Collection[str]
) -> None:
    """Add a remark for each absent quantity that is required; absent flaps are retracted."""
    present = {*result.assigned, *confirmed}
    for name in REQUIRED:
        if name not in present:
            result.remarks.append(
                f"no column was recognised as {name} ({lookup(name).long_name}); the "
                f"reconstruction needs it: add it to names.toml"
            )
    if flap is not None and not {"delta_f", "delta_f_left"} & present:
        result.constants["delta_f"] = 0.0
        result.remarks.append(
            "no column shows the flaps and the listings have them: delta_f = 0 stands in "
            "[constants] of names.toml; confirm it"
        )


def _is_fraction(table: RecordedTable, column: str, guess: Guess) -> bool:
    """Return whether an angle is recorded as a fraction of its travel, between 0 and 1.

    Of the columns without a unit only the flaps are taken for a fraction.
    """
    if lookup(guess.name).units != "rad":
        return False
    unit = table.units.get(column)
    if unit:
        may_be_fraction = known_unit(unit) in ("1", "%")
    else:
        may_be_fraction = guess.unit is None and guess.name.startswith("delta_f")
    if not may_be_fraction:
        return False
    values = np.asarray(table.columns[column], float)
    return bool(np.nanmin(values) >= 0.0 and np.nanmax(values) <= 1.0)


def _contradicts_unit(unit: str | None, name: str) -> bool:
    """Return whether the file states a unit that is not a unit of the quantity."""
    if not unit:
        return False
    try:
        units = lookup(name).units
        # percent has the dimension of an angle
        if units == "rad" and known_unit(str(unit)) == "%":
            return True
        return parse_unit(fitted_unit(str(unit), units))[0] != parse_unit(units)[0]
    except UnitError:
        return False


def make_rows(
    columns: AssignedColumns,
    tables: Mapping[str, RecordedTable],
    recordings: Sequence[Any],
    flap: float | None,
) -> list[NameMapRow]:
    """Return the rows of a name map, in the order of their leaves.

    Parameters
    ----------
    columns : AssignedColumns
        Gets the remarks on rows that the author has to confirm.
    tables : mapping of str to RecordedTable
    recordings : sequence of Recording
        A column that some recording lacks is optional.
    flap : float or None
        Largest deflection of the flaps in the listings. [rad]
    """
    columns_by_recording = [_all_columns(recording) for recording in recordings]
    units, by_text = _find_units(columns, tables)

    def sort_key(name: str) -> tuple[Any, ...]:
        group, position = _order(name)
        return group, leaf_of(name, columns.assigned[name][0], tables), position

    rows = []
    for name in sorted(columns.assigned, key=sort_key):
        table, column, guess = columns.assigned[name]
        unit, keys, reason = units[name]
        # A flap position of 0 to 1 has no unit; the listings state the deflection at 1.
        if _is_fraction(tables[table], column, guess):
            keys = {"scale": f"{np.degrees(flap or 0.0):.6g} deg"}
            reason = (
                f"{CONFIRM}: a position 0 ... 1, taken as the largest deflection of the "
                f"listings at 1"
            )
        if name == "az_imu":
            values = np.asarray(tables[table].columns[column], float)
            keys |= _specific_force_keys(values, str(unit))
            if not reason and keys.get("sign") == -1:
                reason = "recorded positive up"
        elif guess.sign < 0:
            keys["sign"] = -1
            opposite = "the heading states the opposite positive sense"
            reason = f"{reason}; {opposite}" if reason else opposite
        # The map must also read the recordings without this column.
        if any(f"{table}/{column}" not in names for names in columns_by_recording):
            keys["optional"] = True
        if name in columns.rivals:
            others = ", ".join(columns.rivals[name])
            rival = f"{others} may be {name} as well and has other values: take the right one"
            reason = f"{CONFIRM}: {rival}{'; ' + reason if reason else ''}"
        elif guess.doubt:
            reason = f"{CONFIRM}: {guess.doubt}{'; ' + reason if reason else ''}"
        elif guess.rank > _CERTAIN_RANK:
            reason = f"; {reason}" if reason else ""
            reason = f"{CONFIRM}: by a part of its name{reason}"
        if reason.startswith(CONFIRM):
            in_unit = f" in {unit}" if unit else ""
            columns.remarks.append(f"{name} from column {column!r}{in_unit}: {reason}")
        location = f"{table}/{column}" if len(tables) > 1 else column
        rows.append(
            NameMapRow(
                leaf_of(name, table, tables),
                name,
                Channel(column=location, **keys),
                reason=reason,
                unit=unit,
                confidence=_confidence(reason, is_unit_stated=by_text[name]),
            )
        )
    return rows


def _confidence(reason: str, is_unit_stated: bool) -> str:
    """Return the confidence of a drafted row, as in `NameMapRow`."""
    if reason.startswith(CONFIRM):
        return CONFIRM
    return "stated" if is_unit_stated else "by size"


def _all_columns(recording: Any) -> set[str]:
    """Return the columns of all tables of a recording, as TABLE/COLUMN."""
    names: set[str] = set()
    for table, content in recording.tables.items():
        names.update(f"{table}/{column}" for column in content.columns)
    return names


def _find_units(
    columns: AssignedColumns, tables: Mapping[str, RecordedTable]
) -> tuple[dict[str, tuple[str, dict[str, Any], str]], dict[str, bool]]:
    """Return the unit of each quantity, the keys of its channel and the reason; and whether a text
    states the unit.

    The unit of the file comes first, then the unit in the name of the column, then the size of the
    values.
    """
    in_file: dict[str, str | None] = {}
    in_name: dict[str, str | None] = {}
    without_unit: dict[str, np.ndarray] = {}
    for name, (table, column, guess) in columns.assigned.items():
        in_file[name] = stated_unit(tables[table].units.get(column), name)
        in_name[name] = stated_unit(_force_unit(guess.unit, name), name)
        if in_file[name] is None and in_name[name] is None:
            without_unit[name] = np.asarray(tables[table].columns[column], float)
    by_size = unit_from_size(without_unit)
    units: dict[str, tuple[str, dict[str, Any], str]] = {}
    for name in columns.assigned:
        file_unit, name_unit = in_file[name], in_name[name]
        if file_unit:
            # The reader uses the unit of the file, so the map does not repeat it.
            units[name] = file_unit, {}, ""
        elif name_unit:
            units[name] = name_unit, {"unit": name_unit}, ""
        else:
            unit, reason = by_size[name]
            units[name] = unit, {"unit": unit}, reason
    return units, {name: name not in without_unit for name in columns.assigned}


def _force_unit(unit: str | None, name: str) -> str | None:
    """Return the pound of force for a pound in the name of a force."""
    if unit == "lb" and lookup(name).units == "N":
        return "lbf"
    return unit


def _specific_force_keys(values: np.ndarray, unit: str) -> dict[str, Any]:
    """Return sign and offset that convert a normal acceleration to the specific force.

    The specific force az is positive down, and -1 g in level flight.
    """
    median = float(np.nanmedian(values)) * parse_unit(unit)[1] / G0
    # A load factor is +1 in level flight.
    if median > 0.5:
        return {"sign": -1}
    # An acceleration without gravity is 0 in level flight.
    if abs(median) < 0.5:
        return {"sign": -1, "offset": "-1 g"}
    return {}


def _order(name: str) -> tuple[int, int]:
    """Return the group of a quantity and its position in the group."""
    for number, names in enumerate(GROUPS.values()):
        if name in names:
            return number, names.index(name)
    return len(GROUPS), 0


def leaf_of(name: str, table: str, tables: Mapping[str, RecordedTable]) -> str:
    """Return the leaf of a channel: its subject, and the table if there are several.

    A leaf has one clock, so channels of different tables are in different leaves.
    """
    subject = "engine" if name.startswith("engine") else "controls"
    for group, names in GROUPS.items():
        if name in names:
            subject = group
    if len(tables) == 1:
        return subject
    word = "".join(letter if letter.isalnum() else "_" for letter in table)
    if subject in word:
        return word
    return f"{subject}_{word}"
