"""Tests of the parameters of the engine that the threads of a search share."""

from collections.abc import Iterator, Mapping
from threading import Thread

import numpy as np

from flighttest.submodels.engine.bench import _CachedParameters

ROWS = np.array([[1.0, 2.0]])


class _InterruptedSetting(Mapping):
    """Parameters that let a second thread request the same rows while they are being stored."""

    def __init__(self, values: dict[str, float], ask: Thread):
        self.values_of_names, self.ask = values, ask

    def __getitem__(self, name: str) -> float:
        if not self.ask.is_alive() and self.ask.ident is None:
            self.ask.start()
            self.ask.join(0.05)  # a thread that waits for the whole result is still alive then
        return self.values_of_names[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.values_of_names)

    def __len__(self) -> int:
        return len(self.values_of_names)


def test_a_second_thread_receives_all_parameters() -> None:
    """A thread that requests the same rows during their expansion must not get a part of them."""
    answers: list[dict[str, np.ndarray]] = []
    second = Thread(target=lambda: answers.append(dict(parameters(ROWS))))
    values = {"engine1.lag": 1.0, "engine1.rate": 2.0}
    parameters = _CachedParameters(lambda row: _InterruptedSetting(values, second))
    first = dict(parameters(ROWS))
    second.join()
    assert set(first) == set(answers[0]) == set(values)
