"""``aeromatch set``: one key of a project's TOML file, with the rest of the text and its comments as they are."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from flightmech.support.console import InputFile, document, json_option

_KEY = re.compile(r'"([^"]+)"|([^."]+)')


def _demand_project(path: Path) -> None:
    from .project import read_project

    read_project(path)


def _demand_aircraft(path: Path) -> None:
    from flightmech import read_aircraft

    read_aircraft(path)


def _demand_case(path: Path) -> None:
    from pom import read_case

    read_case(path)


def _demand_names(path: Path) -> None:
    from flighttest.readers import read_names

    read_names(path)


_READERS: dict[str, Callable[[Path], None]] = {
    "a project file": _demand_project,
    "an aircraft file": _demand_aircraft,
    "a case file": _demand_case,
}


def set_key(path: str | Path, key: str, value: str | None) -> Any:
    """Change one key of a project, aircraft, case or name file; the file is written when it still reads well as a whole.

    Parameters
    ----------
    path : path
        TOML.
    key : str
        With dots; a number is the place in a list, from 0, and ``+`` the end of it: ``fit.2.models``, ``fit.+``,
        ``terms."CL/gear".stderr``.
    value : str or None
        As written in TOML (``0.05``, ``["Cm/qhat"]``, ``"4 Hz"``); else taken as a text. None removes the key.

    Returns
    -------
    The new value, as plain data.

    Raises
    ------
    SchemaError
        No such place, or the file with the change has problems; it stays as it was.
    """
    import tomlkit

    from flightmech.errors import SchemaError
    from flightmech.support.atomic_write import written_atomically
    from flightmech.support.configuration import load
    from flightmech.support.file_kinds import file_kind

    path = Path(path)
    load(path)  # limits and errors of a user's text
    text = path.read_text(encoding="utf-8-sig")
    content = tomlkit.parse(text)
    places = [quoted or plain for quoted, plain in _KEY.findall(key)]
    if not places:
        raise SchemaError(str(path), [f"key {key!r}; write it with dots, such as fit.2.models"])
    *outer, last = places
    item: Any = content
    for number, place in enumerate(outer):
        made = tomlkit.aot if places[number + 1] == "+" else tomlkit.table
        item = _inside(item, place, path, ".".join(places[: number + 1]), made if value is not None else None)
    if value is None:
        _remove(item, last, path, key)
        new = None
    else:
        new = _parsed(value)
        _put(item, last, new, path, key)
    kind = next((kind for kind in _READERS if file_kind(path).startswith(kind)), "")
    demand = _READERS.get(kind, _demand_names)
    with written_atomically(path) as part:
        part.write_text(tomlkit.dumps(content), encoding="utf-8", newline="")
        _demand_sound(demand, part, path)
    return getattr(new, "unwrap", lambda: new)()


def _demand_sound(demand: Callable[[Path], None], part: Path, path: Path) -> None:
    """Read the new file where it stands, next to the old one; its problems carry the name of the file."""
    from flightmech.errors import ParseError, SchemaError

    try:
        demand(part)
    except SchemaError as error:
        raise SchemaError(str(path), [text.replace(str(part), str(path)) for text in error.problems]) from None
    except ParseError as error:
        raise SchemaError(str(path), [str(error).replace(str(part), str(path))]) from None


def _inside(item: Any, place: str, path: Path, shown: str, create: Callable[[], Any] | None) -> Any:
    from flightmech.errors import SchemaError, UnknownName

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
    from flightmech.errors import SchemaError

    if isinstance(item, list):
        if place == "+":
            item.append(new)
        elif place.isdigit() and int(place) < len(item):
            item[int(place)] = new
        else:
            raise SchemaError(str(path), [f"{key}: the list has {len(item)} entries, from 0; + appends one"])
    elif isinstance(item, dict):
        item[place] = new
    else:
        raise SchemaError(str(path), [f"{key}: {place!r} is inside a value"])


def _remove(item: Any, place: str, path: Path, key: str) -> None:
    from flightmech.errors import SchemaError, UnknownName

    if isinstance(item, list) and place.isdigit() and int(place) < len(item):
        del item[int(place)]
    elif isinstance(item, dict) and place in item:
        del item[place]
    else:
        known = list(item) if isinstance(item, dict) else [str(number) for number in range(len(item))]
        raise SchemaError(str(path), [f"{key}: {UnknownName(place, known, 'key')}"])


def _parsed(value: str) -> Any:
    """Return a value as TOML has it, else the text itself."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        found = tomlkit.value(value)
    except (TOMLKitError, ValueError):
        return tomlkit.string(value)
    if isinstance(found, tomlkit.items.InlineTable):  # of [[fit]] or [terms.X]: a table of its own, line by line
        lines = tomlkit.table()
        for name, entry in found.items():
            lines.add(name, entry)
        return lines
    return found


@click.command("set")
@click.argument("file", type=InputFile(path_type=Path))
@click.argument("key")
@click.argument("value", required=False)
@click.option("--remove", is_flag=True, help="Take the key out.")
@json_option
def set_verb(file: Path, key: str, value: str | None, remove: bool, as_json: bool) -> None:
    """Change KEY of a project, aircraft, case or name FILE to VALUE (TOML, or a text); the rest of the file stays as it is.

    The file is checked with the change and is left alone when it has a problem. Example: aeromatch set aeromatch.toml fit.0.models
    '["CL = 1 + alpha"]'
    """
    if (value is None) != remove:
        raise click.UsageError("give a VALUE, or --remove")
    new = set_key(file, key, value)
    if as_json:
        document({"file": str(file), "key": key, "value": new})
    else:
        click.echo(f"written: {file}, {key} " + ("removed" if remove else f"= {new}"))
