"""Reader of name maps in TOML files, which collects all problems of a map.

The content of a map is first joined with the map that it extends, then each table is validated.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.file_kinds import foreign_kind
from flightmech.support.input_files import WESTERN, read_text
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import fitted_unit, parse_unit
from flighttest.records.readers.bus_words import KINDS, Decode
from flighttest.records.readers.name_map import TOP, Channel, Clock, Facts, NameMap, Utc
from flighttest.records.sensors.instruments import Instrument

T = TypeVar("T", bound=Strict)

# Parts whose quantities have their name before them.
_PARTS = re.compile(r"(engine\w*|gear|joint|device|tank|transfer|column|wheel|pedal)$")
MAPS = Path(__file__).parent / "maps"


def shipped_maps() -> list[str]:
    """Return the names of the maps in `flighttest/records/readers/maps`."""
    return sorted(file.stem for file in MAPS.glob("*.toml"))


def read_names(path: str | Path) -> NameMap:
    """Return the name map in a TOML file, or a shipped one by its name.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        With all problems: unknown keys and canonical names with their near names, wrong units.
    """
    path = _find_map(path, Path())
    problems: list[str] = []
    content = _read_extended_content(path, extending=())
    names = _parse_map(content, str(path), path.parent, problems)
    if problems:
        raise SchemaError(f"name map {path}", problems)
    return names


def _find_map(path: str | Path, folder: Path) -> Path:
    """Return the file of a map; a file in the folder has priority over a shipped map."""
    file = folder / path
    if file.exists():
        return file
    shipped = MAPS / f"{path}.toml"
    if shipped.exists():
        return shipped
    if not file.suffix:
        raise UnknownName(
            str(path),
            shipped_maps(),
            what="name map",
            hint="give a TOML file or the name of a shipped map",
        )
    return file  # reading it raises the error of the operating system


def _read_extended_content(path: Path, extending: tuple[Path, ...]) -> dict[str, Any]:
    """Return the content of a map joined with the map that it extends.

    `extending` are the maps that extend this one.
    """
    content = read_toml(path)
    kind = foreign_kind(content)
    if kind:
        raise SchemaError(
            f"name map {path}",
            [f"{kind}; a name map has a table of channels for each clock, such as [air_data]"],
        )
    duplicates = []
    for leaf, table in content.items():
        if isinstance(table, dict):
            for name in _duplicate_names(table):
                duplicates.append(
                    f"{leaf}.{name}: stands there twice, with quotes and without; take one out"
                )
    if duplicates:
        raise SchemaError(f"name map {path}", duplicates)
    if content.get("optional") is True:
        content = _with_optional_channels(content)
    # The entries of a map have priority over the map that it extends.
    base = content.pop("extends", None)
    if base is None:
        return content
    base_path = _find_map(str(base), path.parent)
    if base_path in (*extending, path):
        raise SchemaError(
            f"name map {path}", [f"extends: {base} extends this map in turn; take one of them out"]
        )
    return _join_maps(content, _read_extended_content(base_path, (*extending, path)))


def _with_optional_channels(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a map with every channel marked as optional."""
    marked = {}
    for key, item in content.items():
        if key in TOP or not isinstance(item, dict):
            if key != "optional":
                marked[key] = item
            continue
        channels = {}
        for name, entry in _flatten(item).items():
            options = entry if isinstance(entry, dict) else {"column": entry}
            channels[name] = {"optional": True, **options}
        marked[key] = channels
    return marked


def _join_maps(content: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """Return a map joined with its base.

    A quantity of `content` is removed from every leaf of `base`.
    """
    names: set[str] = set()
    for leaf, table in content.items():
        if leaf not in TOP and isinstance(table, dict):
            names.update(_flatten(table))
    joined: dict[str, Any] = {}
    for leaf, table in base.items():
        if leaf in TOP or not isinstance(table, dict):
            joined[leaf] = table
            continue
        entries = _flatten(table).items()
        joined[leaf] = {name: entry for name, entry in entries if name not in names}
    for leaf, table in content.items():
        if isinstance(table, dict):
            joined[leaf] = {**joined.get(leaf, {}), **_flatten(table)}
        else:
            joined[leaf] = table
    return joined


def _parse_map(content: dict[str, Any], source: str, folder: Path, problems: list[str]) -> NameMap:
    """Return the map of a joined content and add its problems to the list."""
    clock, clocks = _parse_clocks(content.pop("time", {}), problems)
    facts = _parse_table(Facts, content.pop("record", {}), "record", problems)
    utc = None
    if "utc" in content:
        utc = _parse_table(Utc, content.pop("utc"), "utc", problems)
    decode = _parse_decode_tables(content.pop("decode", {}), problems)
    instruments = _parse_instruments(content.pop("instruments", {}), problems)
    constants = _parse_constants(content.pop("constants", {}), problems)

    # All remaining tables are leaves.
    leaves: dict[str, dict[str, Channel]] = {}
    for leaf, table in content.items():
        if not isinstance(table, dict):
            problems.append(f"{leaf}: a leaf is a table of channels ([{leaf}]); found {table!r}")
            continue
        leaves[leaf] = _parse_channels(leaf, table, folder, problems)
    problems += _repeated_quantities(leaves)
    # A constant may replace an optional channel only.
    required: set[str] = set()
    for channels in leaves.values():
        required.update(name for name, channel in channels.items() if not channel.optional)
    for name in constants:
        if name in required:
            problems.append(f"constants.{name}: a column shows it too; take one of them out")
    return NameMap(
        leaves,
        clock,
        facts=facts or Facts(),
        source=source,
        clocks=clocks,
        utc=utc,
        decode=decode,
        constants=constants,
        instruments=instruments,
    )


def _parse_clocks(time: Any, problems: list[str]) -> tuple[Clock, dict[str, Clock]]:
    """Return the common clock and the clocks of single tables."""
    if not isinstance(time, dict):
        _parse_table(Clock, time, "time", problems)  # adds the problem
        time = {}
    common = {key: item for key, item in time.items() if not isinstance(item, dict)}
    clock = _parse_clock(common, "time", problems)
    clocks = {}
    for name, item in time.items():
        if isinstance(item, dict):
            # Keys of the common clock are defaults of the others.
            clocks[name] = _parse_clock({**common, **item}, f"time.{name}", problems)
    return clock, clocks


def _parse_clock(content: dict[str, Any], position: str, problems: list[str]) -> Clock:
    """Return a clock and add its problems to the list."""
    clock = _parse_table(Clock, content, position, problems) or Clock()
    if clock.unit is not None:
        try:
            clock.seconds(None)
        except UnitError as error:
            problems.append(f"{position}.unit: {error}")
    for key in ("rate", "wrap"):
        value = getattr(clock, key)
        if value is not None and not value > 0.0:
            problems.append(f"{position}.{key}: must be positive; found {value!r}")
    return clock


def _parse_instruments(tables: Any, problems: list[str]) -> dict[str, Instrument]:
    """Return the instruments of the recorder."""
    if not isinstance(tables, dict):
        problems.append(f"instruments: expected tables [instruments.NAME]; found {tables!r}")
        return {}
    instruments = {}
    for name, table in tables.items():
        instrument = _parse_table(Instrument, table, f"instruments.{name}", problems)
        if instrument is not None:
            instruments[name] = instrument
    return instruments


def _parse_constants(table: Any, problems: list[str]) -> dict[str, float]:
    """Return the values of constant channels. [SI]"""
    if not isinstance(table, dict):
        problems.append(
            f'constants: expected a table such as {{ delta_f = "0 deg" }}; found {table!r}'
        )
        return {}
    constants = {}
    for name, item in _flatten(table).items():
        try:
            constants[name] = parse_quantity(item, lookup(name).units)
        except (UnknownName, UnitError) as error:
            problems.append(f"constants.{name}: {error}")
    return constants


def _parse_decode_tables(content: Any, problems: list[str]) -> dict[str, Decode]:
    """Return the specifications of bus words and frames."""
    specs: dict[str, Decode] = {}
    if not isinstance(content, dict):
        return specs
    for name, table in content.items():
        kind = table.get("kind") if isinstance(table, dict) else None
        if kind not in KINDS:
            problems.append(f"decode.{name}.kind: found {kind!r}; allowed: {', '.join(KINDS)}")
            continue
        spec: Decode | None = _parse_table(KINDS[kind], table, f"decode.{name}", problems)
        if spec is not None:
            problems += [f"decode.{name}.{text}" for text in spec.problems()]
            specs[name] = spec
    return specs


def _parse_channels(
    leaf: str, table: dict[str, Any], folder: Path, problems: list[str]
) -> dict[str, Channel]:
    """Return the channels of a leaf by canonical name."""
    channels = {}
    for name, entry in _flatten(table).items():
        position = f"{leaf}.{name}"
        try:
            quantity = lookup(name)
        except UnknownName as error:
            problems.append(f"{position}: {error}")
            continue
        # A text or a list is the column alone.
        if isinstance(entry, str | list):
            entry = {"column": entry}
        if isinstance(entry, dict) and isinstance(entry.get("table"), str):
            rows = _read_calibration_table(folder / entry["table"], position, problems)
            entry = {**entry, "table": rows}
        channel = _parse_table(Channel, entry, position, problems)
        if channel is not None:
            problems += [f"{position}.{text}" for text in _channel_faults(channel, quantity.units)]
            channels[name] = channel
    return channels


def _channel_faults(channel: Channel, units: str) -> list[str]:
    """Return the faults of a channel beyond the types of its values."""
    faults = []
    for key in ("scale", "offset"):
        value = getattr(channel, key)
        if isinstance(value, str):
            try:
                parse_quantity(value, units)
            except UnitError as error:
                faults.append(f"{key}: {error}")
    if channel.unit is not None:
        try:
            _demand_same_quantity(channel.unit, units)
        except UnitError as error:
            faults.append(f"unit: {error}")
    if not channel.columns:
        faults.append("column: an empty list; name a column")
    return faults + _calibration_faults(channel, units)


def _demand_same_quantity(unit: str, units: str) -> None:
    """Raise UnitError if a unit cannot be converted to the unit of the vocabulary."""
    if parse_unit(fitted_unit(unit, units))[0] != parse_unit(units)[0]:
        raise UnitError(
            f"{unit!r} cannot be converted to {units!r}; give a unit of the same quantity"
        )


def _calibration_faults(channel: Channel, units: str) -> list[str]:
    """Return the faults of the polynomial or table of a channel."""
    faults = []
    polynomial, table = channel.polynomial, channel.table
    is_calibrated = polynomial is not None or table is not None
    if polynomial is not None and table is not None:
        faults.append("table: stands next to a polynomial; give one of them")
    if is_calibrated and channel.unit is None and not isinstance(channel.scale, str):
        faults.append(
            f'unit: a calibration needs the unit of its values; give unit = "..." (of the '
            f"kind of {units})"
        )
    if polynomial is not None and not polynomial:
        faults.append("polynomial: empty; give the coefficients by ascending power")
    if table is not None:
        raw_values = {raw for raw, _ in table}
        if len(table) < 2 or len(raw_values) < len(table):
            faults.append("table: needs two rows [raw, value] or more, each raw value once")
    return faults


def _read_calibration_table(path: Path, position: str, problems: list[str]) -> list[list[float]]:
    """Return the rows [raw, value] of a CSV file; lines of text may precede them."""
    try:
        text = read_text(path, "two columns of numbers, raw and value", WESTERN)
    except (OSError, ParseError) as error:
        problems.append(f"{position}.table: {path} cannot be read ({error})")
        # A valid table, so that the channel gives no further problem.
        return [[0.0, 0.0], [1.0, 0.0]]
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            raw, value = (float(cell) for cell in line.split(","))
            rows.append([raw, value])
        except ValueError:
            if rows:
                problems.append(
                    f"{position}.table: {path}, line {number}: found {line!r}; expected two "
                    f"numbers, raw and value"
                )
    return rows


def _flatten(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with the keys of parts joined, which TOML splits: ``engine1.thrust``."""
    flat: dict[str, Any] = {}
    for name, entry in table.items():
        if _PARTS.match(name) and _is_group(entry):
            for keys, item in _list_leaves(entry):
                flat[".".join([name, *keys])] = item
        else:
            flat[name] = entry
    return flat


def _is_group(entry: Any) -> bool:
    """Return whether an entry holds names, and not the keys of one channel."""
    return isinstance(entry, dict) and not Channel.model_fields.keys() & entry.keys()


def _list_leaves(group: Mapping[str, Any]) -> Iterator[tuple[list[str], Any]]:
    """Yield the keys of every channel in a group of groups, and the channel."""
    for key, entry in group.items():
        if _is_group(entry):
            for keys, item in _list_leaves(entry):
                yield [key, *keys], item
        else:
            yield [key], entry


def _duplicate_names(table: Mapping[str, Any]) -> list[str]:
    """Return the names with a dot that are both a key in quotes and a table in a table."""
    names = []
    for name, entry in table.items():
        if isinstance(entry, dict):
            joined = (".".join([name, *keys]) for keys, _ in _list_leaves(entry))
            names += [text for text in joined if text in table]
    return names


def _parse_table(model: type[T], content: Any, position: str, problems: list[str]) -> T | None:
    """Return the object of a table, or None and its problems in the list."""
    if not isinstance(content, dict):
        problems.append(
            f'{position}: expected a column name or a table such as {{ column = "..." }}; found '
            f"{content!r}"
        )
        return None
    try:
        return validate_content(model, content, position)
    except SchemaError as error:
        for problem in error.problems:
            # A problem of the whole table has no position inside the table.
            separator = "" if problem.startswith(":") else "."
            problems.append(f"{position}{separator}{problem}")
        return None


def _repeated_quantities(leaves: dict[str, dict[str, Channel]]) -> list[str]:
    """Return a problem for each quantity that has more than one channel."""
    first_leaf: dict[str, str] = {}
    problems = []
    for leaf, channels in leaves.items():
        for name in channels:
            if name in first_leaf:
                problems.append(
                    f"{leaf}.{name}: already in leaf {first_leaf[name]}; a quantity has one channel"
                )
            first_leaf.setdefault(name, leaf)
    return problems
