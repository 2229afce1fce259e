"""Edits of single keys of a TOML file of a project, and the command ``aeromatch set``.

All other lines of the file and its comments stay unchanged.
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
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.support.atomic_write import ContentAsRead, written_atomically
from flightmech.support.console import InputFile, NewFile, json_option, print_json
from flightmech.support.file_kinds import file_kind
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_quantities import CONFIRM, NOT_GIVEN
from flighttest.records.readers.name_map_reading import read_names
from pom.cases.case import read_case

# A part of a key: text in quotes, or text without dots.
_KEY_PART = re.compile(r'"([^"]+)"|([^."]+)')
# Key of a case and of its control law that name a file.
_CASE_FILES = ("record", "names", "aircraft")
_LAW_FILES = ("fmu", "names")

# Functions that read a file of each kind and raise on its problems.
_READERS: dict[str, Callable[[Path], object]] = {
    "a project file": read_project,
    "an aircraft file": read_aircraft,
    "a case file": read_case,
}


def set_key(path: str | Path, key: str, value: str | None) -> Any:
    """Change one key of a project, aircraft, case or name file.

    The file is written only if it can be read with the change.

    Parameters
    ----------
    path : path
        TOML file.
    key : str
        Names with dots.  A number is a position in a list, from 0, and ``+`` is its end:
        ``fit.2.models``, ``fit.+``, ``terms."CL/gear".stderr``.  A name with dots needs no quotes:
        ``controls.engine1.throttle`` matches all spellings of TOML.
    value : str or None
        Value as written in TOML (``0.05``, ``["Cm/qhat"]``, ``"4 Hz"``); any other text is a
        string.  None removes the key.

    Returns
    -------
    object
        New value as plain data.

    Raises
    ------
    SchemaError
        The file has no such key, or the file with the change has problems.  The file is unchanged.
    """
    path = Path(path)
    # read before the document: a change in between is refused, and not lost
    as_read = ContentAsRead(path)
    document = _read_document(path)
    item = _change_document(document, path, key, value)
    _write_document(document, path, path, as_read.demand_unchanged)
    return item.unwrap() if hasattr(item, "unwrap") else item


TRIAL = "TRIAL, no part of the proof of match"


def write_trial(path: str | Path, output: str | Path, changes: Sequence[tuple[str, str]]) -> None:
    """Write a changed copy of a case file, marked as a trial in its title and notes.

    Parameters
    ----------
    path : path
        Case file; it stays unchanged.
    output : path
        Path of the copy.  The files that it names are relative to it.
    changes : sequence of (str, str)
        Keys and values as in `set_key`.

    Raises
    ------
    SchemaError
        The file is not a case file, it has no such key, or the copy has problems.  The copy is not
        written.
    """
    path, output = Path(path), Path(output)
    if not file_kind(path).startswith("a case file"):
        raise SchemaError(
            str(path), [f"it is {file_kind(path)}; a trial is the copy of a case file"]
        )
    if output.resolve() == path.resolve():
        raise SchemaError(str(output), ["it is the case file itself; give the trial another name"])
    document = _read_document(path)
    for key, value in changes:
        _change_document(document, path, key, value)
    case = document["case"]
    _move_references(case, _CASE_FILES, path, output)
    _move_references(document.get("control_law", {}), _LAW_FILES, path, output)
    models = document.get("models", {})
    _move_references(models, tuple(models), path, output)
    listed = ", ".join([f"{key} = {value}" for key, value in changes])
    notes = case.get("notes", "")
    case["title"] = f"{TRIAL}: {case['title']}"
    case["notes"] = f"{TRIAL}: a copy of {path.name} with {listed}. {notes}".strip()
    _write_document(document, path, output)


def _move_references(table: Any, keys: Sequence[str], path: Path, output: Path) -> None:
    """Make file names of a table, relative to `path`, relative to the folder of `output`."""
    folder = output.resolve().parent
    for key in keys:
        name = table.get(key, "")
        if name:
            file = path.resolve().parent / name
            table[key] = Path(os.path.relpath(file, folder)).as_posix()


def _read_document(path: Path) -> Any:
    """Return the content of a file with its comments."""
    # This reader limits the size of a file and explains errors of its text.
    read_toml(path)
    return tomlkit.parse(path.read_text(encoding="utf-8-sig"))


def _change_document(document: Any, path: Path, key: str, value: str | None) -> Any:
    """Set or remove the value of a key, and return the new value."""
    parts = [quoted or plain for quoted, plain in _KEY_PART.findall(key)]
    if not parts:
        raise SchemaError(str(path), [f"key {key!r}; write it with dots, such as fit.2.models"])
    *outer, last = _match_spelling(document, parts)
    parts = [*outer, last]
    item: Any = document
    # Containers of the value, from the outermost, each with the key of the next one.
    containers: list[tuple[Any, str]] = []
    for number, part in enumerate(outer):
        create = None
        if value is not None:
            # A list of tables is created for ``+``, otherwise a table.
            create = tomlkit.aot if parts[number + 1] == "+" else tomlkit.table
        containers.append((item, part))
        item = _enter_container(item, part, path, key=".".join(parts[: number + 1]), create=create)
    if value is None:
        _remove_value(item, last, path, key)
        _remove_empty_tables(item, containers)
        return None
    new = _parse_value(value)
    _set_value(item, last, new, path=path, key=key)
    return new


def _remove_empty_tables(item: Any, containers: list[tuple[Any, str]]) -> None:
    """Remove an empty table without a heading from its container, for example engine1 of
    ``engine1.throttle``.
    """
    while containers:
        container, part = containers.pop()
        is_empty = item == {} and isinstance(container, dict)
        if not is_empty or _has_heading(container, part):
            return
        del container[part]
        item = container


def _match_spelling(document: Any, parts: list[str]) -> list[str]:
    """Return the parts of a key in the spelling of the file.

    A name with dots may be one key in quotes, or a key of a table in a table.
    """
    item: Any = document
    matched, remaining = [], list(parts)
    while remaining:
        count = 1
        if isinstance(item, dict):
            count = _longest_key(item, remaining)
            head, dot, tail = remaining[0].partition(".")
            if not count and dot and isinstance(item.get(head), dict):
                remaining[:1] = [head, tail]
            count = count or 1
        part = ".".join(remaining[:count])
        matched.append(part)
        remaining = remaining[count:]
        item = _item_or_none(item, part)
    return matched


def _longest_key(table: dict[str, Any], parts: Sequence[str]) -> int:
    """Return the largest number of parts that together are a key of a table; 0 without a key."""
    for count in range(len(parts), 0, -1):
        if ".".join(parts[:count]) in table:
            return count
    return 0


def _item_or_none(item: Any, part: str) -> Any:
    """Return the item of a list or table, or None."""
    if isinstance(item, list):
        return item[int(part)] if _is_index(part, item) else None
    return item.get(part) if isinstance(item, dict) else None


def _is_index(part: str, items: Sequence[Any]) -> bool:
    return part.isdigit() and int(part) < len(items)


def _write_document(
    document: Any, path: Path, output: Path, before: Callable[[Path], None] | None = None
) -> None:
    """Write a changed document of the kind of `path`, if it can be read.

    `before` is that of `written_atomically`.
    """
    text = tomlkit.dumps(document)
    # Some changes cannot be expressed between dotted keys, and would be lost.
    if tomlkit.parse(text).unwrap() != document.unwrap():
        problem = (
            "the change cannot be made between the other lines of the file; make it with an editor"
        )
        raise SchemaError(str(path), [problem])
    read = _reader_of(path)
    with written_atomically(output, before) as part:
        part.write_text(text, encoding="utf-8", newline="")
        _check_file(read, part, output, former=path)


def _reader_of(path: Path) -> Callable[[Path], object]:
    """Return the function that reads files of the kind of a file."""
    kind = file_kind(path)
    for start, read in _READERS.items():
        if kind.startswith(start):
            return read
    return read_names


def _check_file(read: Callable[[Path], object], part: Path, path: Path, former: Path) -> None:
    """Read the new file next to the old one; raise its problems under the name of the file.

    Values that the `former` file leaves open too are not problems: a drafted file is filled one
    value after the other.
    """
    try:
        read(part)
    except SchemaError as error:
        if set(error.problems) <= set(_open_values(read, former)):
            return
        problems = [text.replace(str(part), str(path)) for text in error.problems]
        raise SchemaError(str(path), problems) from None
    except ParseError as error:
        raise SchemaError(str(path), [str(error).replace(str(part), str(path))]) from None


def _open_values(read: Callable[[Path], object], path: Path) -> list[str]:
    """Return the problems of a file that are values without a content yet; none without a file."""
    try:
        read(path)
    except SchemaError as error:
        return [text for text in error.problems if NOT_GIVEN in text]
    except (ParseError, OSError):
        return []
    return []


def _enter_container(
    item: Any, part: str, path: Path, key: str, create: Callable[[], Any] | None
) -> Any:
    """Return the item of a list or table, which is created on request.

    ``key`` is the whole key down to the item, for messages.
    """
    if isinstance(item, list):
        if _is_index(part, item):
            return item[int(part)]
        raise SchemaError(str(path), [f"{key}: the list has {len(item)} entries, from 0"])
    if not isinstance(item, dict):
        raise SchemaError(str(path), [f"{key}: {part!r} is inside a value"])
    if part not in item:
        if create is None:
            raise SchemaError(str(path), [f"{key}: {UnknownName(part, list(item), 'key')}"])
        item[part] = create()
    return item[part]


def _set_value(item: Any, part: str, new: Any, path: Path, key: str) -> None:
    """Set an item of a list or table."""
    if isinstance(item, list):
        if part == "+":
            item.append(_expand_table(new))
        elif _is_index(part, item):
            item[int(part)] = _replace_content(item[int(part)], new)
        else:
            raise SchemaError(
                str(path), [f"{key}: the list has {len(item)} entries, from 0; + appends one"]
            )
    elif not isinstance(item, dict):
        raise SchemaError(str(path), [f"{key}: {part!r} is inside a value"])
    elif _has_heading(item, part):
        item[part] = _replace_content(item[part], new)
    else:
        item[part] = new
        _confirm(item[part])


def _confirm(item: Any) -> None:
    """Remove the request for a confirmation from the comment behind a value.

    A value that the author writes is confirmed, also if it is the drafted one.
    """
    trivia = getattr(item, "trivia", None)
    if trivia is None or CONFIRM not in trivia.comment:
        return
    trivia.comment = trivia.comment.partition(CONFIRM)[0].rstrip(" ;#")
    if not trivia.comment:
        trivia.comment_ws = ""


def _remove_value(item: Any, part: str, path: Path, key: str) -> None:
    """Remove an item of a list or table."""
    if isinstance(item, list) and _is_index(part, item):
        del item[int(part)]
        return
    if isinstance(item, dict):
        if part in item:
            del item[part]
            return
        available = list(item)
    else:
        available = [str(number) for number in range(len(item))]
    raise SchemaError(str(path), [f"{key}: {UnknownName(part, available, 'key')}"])


def _parse_value(value: str) -> Any:
    """Return a value of TOML; any other text is a string."""
    try:
        return tomlkit.value(value)
    except (TOMLKitError, ValueError):
        return tomlkit.string(value)


def _expand_table(new: Any) -> Any:
    """Return an inline table as a table with one line per key, as ``[[fit]]`` has it."""
    if not isinstance(new, tomlkit.items.InlineTable):
        return new
    table = tomlkit.table()
    for name, entry in new.items():
        table.add(name, entry)
    return table


def _replace_content(old: Any, new: Any) -> Any:
    """Return a table with a heading that has the content of a new table and its own comments.

    Any other pair gives the new item.
    """
    if not (isinstance(old, tomlkit.items.Table) and isinstance(new, tomlkit.items.InlineTable)):
        return new
    for name in list(old):
        if name not in new:
            del old[name]
    for name, entry in new.items():
        old[name] = entry
    return old


def _has_heading(container: Any, part: str) -> bool:
    """Return whether an item is a table with a heading, such as ``[terms.X]``."""
    if not isinstance(container.get(part), tomlkit.items.Table):
        return False
    if isinstance(container, tomlkit.TOMLDocument):
        body = container.body
    else:
        body = container.value.body
    # A dotted key such as engine1.throttle makes a table without a heading.
    keys = [key for key, _ in body if key is not None]
    return not any(key.key == part and key.is_dotted() for key in keys)


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
    if trial is None:
        new = set_key(file, key, value)
        if as_json:
            print_json({"file": str(file), "key": key, "value": new})
            return
        change = "removed" if remove else f"= {new}"
        click.echo(f"written: {file}, {key} {change}")
        return
    if value is None:
        raise click.UsageError("a trial takes values; leave --remove out")
    changes = [(key, value), *also]
    write_trial(file, trial, changes)
    if as_json:
        print_json({"file": trial, "trial of": str(file), "changes": dict(changes)})
        return
    listed = ", ".join([f"{name} = {text}" for name, text in changes])
    click.echo(f"written: {trial}, a trial of {file} with {listed}")
