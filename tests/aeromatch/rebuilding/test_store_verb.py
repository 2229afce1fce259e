"""``aeromatch store``."""

import json

import numpy as np
import pytest

from flightmech.support.kept_stages.stages import Stages
from flightmech.support.kept_stages.store import LIMIT, PLACE, StageStore


@pytest.fixture
def filled(tmp_path, monkeypatch):
    """The folder of a store with a path of 16 kB and two fits."""
    monkeypatch.setenv(PLACE, str(tmp_path / "store"))
    stages = Stages(StageStore(tmp_path / "store"))
    stages.one("path", {}, lambda: np.zeros(2000))
    for k in range(2):
        stages.one("fit", {"k": k}, lambda k=k: k)
    return tmp_path / "store"


def test_the_verb_shows_what_is_kept(aeromatch, filled, monkeypatch):
    monkeypatch.setenv(LIMIT, "1 MB")
    found = aeromatch("store", "info")
    assert found.returncode == 0
    assert str(filled) in found.stdout.replace("\n", "")
    assert "of at most 1 MB" in found.stdout
    document = json.loads(aeromatch("store", "info", "--json").stdout)
    assert {name: stage["count"] for name, stage in document["stages"].items()} == {
        "fit": 2,
        "path": 1,
    }
    assert (
        16_000 < document["bytes"] == sum(stage["bytes"] for stage in document["stages"].values())
    )
    assert document["limit"] == 1_000_000


def test_the_verb_clears_all_or_down_to_a_size(aeromatch, filled):
    assert aeromatch("store", "clear", "--to", "1kB").returncode == 0
    assert StageStore(filled).usage().keys() == {"fit"}
    assert aeromatch("store", "clear").returncode == 0
    assert StageStore(filled).usage() == {}


def test_a_store_that_is_switched_off_and_a_size_that_is_none_are_errors(
    aeromatch, filled, monkeypatch
):
    assert "'much' is not a size" in aeromatch("store", "clear", "--to", "much").stderr
    monkeypatch.setenv(PLACE, "off")
    found = aeromatch("store", "info")
    assert found.returncode == 2
    assert "switched off" in found.stderr


@pytest.mark.parametrize("words", [["match"], ["match", "--plan"]])
def test_a_size_that_is_none_is_an_error_before_the_match(aeromatch, filled, monkeypatch, words):
    """The match would compute for minutes, and fail when it shortens the store at its end."""
    monkeypatch.setenv(LIMIT, "much")
    # the project, which is no TOML, is not read before the size
    project = filled.parent / "project.toml"
    project.write_text("= no TOML", encoding="utf-8")
    found = aeromatch(*words, "-o", filled.parent / "out", project)
    assert found.returncode == 2
    assert "'much' is not a size" in found.stderr
