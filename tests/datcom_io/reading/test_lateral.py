"""Tests of CLB, CYP and CNP of the wrong size or sign."""

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

import datcom_io

CLEAN = Path(__file__).parents[3] / "data" / "c182" / "datcom" / "clean.out"
# End of a row with the last number of a column in it, after the columns before.
STATIC = re.compile(r"(?m)^(   [ -]*\d+\.0 .*)( -\d\.\d{3}E[+-]\d\d)$")
DYNAMIC = re.compile(r"(?m)^( {3,4}[ -]*\d+\.00 .*?)((?: +-?\d\.\d{3}E[+-]\d\d){5})$")


def scale_CLB(text: str, factor: float) -> str:
    """Return a print of the light aircraft whose last static column is multiplied."""
    return STATIC.sub(lambda m: f"{m[1]}{float(m[2]) * factor:11.3E}", text)


def scale_rate(text: str, column: int, factor: float) -> str:
    """Return a print with a column multiplied: CLP, CYP, CNP, CNR, CLR from 0 on."""

    def change(match: re.Match[str]) -> str:
        numbers = [float(word) for word in match[2].split()]
        numbers[column] *= factor
        return match[1] + "".join(f"   {number:10.3E}" for number in numbers)

    return DYNAMIC.sub(change, text)


def read(tmp_path: Path, text: str) -> tuple[dict[tuple[str, str], int], list[str]]:
    """Return the numbers of suspect cells by table and column, and the messages on them."""
    path = tmp_path / "changed.out"
    path.write_text(text)
    listing = datcom_io.read(path)
    cells = listing.cells()
    suspect = cells[cells["flag"] == "suspect"]
    texts = [message.text for message in listing.messages if "impossible in sign" in message.text]
    return Counter(zip(suspect["table"], suspect["column"])), texts


@pytest.fixture(scope="module")
def text() -> str:
    return CLEAN.read_text()


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        (lambda text: scale_CLB(text, 57.3), ("static", "CLB"), "at most 0.52 is possible"),
        (lambda text: scale_CLB(text, 1 / 57.3), ("static", "CLB"), "at most 0.0016 per radian"),
        (lambda text: scale_rate(text, 1, 57.3), ("dynamic", "CYP"), "-2.813 per radian at"),
        (lambda text: scale_rate(text, 2, -1.0), ("dynamic", "CNP"), "it rises by 0.072"),
    ],
)
def test_a_column_of_the_wrong_size_or_sign(
    tmp_path: Path, text: str, change: Callable[[str], str], place: tuple[str, str], words: str
) -> None:
    changed = change(text)
    assert changed != text
    suspect, texts = read(tmp_path, changed)
    assert suspect == {place: 48}  # 16 angles at three Mach numbers
    assert len(texts) == 1
    assert words in texts[0]
    assert "at Mach 0.1 0.15 0.2 " in texts[0]


@pytest.mark.parametrize("factor", [1.0, 0.5, 2.0])
def test_columns_of_a_possible_size(tmp_path: Path, text: str, factor: float) -> None:
    changed = scale_CLB(text, factor)
    for column in (1, 2):
        changed = scale_rate(changed, column, factor)
    assert read(tmp_path, changed) == ({}, [])


def restate(text: str, length: float) -> str:
    """Return a print whose lateral derivatives are by another BLREF, 35.8 ft in the deck."""
    changed = text.replace("BLREF=35.8", f"BLREF={length:.1f}")
    assert changed != text
    changed = scale_CLB(changed, 35.8 / length)
    for column, power in enumerate((2, 1, 2, 2, 2)):
        changed = scale_rate(changed, column, (35.8 / length) ** power)
    return changed


@pytest.mark.parametrize("length", [1.0, 100.0])
def test_limits_do_not_depend_on_the_reference_length(
    tmp_path: Path, text: str, length: float
) -> None:
    assert read(tmp_path, restate(text, length)) == ({}, [])
    suspect, texts = read(tmp_path, restate(scale_CLB(text, 57.3), length))
    assert suspect == {("static", "CLB"): 48}
    (most,) = re.findall(r"at most (\S+) is possible", texts[0])
    assert float(most) == pytest.approx(0.522 * 35.8 / length, rel=0.02)


def test_a_wing_of_small_aspect_ratio_may_have_a_rising_CNP(tmp_path: Path, text: str) -> None:
    """The same wing with three times the chord: its aspect ratio is 2.5."""
    broad = text.replace("CHRDR=5.56,CHRDTP=4.16", "CHRDR=16.7,CHRDTP=12.5")
    assert broad != text
    assert ("dynamic", "CNP") not in read(tmp_path, scale_rate(broad, 2, -1.0))[0]


def test_a_wing_without_dihedral_and_fin_may_have_a_small_CLB(tmp_path: Path, text: str) -> None:
    flat = text.replace("DHDADI=1.7", "DHDADI=0.0").replace("VERTICAL TAIL-", "")
    assert ("static", "CLB") not in read(tmp_path, scale_CLB(flat, 1 / 57.3))[0]
