"""Examples that come with the product: copied all at once, and never over something."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from aeromatch.cli.actions.examples import copy_example, example_folder
from aeromatch.cli.verbs import EXAMPLES, example_command
from flightmech.errors import SchemaError


def test_what_a_project_starts_from_is_copied(tmp_path):
    done = CliRunner().invoke(
        example_command, ["c182", str(tmp_path / "new" / "c182"), "--inputs-only", "--json"]
    )
    assert done.exit_code == 0, done.output
    files = json.loads(done.output)["files"]
    assert {file.split("/")[0] for file in files} == {"README.md", "datcom", "flight"}
    for file in files:
        assert (tmp_path / "new" / "c182" / file).read_bytes() == (
            example_folder("c182") / file
        ).read_bytes()
    assert list((tmp_path / "new").iterdir()) == [tmp_path / "new" / "c182"]


def test_the_current_folder_is_filled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = copy_example("c182", Path("."), inputs_only=True)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["README.md", "datcom", "flight"]
    assert all(file.is_file() for file in files)


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SchemaError, match="not an empty folder"):
        copy_example("c182", tmp_path)
    with pytest.raises(SchemaError, match="not an empty folder"):
        copy_example("c182", tmp_path / "mine.txt")
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


def test_every_example_has_a_project():
    assert all((example_folder(name) / "aeromatch.toml").is_file() for name in EXAMPLES)


def test_the_tutorial_shows_parts_of_the_finished_files():
    page = (Path(__file__).parents[2] / "docs" / "tutorials" / "light-aircraft.md").read_text(
        encoding="utf-8"
    )
    shown = "".join(re.findall(r"^```toml\n(.*?)^```$", page, re.M | re.S)).splitlines()
    files = ("aircraft.toml", "names.toml", "aeromatch.toml")
    finished = [(example_folder("c182") / name).read_text(encoding="utf-8") for name in files]
    assert len(shown) > 20
    assert set(shown) <= set("".join(finished).splitlines())
