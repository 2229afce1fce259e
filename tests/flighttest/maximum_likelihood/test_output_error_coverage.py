"""Two standard errors cover 95 %: the study of the benchmark, 200 records each."""

import runpy
from pathlib import Path

import pytest

STUDY = Path(__file__).parents[3] / "benchmarks" / "output_error.py"


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize(
    "study", ["kernel, white noise", "frequency, calm air", "filter error, turbulence"]
)
def test_two_standard_errors_cover_what_they_promise(study):
    coverage, _, bias = runpy.run_path(str(STUDY), run_name="__study__")["covered"](study)
    assert 0.92 < coverage < 0.98
    assert bias < 0.25  # of a standard error; the mean of 200 has one of 0.07
