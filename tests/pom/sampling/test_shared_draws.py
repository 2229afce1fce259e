"""Tests of the draws that the threads of a process share."""

from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest

from pom.diagnosis.sampling import sampled_replay

WAIT = 0.05  # [s] a thread that waits for the lock is still alive after this time


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """Return an FMU and a database, of which only the state of the file matters here."""
    fmu, database = tmp_path / "model.fmu", tmp_path / "database.nc"
    fmu.write_bytes(b"fmu")
    database.write_bytes(b"database")
    return fmu, database


class _CountedDraws:
    """Stands for `DrawnModels`; it counts the draws, and runs a function during the first draw."""

    def __init__(self, during_first: Callable[[], None]):
        self.seeds: list[int] = []
        self.during_first = during_first

    def of(self, fmu: Path, database: Path, count: int, seed: int) -> str:
        self.seeds.append(seed)
        if len(self.seeds) == 1:
            self.during_first()
        return f"draws of seed {seed}"


class _InterruptedStore(dict):
    """A store that lets another thread draw just after the first draws were stored."""

    second: Thread

    def __setitem__(self, key: object, draws: object) -> None:
        super().__setitem__(key, draws)
        if self.second.ident is None:
            self.second.start()
            self.second.join(WAIT)


def test_a_second_thread_does_not_draw_again(
    files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread that requests draws while they are computed receives those draws."""
    received: list[object] = []

    def ask() -> None:
        received.append(sampled_replay.drawn_models(*files, 3, 0))

    second = Thread(target=ask)

    def start_second() -> None:
        second.start()
        second.join(WAIT)

    draws = _CountedDraws(start_second)
    monkeypatch.setattr(sampled_replay, "DrawnModels", draws)
    monkeypatch.setattr(sampled_replay, "_drawn", {})
    ask()
    second.join()
    assert received == ["draws of seed 0"] * 2
    assert draws.seeds == [0]


def test_a_second_thread_does_not_drop_draws_before_they_are_returned(
    files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a store for one model, the draws of a second thread replace those of the first."""
    received: list[object] = []
    store = _InterruptedStore()
    store.second = Thread(
        target=lambda: received.append(sampled_replay.drawn_models(*files, 3, seed=1))
    )
    monkeypatch.setattr(sampled_replay, "DrawnModels", _CountedDraws(lambda: None))
    monkeypatch.setattr(sampled_replay, "_drawn", store)
    monkeypatch.setattr(sampled_replay, "_MOST_DRAWN", 1)
    first = sampled_replay.drawn_models(*files, 3, seed=0)
    store.second.join()
    assert (first, received) == ("draws of seed 0", ["draws of seed 1"])
