"""Tests of what a build states on numbers of the print that are suspect."""

import warnings
from pathlib import Path

import pytest

import aerodb
import datcom_io
import flightmech
from aerodb.prior.print_remarks import describe_suspect_numbers
from aerodb.prior.sources import collect_source
from aerodb.store.plausibility import check_plausibility
from flightmech.errors import AeromatchWarning

C182 = Path(__file__).parents[3] / "data" / "c182"
LISTINGS = Path(__file__).parents[2] / "datcom_io" / "listings"


@pytest.mark.slow
def test_a_changed_digit_makes_a_database_implausible(tmp_path: Path) -> None:
    """CL of 0.302 at Mach 0.1 and 2 deg becomes 0.802; CN of the row stays 0.303."""
    text = (C182 / "datcom" / "clean.out").read_text()
    assert text.count("    2.0    0.022    0.302 ") == 1
    (tmp_path / "clean.out").write_text(text.replace("0.022    0.302 ", "0.022    0.802 ", 1))
    aircraft = flightmech.read_aircraft(C182 / "aircraft.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)
        db = aerodb.from_datcom(aircraft, clean=datcom_io.read(tmp_path / "clean.out")[0])
    findings = {item.subject: item for item in check_plausibility(db, aircraft)}
    assert findings["print"].stops
    assert "CL at Mach 0.1, alpha 2 deg; CD at Mach 0.1, alpha 2 deg" in findings["print"].source


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (C182 / "datcom" / "clean.out", ""),
        # NALPHA counts an angle that the deck does not give: all rows are wrong.
        (LISTINGS / "missing_angle.out", "CL at Mach"),
    ],
)
def test_suspect_coefficients_of_a_listing(path: Path, expected: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)
        clean = collect_source("clean", datcom_io.read(path)[0])
    text = describe_suspect_numbers(clean, float(clean.grid("static")["h"][0]))
    assert bool(text) == bool(expected)
    assert expected in text
