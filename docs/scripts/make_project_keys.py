"""Page ``project-keys.md``, every key of every file of a project, from the JSON schemas. The site
has the page (`make_site`); ``python docs/scripts/make_project_keys.py`` prints it.

The schemas come from the models that read the files (`aeromatch.project.schemas`).  An example is
the first use in the shipped files, else the one that the model states.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from aeromatch.project.schemas import SCHEMAS
from flightmech.names import VOCABULARY
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import unit_of
from flighttest.records.readers.name_map import TOP

ROOT = Path(__file__).parents[2]
DATA, MAPS = ROOT / "data", ROOT / "flighttest" / "records" / "readers" / "maps"
KINDS = {  # title, file, where the examples come from
    "project": ("Project file", "aeromatch.toml", ("*/aeromatch.toml",)),
    "aircraft": ("Aircraft file", "aircraft.toml", ("*/aircraft.toml", "t37/apriori.toml")),
    "names": ("Name map", "names.toml", ("*/names*.toml",)),
    "case": ("Case file", "cases/NAME.toml", ("*/cases/*.toml", "*/cases/*/*.toml")),
    "engine": ("Structure of an engine", "key `structure` of `[engine]`", ("*/engine.toml",)),
}
LONGEST = 70  # letters of an example
HEAD = """# Keys of the files of a project

Every key of the files of a project. A *quantity* is a number in the unit in brackets, or a text
that carries its own (`"182 ft2"`). Files are named relative to the file that names them. Words in
capitals in a heading are your own names, or names of [the vocabulary](nomenclature.md). An unknown
key is an error that lists the near ones. *below*: the key is a table of its own.

`aeromatch schema` writes the same as JSON schemas. Editors with a TOML language server complete and
check the keys of a file whose first line names its schema, as the files of `aeromatch init` do:

```toml
#:schema aircraft.schema.json
```

What the keys do together: [project files](project-files.md),
[flight records](../explanation/flight-test/records.md),
[cases](../explanation/proof-of-match/cases.md), [engine](../explanation/simulation/engine.md),
[control system](../explanation/simulation/control-system.md),
[landing gear](../explanation/simulation/landing-gear.md). Examples are those of the shipped
aeroplanes.
"""


def page() -> str:
    """Return the page."""
    return HEAD + "".join(_kind(kind) for kind in KINDS)


def _kind(kind: str) -> str:
    title, file, patterns = KINDS[kind]
    schema = SCHEMAS[kind]()
    shipped = [read_toml(path) for pattern in patterns for path in sorted(DATA.glob(pattern))]
    shipped += [read_toml(path) for path in sorted(MAPS.glob("*.toml"))] if kind == "names" else []
    where = file if " " in file else f"`{file}`"
    text = f"\n## {title}\n\n{where}; `aeromatch schema {kind}`. {schema['description']}\n"
    places_of: dict[str, list[str]] = {}
    sections: dict[str, str] = {}
    for place, table in _tables(schema):
        content = json.dumps(table["properties"])
        places_of.setdefault(content, []).append(_heading(place) if place else "")
        if content not in sections:
            sections[content] = _section(place, table, schema, shipped)
    for content, section in sections.items():
        heading = ", ".join(places_of[content])
        text += (f"\n### {kind}: {heading}\n" if heading else "") + section
    return text


def _tables(
    schema: dict[str, Any], place: tuple[str, ...] = (), part: dict[str, Any] | None = None
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield place and schema of every table, a table before those inside it."""
    part = _resolved(schema, schema if part is None else part)
    if _is_by_name(part):  # its keys stand in the nomenclature; all have the same form
        yield from _tables(schema, (*place, "CHANNEL"), next(iter(part["properties"].values())))
    elif "properties" in part:
        yield place, part
        for key, inner in part["properties"].items():
            yield from _tables(schema, (*place, key), inner)
    if isinstance(part.get("additionalProperties"), dict):
        free = "/".join(part.get("propertyNames", {}).get("enum", ["NAME" if place else "TABLE"]))
        yield from _tables(schema, (*place, free), part["additionalProperties"])
    if isinstance(part.get("items"), dict):
        yield from _tables(schema, (*place, "[]"), part["items"])
    for inner in part.get("anyOf", ()):
        kind = _resolved(schema, inner).get("properties", {}).get("kind", {}).get("const")
        yield from _tables(schema, (*place[:-1], kind.upper()) if kind else place, inner)


def _resolved(schema: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    while "$ref" in part:
        part = {
            **schema["$defs"][part["$ref"].rpartition("/")[2]],
            **{key: item for key, item in part.items() if key != "$ref"},
        }
    return part


def _section(
    place: tuple[str, ...], table: dict[str, Any], schema: dict[str, Any], shipped: list[Any]
) -> str:
    # Keys with the same type, default and meaning share a row, such as the events of a case.
    keys_of: dict[tuple[str, str, str], list[str]] = {}
    examples: dict[tuple[str, str, str], str] = {}
    for key, part in table["properties"].items():
        part = _resolved(schema, part)
        cells = (_type_and_unit(schema, part), _default(table, key, part), _meaning(part))
        keys_of.setdefault(cells, []).append(f"`{key}`")
        examples.setdefault(cells, _example(schema, place, key, part, shipped))
    lines = [
        "",
        "| key | type [unit] | default | meaning | example |",
        "| --- | --- | --- | --- | --- |",
    ]
    for cells, keys in keys_of.items():
        row = (*cells, examples[cells])
        lines.append(f"| {', '.join(keys)} | {' | '.join(c.replace('|', '/') for c in row)} |")
    return "\n".join(lines) + "\n"


def _type_and_unit(schema: dict[str, Any], part: dict[str, Any]) -> str:
    """Return the type with the unit; escaped brackets, or Markdown makes a reference of them."""
    unit = unit_of(part)
    return f"{_type(schema, part)} \\[{unit}\\]" if unit else _type(schema, part)


def _default(table: dict[str, Any], key: str, part: dict[str, Any]) -> str:
    if key in table.get("required", ()):
        return "required"
    is_given = "default" in part and part["default"] not in ("", [])
    return _toml(part["default"]) if is_given else ""


def _meaning(part: dict[str, Any]) -> str:
    """Return the description without the unit, which has a column of its own."""
    text = part["description"]
    return re.sub(r" \[[^\]]*\](, or a text with its unit)?$", "", text) if unit_of(part) else text


def _heading(place: tuple[str, ...]) -> str:
    """Return a table as it is written in TOML."""
    if not place:
        return "the file"
    name = ".".join(part for part in place if part != "[]")
    return f"`[[{name}]]`" if place[-1] == "[]" else f"`[{name}]`"


def _type(schema: dict[str, Any], part: dict[str, Any]) -> str:
    part = _resolved(schema, part)
    if "const" in part or "enum" in part:
        return ", ".join(_toml(item) for item in part.get("enum", [part.get("const")]))
    if "anyOf" in part:
        return " or ".join(dict.fromkeys(_type(schema, item) for item in part["anyOf"]))
    kind = part.get("type")
    if isinstance(kind, list):
        return "quantity"
    if kind == "array":
        if "prefixItems" in part:
            return f"[{', '.join(_type(schema, item) for item in part['prefixItems'])}]"
        return f"list of {_type(schema, part.get('items', {}))}"
    return {"string": "text", "object": "table", "boolean": "true or false", None: "any"}.get(
        kind, str(kind)
    )


def _example(
    schema: dict[str, Any],
    place: tuple[str, ...],
    key: str,
    part: dict[str, Any],
    shipped: list[Any],
) -> str:
    """Return a value of the key: in the shipped files, else that of the schema."""
    if any(True for _ in _tables(schema, (*place, key), part)):
        return "below"
    found = [_toml(value) for content in shipped for value in _at(content, (*place, key))]
    stated = [_toml(item) for item in (*part.get("examples", ()), *part.get("enum", ())[-1:])]
    stated += (
        [_toml(not part["default"])] if part.get("type") == "boolean" and "default" in part else []
    )
    return next((text for text in [*found, *stated] if len(text) <= LONGEST), "-")


def _is_by_name(part: dict[str, Any]) -> bool:
    return part.get("properties", {}).keys() >= VOCABULARY.keys()


def _at(content: Any, place: tuple[str, ...]) -> Iterator[Any]:
    """Yield what stands at a place of a file; free names and items of arrays are all followed."""
    if not place:
        yield content
    elif isinstance(content, list):
        for item in content:
            yield from _at(item, place[1:] if place[0] == "[]" else place)
    elif isinstance(content, dict):
        free = {"TABLE": [name for name in content if name not in TOP]}.get(place[0], list(content))
        # V and S are keys; longer words in capitals stand for names
        is_free = place[0].isupper() and len(place[0]) > 1
        names = free if is_free else place[0].split("/")
        for name in names:
            if name in content:
                yield from _at(content[name], place[1:])


def _toml(item: Any) -> str:
    """Return a value in code marks as TOML writes it."""
    return f"`{_plain(item)}`"


def _plain(item: Any) -> str:
    if isinstance(item, dict):
        return (
            "{ " + ", ".join(f"{_key(key)} = {_plain(value)}" for key, value in item.items()) + " }"
        )
    if isinstance(item, list):
        return f"[{', '.join(map(_plain, item))}]"
    if isinstance(item, float):
        return (
            "inf"
            if item > 1e300
            else f"{item:.6g}"
            if "e" in f"{item:.6g}" or "." in f"{item:.6g}"
            else f"{item:.1f}"
        )
    return json.dumps(item, ensure_ascii=False)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name) else json.dumps(name)


if __name__ == "__main__":
    print(page(), end="")
