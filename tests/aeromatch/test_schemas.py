"""JSON schemas of the files of a project: they know the keys that the readers accept, no more and
no fewer, and explain each.
"""

import json
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner

import flightmech
from aeromatch.cli.command import cli
from aeromatch.project.project import read_project
from aeromatch.project.schemas import SCHEMAS
from flightmech.errors import AeromatchError, SchemaError
from flightmech.names import VOCABULARY
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_quantities import UNIT
from flightmech.units import parse_unit
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.sensors.instruments import parse_instruments
from flighttest.submodels.engine.tables import read_structure
from pom.cases.case import read_case

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data"
SHIPPED = {
    "project": sorted(DATA.glob("*/aeromatch.toml")),
    "aircraft": [
        *sorted(DATA.glob("*/aircraft.toml")),
        DATA / "t37" / "apriori.toml",
        ROOT / "tests" / "real" / "maps" / "ce500.toml",
    ],
    "names": [
        *sorted(DATA.glob("*/names*.toml")),
        *sorted((ROOT / "flighttest" / "readers" / "maps").glob("*.toml")),
    ],
    "case": sorted(DATA.rglob("cases/**/*.toml")),
    "engine": [DATA / "t37" / "engine.toml"],
}
FILES = [(kind, file) for kind, files in SHIPPED.items() for file in files]


def _aircraft(path: Path) -> None:
    """Read an aircraft file as a reconstruction does: its instruments too."""
    parse_instruments(flightmech.read_aircraft(path).instruments)


READERS = {
    "project": read_project,
    "aircraft": _aircraft,
    "names": read_names,
    "case": read_case,
    "engine": read_structure,
}


def plain(file: Path) -> Any:
    return json.loads(json.dumps(read_toml(file), default=str))


@pytest.fixture(scope="module")
def schemas() -> dict[str, Any]:
    return {kind: make() for kind, make in SCHEMAS.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "file"), FILES, ids=[str(file.relative_to(ROOT)) for _, file in FILES]
)
def test_shipped_files_fit_the_schema(schemas, kind, file):
    jsonschema.Draft202012Validator(schemas[kind]).validate(plain(file))


@pytest.mark.slow
@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_schema_is_one_and_every_key_is_explained(schemas, kind):
    jsonschema.Draft202012Validator.check_schema(schemas[kind])
    unexplained = [
        ".".join(place)
        for place, table in tables(schemas[kind])
        for key, part in table["properties"].items()
        if "description" not in resolved(schemas[kind], part)
    ]
    assert unexplained == []


def test_examples_of_keys_fit_them(schemas):
    for kind, schema in schemas.items():
        for place, table in tables(schema):
            for key, part in table["properties"].items():
                for example in part.get("examples", ()):
                    if place[-1:] != ("show",):
                        jsonschema.Draft202012Validator(
                            {**part, "$defs": schema.get("$defs", {})}
                        ).validate(example)
                    if UNIT in part:
                        assert np.isfinite(parse_quantity(example, part[UNIT]))
                assert part.get("default", 0) is not None, (kind, place, key)


def resolved(schema: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    """Return a part of a schema with what it refers to."""
    while "$ref" in part:
        part = {
            **schema["$defs"][part["$ref"].rpartition("/")[2]],
            **{key: item for key, item in part.items() if key != "$ref"},
        }
    return part


def tables(schema: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Yield every table with declared keys, and the place at which it stands; ``*`` is a free name,
    ``[]`` an item of an array.
    """
    waiting = [((), schema)]
    while waiting:
        place, part = waiting.pop()
        part = resolved(schema, part)
        if "properties" in part:
            yield place, part
            waiting += [
                ((*place, key), inner)
                for key, inner in part["properties"].items()
                if key not in ("properties",)
            ]
        if isinstance(part.get("additionalProperties"), dict):
            free = part.get("propertyNames", {}).get("enum", ["*"])[0]
            waiting.append(((*place, free), part["additionalProperties"]))
        if isinstance(part.get("items"), dict):
            waiting.append(((*place, "[]"), part["items"]))
        waiting += [(place, inner) for inner in part.get("anyOf", ())]


def content(place: tuple[str, ...], key: str) -> Any:
    """Return what a file holds that has `key` at a place and nothing else."""
    return nested(place, {key: "x"})


def nested(place: tuple[str, ...], item: Any) -> Any:
    """Return what a file holds that has `item` at a place and nothing else."""
    for part in reversed(place):
        item = [item] if part == "[]" else {"one" if part == "*" else part: item}
    return item


def toml(item: Any) -> str:
    if isinstance(item, dict):
        return (
            "{"
            + ", ".join(f"{json.dumps(key)} = {toml(value)}" for key, value in item.items())
            + "}"
        )
    return "[" + ", ".join(map(toml, item)) + "]" if isinstance(item, list) else json.dumps(item)


def problems(kind: str, path: Path, item: dict[str, Any]) -> str:
    """Return what the reader of a kind finds wrong."""
    if kind in (
        "project",
        "case",
        "aircraft",
    ):  # a file with one key of these is taken for one of another kind
        base = {
            "project": SHIPPED["project"][0],
            "case": SHIPPED["case"][0],
            "aircraft": SHIPPED["aircraft"][0],
        }[kind]
        item = {**{key: value for key, value in plain(base).items() if key not in item}, **item}
    path.write_text(
        "".join(f"{json.dumps(key)} = {toml(value)}\n" for key, value in item.items()),
        encoding="utf-8",
    )
    try:
        READERS[kind](path)
    except SchemaError as error:
        return "\n".join(error.problems)
    except (OSError, AeromatchError) as error:
        return str(error)
    return ""


@pytest.mark.slow
@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_reader_knows_every_key_of_the_schema_and_no_other(schemas, kind, tmp_path):
    """An unknown key is refused by both at every place, a key of the schema is unknown to the
    reader nowhere.
    """
    path = tmp_path / "file.toml"
    validator = jsonschema.Draft202012Validator(schemas[kind])
    for place, table in tables(schemas[kind]):
        if kind == "names" and place[:1] == ("decode",):
            continue
        if table.get("additionalProperties") is False:
            wrong = content(place, "zz_unknown")
            found = problems(kind, path, wrong)
            assert "zz_unknown" in found, (place, found)
            assert any(
                "zz_unknown" in error.message or error.context
                for error in validator.iter_errors(wrong)
            ), place
        if table["properties"].keys() >= VOCABULARY.keys():  # canonical names: all of them at once
            assert "unknown" not in problems(
                kind,
                path,
                nested(place, dict.fromkeys(VOCABULARY, "1" if place == ("constants",) else "x")),
            )
            continue
        for key in table["properties"]:
            found = problems(kind, path, content(place, key))
            assert f"{key}: unknown key" not in found, (place, key, found)
            assert f"unknown quantity {key!r}" not in found, (place, key, found)


def test_the_reader_knows_the_keys_of_words_and_no_others(schemas, tmp_path):
    """Which keys a table of ``[decode]`` has depends on its kind."""
    path = tmp_path / "file.toml"
    for kind in ("arinc429", "mil1553", "pcm", "analog"):
        table = schemas["names"]["$defs"][f"decode_{kind}"]
        for key in (*table["properties"], "zz_unknown"):
            found = problems(
                "names",
                path,
                {"decode": {"one": {"kind": kind, key: "x"} if key != "kind" else {"kind": kind}}},
            )
            assert (f"{key}: unknown key" in found) == (key == "zz_unknown"), (kind, key, found)


@pytest.fixture(scope="module")
def page_of_keys() -> str:
    """Return the page of all keys, as the site has it."""
    program = runpy.run_path(str(ROOT / "docs" / "scripts" / "make_project_keys.py"))
    return program["page"]()


def test_the_page_of_keys_has_an_example_of_every_key(page_of_keys):
    rows = [line for line in page_of_keys.splitlines() if line.startswith("| `")]
    assert len(rows) > 200
    assert [line for line in rows if line.endswith("| - |")] == []


def test_examples_of_quantities_are_of_the_dimension_of_their_key(page_of_keys):
    text = page_of_keys
    rows = re.findall(r'^\| (.+?) \| quantity \\\[(.+?)\\\] \|.*\| `"(.+?)"` \|$', text, re.M)
    assert len(rows) > 50
    wrong = []
    for keys, unit, example in rows:
        if " of " in f" {unit} ":
            continue  # "of the control": the unit depends on the file
        shown = example.partition(" ")[2]
        if not shown or parse_unit(shown)[0] != parse_unit(unit)[0]:
            wrong.append((keys, unit, example))
    assert wrong == []


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_verb_writes_one_schema_or_all(schemas, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(cli, ["schema", kind]).output == f"written: {kind}.schema.json\n"
    assert (
        json.loads((tmp_path / f"{kind}.schema.json").read_text(encoding="utf-8")) == schemas[kind]
    )


def test_the_verb_writes_all_schemas_into_a_folder(schemas, tmp_path):
    done = CliRunner().invoke(cli, ["schema", "-o", str(tmp_path / "new"), "--json"])
    assert json.loads(done.output) == {
        "files": [str(tmp_path / "new" / f"{kind}.schema.json") for kind in SCHEMAS]
    }
    assert {
        kind: json.loads((tmp_path / "new" / f"{kind}.schema.json").read_text(encoding="utf-8"))
        for kind in SCHEMAS
    } == schemas
