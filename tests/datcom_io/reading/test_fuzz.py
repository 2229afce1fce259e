"""Harmed listings: one clear error or what is complete, soon, and no page before the fault lost.

More examples: ``AEROMATCH_FUZZ=5000 python -m pytest tests/datcom_io/reading/test_fuzz.py``; guided
by coverage: ``tests/fuzz/README.md``.
"""

from __future__ import annotations

import functools
import importlib.util
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

ROOT = Path(__file__).parents[3]
FUZZ = ROOT / "tests" / "fuzz"
T37 = ROOT / "data" / "t37" / "datcom"
SHARED = ROOT / ".." / "shared" / "data" / "datcom"
DECKS = sorted(T37.glob("*.inp"))
EXAMPLES = int(os.environ.get("AEROMATCH_FUZZ", "0"))


def quick(examples: int) -> settings:
    """Return the same few examples every time, not shrunk when one fails (that takes minutes), or
    as many new ones as requested.
    """
    return settings(
        max_examples=EXAMPLES or examples,
        derandomize=not EXAMPLES,
        phases=[Phase.generate, *([Phase.shrink] if EXAMPLES else [])],
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def _load(name: str):
    spec = importlib.util.spec_from_file_location(f"fuzz_{name}", FUZZ / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


harm, promises = _load("harm"), _load("promises")


def excerpt(path: Path, pages: int = 14) -> list[str]:
    """Return a listing with its first pages only; the end of the last case and of the run stays."""
    lines = path.read_bytes().decode("latin-1").replace("\r", "").split("\n")
    starts = [k for k, line in enumerate(lines) if line.startswith("1")]
    return lines if len(starts) <= pages + 2 else lines[: starts[pages]] + lines[starts[-2] :]


def bases() -> list[Path]:
    small = [
        "control_tab",
        "hypersonic",
        "errors_missing",
        "spoilers_diff_tail",
        "low_aspect_ratio",
        "canard",
        "ce500_trim",
        "ce500_transonic",
    ]
    third = [path for name in small for path in sorted((SHARED / name).glob("*.out"))]
    return [*sorted(T37.glob("*.out")), *third]


@functools.cache
def sound(path: Path):
    return promises.sound(excerpt(path))


@functools.cache
def others() -> list[list[str]]:
    return [sound(path).lines for path in bases()]


@pytest.mark.nightly
@quick(15)
@given(st.data())
def test_harmed_listings(data):
    path = data.draw(st.sampled_from(bases()))
    times = data.draw(st.integers(1, 4))
    lines = harm.harm(
        sound(path).lines, others(), lambda n: data.draw(st.integers(0, n - 1)), times
    )
    promises.keeps_promises(lines, sound(path))


@pytest.mark.nightly
@pytest.mark.parametrize("way", harm.WAYS, ids=lambda way: way.__name__)
def test_every_way_of_harm(way):
    @quick(2)
    @given(st.data())
    def harmed_once(data):
        path = data.draw(st.sampled_from(bases()))
        lines = way(sound(path).lines, others(), lambda n: data.draw(st.integers(0, n - 1)))
        promises.keeps_promises(lines, sound(path))

    harmed_once()


@pytest.mark.nightly
@quick(25)
@given(st.data())
def test_harmed_decks(data):
    decks = [path.read_text("latin-1").split("\n") for path in DECKS]
    times = data.draw(st.integers(1, 4))
    promises.keeps_deck_promises(
        harm.harm(
            data.draw(st.sampled_from(decks)),
            decks,
            lambda n: data.draw(st.integers(0, n - 1)),
            times,
        )
    )


@pytest.mark.parametrize("path", sorted((FUZZ / "seeds").glob("*.inp")), ids=lambda path: path.stem)
def test_decks_that_once_broke_a_promise(path):
    promises.keeps_deck_promises(path.read_text("latin-1").split("\n"))


@pytest.mark.parametrize("path", sorted((FUZZ / "seeds").glob("*.out")), ids=lambda path: path.stem)
def test_listings_that_once_broke_a_promise(path):
    promises.keeps_promises(path.read_bytes().decode("latin-1").split("\n"))


LONG = 400_000
CARDS = ["1          THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.", "0"]
NAME = (
    "1                             AUTOMATED STABILITY AND CONTROL METHODS PER APRIL 1976 "
    "VERSION OF DATCOM"
)
LONG_LINES = {
    "digits of a card": [*CARDS, f"  $FLTCON NALPHA={'0' * LONG}A$"],
    "blanks of a card": [*CARDS, f"  $FLTCON A{' ' * LONG}B$"],
    "digits without exponent letter": [*CARDS, f"  $FLTCON A={'1' * LONG}.$"],
    "letters of a dump": [
        "0**** FOLLOWING ARE THE BASIC INPUT DATA BLOCKS ****",
        f"   FLC(  1)= 2.00000E+00 {'E' * LONG}",
    ],
    "asterisks of a frame": [NAME, f"0  -------DERIVATIVE (PER RADIAN)----{'*' * LONG} "],
    "words of a header": [
        *(NAME, " AERODYNAMIC CONTROL EFFECTIVENESS AT HYPERSONIC SPEEDS"),
        f"                    MACH NUMBER= 8.00 {'1.0 ' * (LONG // 4)}",
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("lines", LONG_LINES.values(), ids=LONG_LINES)
def test_long_lines_take_linear_time(lines):
    promises.keeps_promises([*lines, "1 END OF JOB."])
