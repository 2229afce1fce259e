"""Tests of results and warnings of stages that run in threads."""

import warnings
from threading import Event, Thread

import pytest

from flightmech.errors import AeromatchWarning
from flightmech.support.kept_stages.captured_warnings import capture_warnings
from flightmech.support.kept_stages.stages import Kept

WAIT = 5.0  # [s] limit for an event that another thread sets
SHORT = 0.05  # [s] a thread that waits for a lock is still alive after this time


def test_a_value_is_computed_once_for_two_threads() -> None:
    """A thread that needs the value while it is computed waits for it."""
    computed: list[int] = []
    received: list[int] = []
    second = Thread(target=lambda: received.append(result.value))

    def make() -> tuple[int]:
        computed.append(len(computed))
        if len(computed) == 1:
            second.start()
            second.join(SHORT)
        return (len(computed),)

    result = Kept(make=make)
    received.append(result.value)
    second.join()
    assert computed == [0]
    assert received == [1, 1]


def test_each_thread_captures_its_warnings() -> None:
    """The first call ends while the second one, which began later, still runs."""
    second_began, first_ended = Event(), Event()
    remarks: dict[str, list[str]] = {}

    def warn_first() -> None:
        assert second_began.wait(WAIT)
        warnings.warn("of the first", AeromatchWarning, stacklevel=1)

    def warn_second() -> None:
        second_began.set()
        assert first_ended.wait(WAIT)
        warnings.warn("of the second", AeromatchWarning, stacklevel=1)

    def capture_second() -> None:
        _, remarks["second"] = capture_warnings(warn_second)

    second = Thread(target=capture_second)

    def start_and_warn() -> None:
        second.start()
        warn_first()

    with warnings.catch_warnings(record=True) as uncaught:
        warnings.simplefilter("always")
        filters = list(warnings.filters)
        _, remarks["first"] = capture_warnings(start_and_warn)
        first_ended.set()
        second.join()
        # The state of `warnings` is that before the captures: nothing is recorded any more.
        assert warnings.filters == filters
        warnings.warn("after both", AeromatchWarning, stacklevel=1)
    assert remarks == {"first": ["of the first"], "second": ["of the second"]}
    assert [str(warning.message) for warning in uncaught] == ["after both"]


def test_a_capture_ignores_a_thread_without_one() -> None:
    """A warning of a thread that captures nothing is shown, and is not a remark."""

    def warn_in_thread() -> None:
        other = Thread(target=lambda: warnings.warn("of the other", AeromatchWarning, stacklevel=1))
        other.start()
        other.join()
        warnings.warn("of the call", AeromatchWarning, stacklevel=1)

    with warnings.catch_warnings(record=True) as uncaught:
        warnings.simplefilter("always")
        _, remarks = capture_warnings(warn_in_thread)
    assert remarks == ["of the call"]
    assert [str(warning.message) for warning in uncaught] == ["of the other"]


def test_a_capture_inside_a_record_of_warnings_inside_a_capture() -> None:
    """`catch_warnings` replaces the hook of the outer capture, and the inner one needs its own."""
    inner: list[str] = []

    def work() -> None:
        warnings.warn("before", AeromatchWarning, stacklevel=1)
        with warnings.catch_warnings(record=True) as recorded:
            _, texts = capture_warnings(
                lambda: warnings.warn("inside", AeromatchWarning, stacklevel=1)
            )
            inner.extend(texts)
        assert not recorded
        warnings.warn("after", AeromatchWarning, stacklevel=1)

    _, outer = capture_warnings(work)
    assert inner == ["inside"]
    assert outer == ["before", "after"]


def test_a_call_that_raises_issues_its_warnings() -> None:
    """No warning is lost with the result."""

    def fail() -> None:
        warnings.warn("before the error", AeromatchWarning, stacklevel=1)
        raise ValueError("error")

    with (
        pytest.warns(AeromatchWarning, match="before the error"),
        pytest.raises(ValueError, match="error"),
    ):
        capture_warnings(fail)
