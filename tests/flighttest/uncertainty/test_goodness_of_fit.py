"""Metrics of a prediction: closed forms, the published tables of the spin paper, refusals."""

import csv
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.uncertainty import prediction_errors as goodness_of_fit

PUBLISHED = Path(__file__).parents[3] / ".." / "shared" / "data" / "published"
TIME = np.linspace(0.0, 1.0, 1000, endpoint=False)
SINE = np.sin(2 * np.pi * TIME)


def test_a_perfect_prediction():
    assert goodness_of_fit.theil(SINE, SINE) == 0.0
    assert goodness_of_fit.nrmse(SINE, SINE) == 0.0
    assert goodness_of_fit.r_squared(SINE, SINE) == 1.0


def test_a_sine_of_half_the_size():
    """rms error is a quarter of the range over sqrt(2); R2 = 1 - 0.25; TIC = 0.5/(1 + 0.5)."""
    assert goodness_of_fit.theil(SINE, SINE / 2) == pytest.approx(1 / 3, rel=1e-12)
    assert goodness_of_fit.nrmse(SINE, SINE / 2) == pytest.approx(
        100 * 0.25 / np.sqrt(2), rel=1e-4
    )  # peak lies between samples
    assert goodness_of_fit.r_squared(SINE, SINE / 2) == pytest.approx(0.75, rel=1e-12)
    assert goodness_of_fit.theil_single_root(SINE, SINE / 2) == pytest.approx(
        0.5 / np.sqrt(1.25), rel=1e-12
    )


def test_bounds_of_both_forms_of_theils_coefficient():
    assert goodness_of_fit.theil(SINE, -SINE) == pytest.approx(1.0, rel=1e-12)
    assert goodness_of_fit.theil_single_root(SINE, -SINE) == pytest.approx(np.sqrt(2.0), rel=1e-12)


def test_shares_name_the_kind_of_error_and_sum_to_one():
    rng = np.random.default_rng(1)
    assert goodness_of_fit.theil_shares(SINE, SINE + 0.3) == pytest.approx(
        (1.0, 0.0, 0.0), abs=1e-12
    )
    assert goodness_of_fit.theil_shares(SINE, 2.0 * SINE) == pytest.approx(
        (0.0, 1.0, 0.0), abs=1e-12
    )
    found = goodness_of_fit.theil_shares(SINE, 0.7 * SINE + 0.1 + rng.normal(0.0, 0.2, 1000))
    assert sum(found) == pytest.approx(1.0, rel=1e-12)
    assert min(found) > 0.02


def test_samples_that_are_missing_are_left_out():
    gappy = np.where(TIME < 0.1, np.nan, SINE)
    assert goodness_of_fit.theil(gappy, SINE / 2) == pytest.approx(
        goodness_of_fit.theil(SINE[100:], SINE[100:] / 2), rel=1e-12
    )


@pytest.mark.parametrize(
    ("measured", "predicted", "text"),
    [
        (SINE, SINE[1:], "one clock"),
        (np.ones(9), np.ones(9) * 2, "do not move"),
        ([np.nan, 1.0], [1.0, 1.0], "1 samples"),
        (SINE, np.where(TIME > 0.5, np.nan, SINE), "no value at .* measured samples, first at"),
        (SINE, np.where(TIME > 0.5, np.inf, SINE), "the run diverges or ends early"),
    ],
)
def test_refusals(measured, predicted, text):
    with pytest.raises(IdentificationError, match=text):
        goodness_of_fit.r_squared(measured, predicted)


def test_table_has_the_layout_of_the_published_ones():
    table = goodness_of_fit.validation_table(
        {"CX": SINE, "Cm": SINE},
        {"glide": {"CX": SINE / 2, "Cm": -SINE}, "spin": {"CX": SINE, "Cm": SINE}},
    )
    assert list(table.index) == list(product(["TIC", "NRMSE", "R2"], ["glide", "spin"]))
    assert table.loc[("TIC", "glide"), "CX"] == pytest.approx(1 / 3)
    assert table.loc[("R2", "spin")].tolist() == [1.0, 1.0]
    text = goodness_of_fit.validation_report(table)
    assert "Theil's inequality coefficient" in text
    assert text.splitlines()[2].split() == ["glide", "0.3333", "1.0000"]


def test_table_names_what_is_missing():
    with pytest.raises(UnknownName, match="the record does not hold it"):
        goodness_of_fit.validation_table({"CX": SINE}, {"glide": {"Cm": SINE}})


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="needs the published tables of ../shared")
def test_published_metrics_belong_to_the_standard_form():
    """Table 4, CY: rms/range = NRMSE/(2 TIC) by the standard form; by the printed one it would
    exceed that of a pure sine, 1/(2 sqrt 2).
    """
    with open(PUBLISHED / "gresham_table4_glide_validation.csv", newline="") as file:
        rows = {row["metric"]: float(row["Cy"]) for row in csv.DictReader(file)}
    standard = rows["NRMSE_percent"] / 100.0 / (2.0 * rows["TIC"])
    printed = rows["NRMSE_percent"] / 100.0 / (np.sqrt(2.0) * rows["TIC"])
    sine = np.sqrt(0.5) / 2.0
    assert standard == pytest.approx(0.2675, abs=5e-4)
    assert standard < sine < printed
    # a model with the rms and range of the table gives back both numbers
    z = SINE * standard / sine
    y = z * (1.0 - 2.0 * rows["TIC"] / (1.0 + rows["TIC"]))
    assert goodness_of_fit.theil(z, y) == pytest.approx(rows["TIC"], rel=1e-9)
