"""R2 of a stall on records that its linear terms were not fitted to."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flighttest.submodels.stall.left_out import left_out_shares, remark_shares


def problem_of(numbers, z, A):
    """Return a problem of one coefficient CL with the design A."""
    data = xr.Dataset({"manoeuvre": ("sample", numbers)})
    return SimpleNamespace(
        models=[SimpleNamespace(target="CL")],
        samples=[SimpleNamespace(data=data)],
        z=[z],
        designs=lambda s: [SimpleNamespace(A=A)],
    )


def test_a_term_that_differs_between_records_does_not_predict():
    """Each record of 50 samples has its own slope: the fit of both describes, others do not."""
    numbers = np.repeat([0, 1, 2], 50)
    x = np.tile(np.linspace(-1.0, 1.0, 50), 3)
    A = np.column_stack([np.ones(150), 1e-6 * x])
    same = left_out_shares(problem_of(numbers, 2.0 + 3.0 * x, A), np.zeros(0))
    assert same["CL"] == pytest.approx(1.0)
    assert remark_shares(same) == []
    slopes = np.array([1.0, 1.0, -2.0])[numbers]
    other = left_out_shares(problem_of(numbers, slopes * x, A), np.zeros(0))
    # slopes of the others -0.5, -0.5, 1: squares of the misses 1.5^2 + 1.5^2 + 3^2 of 1 + 1 + 4
    assert other["CL"] == pytest.approx(1.0 - 13.5 / 6.0)
    assert remark_shares(other)[0].startswith("CL: R2 -1.25 on records that its terms were not f")


def test_one_record_or_a_term_of_one_record_is_not_checked():
    x = np.linspace(-1.0, 1.0, 50)
    A = np.column_stack([np.ones(50), x])
    one = left_out_shares(problem_of(np.zeros(50, int), x, A), np.zeros(0))
    assert np.isnan(one["CL"])
    assert "CL: not checked on records that its terms" in remark_shares(one)[0]
    numbers = np.repeat([0, 1], 25)
    A = np.column_stack([np.ones(50), numbers])
    assert np.isnan(left_out_shares(problem_of(numbers, x, A), np.zeros(0))["CL"])
