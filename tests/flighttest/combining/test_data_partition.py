import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.combining.data_partition import bins, fit_bins
from flighttest.regression.equation_error.model import RegressionModel

MODEL = RegressionModel.parse("CL = 1 + alpha + delta_e")
EDGES = {"alpha": np.radians([0.0, 5.0, 10.0, 15.0, 25.0])}


def bending(seed=0):
    """A lift whose slope falls from 6 to 2 at 10 deg."""
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(6000)
    alpha = np.radians(7.5 + 7.0 * np.sin(0.11 * t) + 0.3 * np.sin(3.1 * t + 1))
    delta_e = np.radians(3.0) * np.sin(2.3 * t)
    CL = (
        0.2
        + 6.0 * alpha
        - 4.0 * np.maximum(alpha - np.radians(10), 0)
        + 0.4 * delta_e
        + 0.003 * rng.normal(size=6000)
    )
    columns = {"alpha": alpha, "delta_e": delta_e, "CL": CL, "mach": np.full(6000, 0.3)}
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, coords={"time": t})


def test_each_bin_has_the_slope_of_its_range():
    found = fit_bins(MODEL, bending(), EDGES, "run 1")
    e = found.estimates
    slope, error = e["estimate"].sel(term="alpha").values, e["stderr"].sel(term="alpha").values
    for k, truth in enumerate((6.0, 6.0, 2.0)):
        assert abs(slope[k] - truth) < 4 * error[k]
        assert error[k] < 0.2
    assert np.isnan(slope[3])
    assert found.refused == {3: "no stretch of 0.5 s"}
    assert len(found.fits) == 3
    assert found.fits[0].name == "run 1: alpha 0 ... 0.0872665"
    assert "no fit: no stretch of 0.5 s" in found.report()
    assert float(e["alpha_mean"][1]) == pytest.approx(np.radians(7.5), abs=np.radians(0.5))
    assert {"estimate", "stderr", "stderr_white", "correlation", "samples"} <= set(e.data_vars)


def test_bins_over_two_conditions_hold_every_sample_once():
    data = bending().assign(mach=("time", np.linspace(0.2, 0.4, 6000)))
    sorted_bins = bins(data, {**EDGES, "mach": [0.2, 0.3, 0.5]})
    assert len(sorted_bins) == 8
    assert list(sorted_bins[1][0]) == ["alpha", "mach"]
    held = sum(part.sizes["time"] for _, parts in sorted_bins for part in parts)
    assert 0.85 * 6000 < held <= 6000  # what lies in a bin for less than half a second is left out


def test_bad_edges_and_hopeless_bins_are_refused():
    with pytest.raises(
        IdentificationError,
        match=r"edges of alpha are \[0.1, 0.1\]; expected two or more numbers that rise",
    ):
        bins(bending(), {"alpha": [0.1, 0.1]})
    with pytest.raises(UnknownName, match="unknown condition 'beta'"):
        fit_bins(MODEL, bending(), {"beta": [0, 1]})
    with pytest.raises(
        IdentificationError,
        match=r"no bin gave a fit\n  - bin 0: CL = 1 \+ mach: mach does not move",
    ):
        fit_bins(RegressionModel.parse("CL = 1 + mach"), bending(), {"alpha": [0.0, 0.5]})
