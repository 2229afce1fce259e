"""``aeromatch set``: one key of a project's TOML file, with the rest of the text and its comments
as they are.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import tomlkit
from tomlkit.exceptions import TOMLKitError

from aeromatch.project.project import read_project
from flightmech.aircraft.aircraft import read_aircraft
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.support.atomic_write import written_atomically
from flightmech.support.console import InputFile, NewFile, json_option, print_json
from flightmech.support.input_files import file_kind, read_toml
from flighttest.records.readers.name_map_reading import read_names
from pom.cases.case import read_case

_KEY = re.compile(r'"([^"]+)"|([^."]+)')


def _demand_project(path: Path) -> None:

    read_project(path)


def _demand_aircraft(path: Path) -> None:

    read_aircraft(path)


def _demand_case(path: Path) -> None:

    read_case(path)


def _demand_names(path: Path) -> None:

    read_names(path)


_READERS: dict[str, Callable[[Path], None]] = {
    "a project file": _demand_project,
    "an aircraft file": _demand_aircraft,
    "a case file": _demand_case,
}


def set_key(path: str | Path, key: str, value: str | None) -> Any:
    """Change one key of a project, aircraft, case or name file; the file is written when it still
    reads well as a whole.

    Parameters
    ----------
    path : path
        TOML.
    key : str
        With dots; a number is the place in a list, from 0, and ``+`` the end of it:
        ``fit.2.models``, ``fit.+``, ``terms."CL/gear".stderr``.  A name with dots needs no quotes,
        ``controls.engine1.throttle``: it is found however the file writes it.
    value : str or None
        As written in TOML (``0.05``, ``["Cm/qhat"]``, ``"4 Hz"``); else taken as a text. None
        removes the key.

    Returns
    -------
    The new value, as plain data.

    Raises
    ------
    SchemaError
        No such place, or the file with the change has problems; it stays as it was.
    """
    path = Path(path)
    content = _content(path)
    new = _changed(content, path, key, value)
    _write(content, path, path)
    return getattr(new, "unwrap", lambda: new)()


TRIAL = "TRIAL, no part of the proof of match"


def write_trial(path: str | Path, output: str | Path, changes: Sequence[tuple[str, str]]) -> None:
    """Write a copy of a case file with other keys, marked as a trial in its title and notes; the
    case file stays as it is.

    Parameters
    ----------
    path : path
        Case file.
    output : path
        The copy; the files that it names are named relative to it.
    changes : sequence of (str, str)
        Keys and values as in `set_key`.

    Raises
    ------
    SchemaError
        No case file, no such place, or the copy has problems; it is not written.
    """

    path, output = Path(path), Path(output)
    if not file_kind(path).startswith("a case file"):
        raise SchemaError(
            str(path), [f"it is {file_kind(path)}; a trial is the copy of a case file"]
        )
    if output.resolve() == path.resolve():
        raise SchemaError(str(output), ["it is the case file itself; give the trial another name"])
    content = _content(path)
    for key, value in changes:
        _changed(content, path, key, value)
    case = content["case"]
    for table, keys in (
        (case, ("record", "names", "aircraft")),
        (content.get("control_law", {}), ("fmu", "names")),
    ):
        for name in keys:
            _rebase(table, name, path, output)
    for name in content.get("models", {}):
        _rebase(content["models"], name, path, output)
    stated = ", ".join(f"{key} = {value}" for key, value in changes)
    case["title"] = f"{TRIAL}: {case['title']}"
    case["notes"] = f"{TRIAL}: a copy of {path.name} with {stated}. {case.get('notes', '')}".strip()
    _write(content, path, output)


def _rebase(table: Any, key: str, path: Path, output: Path) -> None:
    if name := table.get(key, ""):
        table[key] = Path(
            os.path.relpath(path.resolve().parent / name, output.resolve().parent)
        ).as_posix()


def _content(path: Path) -> Any:
    """Return the content of a file with its comments."""

    read_toml(path)  # limits and errors of a user's text
    return tomlkit.parse(path.read_text(encoding="utf-8-sig"))


def _changed(content: Any, path: Path, key: str, value: str | None) -> Any:
    """Put a value at its place, and return it."""

    places = [quoted or plain for quoted, plain in _KEY.findall(key)]
    if not places:
        raise SchemaError(str(path), [f"key {key!r}; write it with dots, such as fit.2.models"])
    *outer, last = _as_written(content, places)
    places = [*outer, last]
    item: Any = content
    above: list[tuple[Any, str]] = []
    for number, place in enumerate(outer):
        made = tomlkit.aot if places[number + 1] == "+" else tomlkit.table
        above.append((item, place))
        item = _inside(
            item, place, path, ".".join(places[: number + 1]), made if value is not None else None
        )
    if value is None:
        _remove(item, last, path, key)
        while (
            above and item == {} and isinstance(above[-1][0], dict) and not _has_heading(*above[-1])
        ):  # engine1 of engine1.throttle
            item, place = above.pop()
            del item[place]
        return None
    new = _parsed(value)
    _put(item, last, new, path, key)
    return new


def _as_written(content: Any, places: list[str]) -> list[str]:
    """Return the places of a key as the file has them: a name with dots may be one key in quotes,
    or a table in a table.
    """
    item, found, rest = content, [], list(places)
    while rest:
        used = 1
        if isinstance(item, dict):
            used = next(
                (number for number in range(len(rest), 0, -1) if ".".join(rest[:number]) in item), 0
            )
            head, dot, tail = rest[0].partition(".")
            if not used and dot and isinstance(item.get(head), dict):
                rest[:1] = [head, tail]
            used = used or 1
        place = ".".join(rest[:used])
        found.append(place)
        rest = rest[used:]
        if isinstance(item, list):
            item = item[int(place)] if place.isdigit() and int(place) < len(item) else None
        else:
            item = item.get(place) if isinstance(item, dict) else None
    return found


def _write(content: Any, path: Path, output: Path) -> None:
    """Write the content of a changed file of the kind of `path`, when it reads well."""

    kind = next((kind for kind in _READERS if file_kind(path).startswith(kind)), "")
    demand, text = _READERS.get(kind, _demand_names), tomlkit.dumps(content)
    if tomlkit.parse(text).unwrap() != content.unwrap():
        raise SchemaError(
            str(path),
            [
                "the change cannot be made between the other lines of the file; make it with "
                "an editor"
            ],
        )
    with written_atomically(output) as part:
        part.write_text(text, encoding="utf-8", newline="")
        _demand_sound(demand, part, output)


def _demand_sound(demand: Callable[[Path], None], part: Path, path: Path) -> None:
    """Read the new file where it stands, next to the old one; its problems carry the name of the
    file.
    """

    try:
        demand(part)
    except SchemaError as error:
        raise SchemaError(
            str(path), [text.replace(str(part), str(path)) for text in error.problems]
        ) from None
    except ParseError as error:
        raise SchemaError(str(path), [str(error).replace(str(part), str(path))]) from None


def _inside(item: Any, place: str, path: Path, shown: str, create: Callable[[], Any] | None) -> Any:

    if isinstance(item, list):
        if place.isdigit() and int(place) < len(item):
            return item[int(place)]
        raise SchemaError(str(path), [f"{shown}: the list has {len(item)} entries, from 0"])
    if not isinstance(item, dict):
        raise SchemaError(str(path), [f"{shown}: {place!r} is inside a value"])
    if place not in item:
        if create is None:
            raise SchemaError(str(path), [f"{shown}: {UnknownName(place, list(item), 'key')}"])
        item[place] = create()
    return item[place]


def _put(item: Any, place: str, new: Any, path: Path, key: str) -> None:

    if isinstance(item, list):
        if place == "+":
            item.append(_in_lines(new))
        elif place.isdigit() and int(place) < len(item):
            item[int(place)] = _filled(item[int(place)], new)
        else:
            raise SchemaError(
                str(path), [f"{key}: the list has {len(item)} entries, from 0; + appends one"]
            )
    elif isinstance(item, dict):
        item[place] = _filled(item[place], new) if _has_heading(item, place) else new
    else:
        raise SchemaError(str(path), [f"{key}: {place!r} is inside a value"])


def _remove(item: Any, place: str, path: Path, key: str) -> None:

    if isinstance(item, list) and place.isdigit() and int(place) < len(item):
        del item[int(place)]
    elif isinstance(item, dict) and place in item:
        del item[place]
    else:
        known = (
            list(item) if isinstance(item, dict) else [str(number) for number in range(len(item))]
        )
        raise SchemaError(str(path), [f"{key}: {UnknownName(place, known, 'key')}"])


def _parsed(value: str) -> Any:
    """Return a value as TOML has it, else the text itself."""

    try:
        found = tomlkit.value(value)
    except (TOMLKitError, ValueError):
        return tomlkit.string(value)
    return found


def _in_lines(new: Any) -> Any:
    """Return a table line by line, as one of [[fit]] or [terms.X] is written; all else as it is."""

    if not isinstance(new, tomlkit.items.InlineTable):
        return new
    lines = tomlkit.table()
    for name, entry in new.items():
        lines.add(name, entry)
    return lines


def _filled(old: Any, new: Any) -> Any:
    """Return a table with a heading that holds what the new one does, with its comments; all else
    than two tables: the new one.
    """

    if not (isinstance(old, tomlkit.items.Table) and isinstance(new, tomlkit.items.InlineTable)):
        return new
    for name in [name for name in old if name not in new]:
        del old[name]
    for name, entry in new.items():
        old[name] = entry
    return old


def _has_heading(item: Any, place: str) -> bool:
    """Whether what stands at a place of a table is a table with a heading of its own, such as
    [terms.X].
    """

    if not isinstance(item.get(place), tomlkit.items.Table):
        return False
    body = item.body if isinstance(item, tomlkit.TOMLDocument) else item.value.body
    return not any(key is not None and key.key == place and key.is_dotted() for key, _ in body)


@click.command("set")
@click.argument("file", type=InputFile(path_type=Path))
@click.argument("key")
@click.argument("value", required=False)
@click.option("--remove", is_flag=True, help="Take the key out.")
@click.option(
    "--trial",
    type=NewFile(),
    help="Copy of a case file to write with the change, marked as a trial in title and notes; "
    "FILE stays as it is.",
)
@click.option(
    "--also",
    nargs=2,
    multiple=True,
    metavar="KEY VALUE",
    help="Another key of the copy and its value, with --trial; may be repeated.",
)
@json_option
def set_verb(
    file: Path,
    key: str,
    value: str | None,
    remove: bool,
    trial: str | None,
    also: tuple[tuple[str, str], ...],
    as_json: bool,
) -> None:
    """Change KEY of a project, aircraft, case or name FILE to VALUE (TOML, or a text); the
    remainder of the file stays as it is.

    The file is checked with the change and is left alone when it has a problem. Example: aeromatch
    set aeromatch.toml fit.0.models '["CL = 1 + alpha"]'
    """
    if (value is None) != remove:
        raise click.UsageError("give a VALUE, or --remove")
    if trial is None and also:
        raise click.UsageError("--also goes with --trial")
    if trial is not None:
        if value is None:
            raise click.UsageError("a trial takes values; leave --remove out")
        changes = [(key, value), *also]
        write_trial(file, trial, changes)
        if as_json:
            print_json({"file": trial, "trial of": str(file), "changes": dict(changes)})
        else:
            click.echo(
                f"written: {trial}, a trial of {file} with "
                + ", ".join(f"{one} = {other}" for one, other in changes)
            )
        return
    new = set_key(file, key, value)
    if as_json:
        print_json({"file": str(file), "key": key, "value": new})
    else:
        click.echo(f"written: {file}, {key} " + ("removed" if remove else f"= {new}"))
