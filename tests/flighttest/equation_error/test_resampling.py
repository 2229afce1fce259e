import numpy as np
import pytest
import xarray as xr
from flown_lift import LIFT, TRUTH, record

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.resampling import bootstrap, monte_carlo
from flighttest.regression.equation_error.time_domain import regress


def line(seed):
    """A regression that needs nothing but the packages: what a worker on another machine has."""
    import numpy as np
    import xarray as xr

    import flighttest

    rng = np.random.default_rng(seed)
    alpha = 0.1 * rng.normal(size=400)
    columns = {
        "alpha": ("time", alpha),
        "CL": ("time", 0.3 + 5.0 * alpha + 0.02 * rng.normal(size=400)),
    }
    return flighttest.regress(
        flighttest.RegressionModel.parse("CL = 1 + alpha"),
        xr.Dataset(columns, coords={"time": 0.02 * np.arange(400)}),
    )


LINE = {"1": 0.3, "alpha": 5.0}


@pytest.mark.slow
@pytest.mark.parametrize("fitted", ["time", "frequency", "separate"])
def test_the_bootstrap_scatters_as_the_fit_states(fitted):
    """300 replicates know a scatter to 4 %; both use the same colour, so that only the linear
    algebra is compared.
    """
    parts = [record(np.random.default_rng(seed), 15.0) for seed in range(2)]
    if fitted == "frequency":
        fit = regress_frequency(LIFT, parts, (0.1, 1.0))
    else:
        fit = regress(LIFT, parts, intercepts="common" if fitted == "time" else "separate")
    found = bootstrap(fit, 300)
    loose = (
        0.45 if fitted == "frequency" else 0.15
    )  # in frequency the errors come from the spectrum in the band
    np.testing.assert_allclose(found.estimates["stderr"], fit.estimates["stderr"], rtol=loose)
    assert (
        np.abs(found.estimates["bias"].values) < 4 * fit.estimates["stderr"].values / np.sqrt(300)
    ).all()
    assert (found.estimates["low"] < fit.estimates["estimate"]).all()
    assert "300 replicates" in found.report()


# .ci/run compares one process with the processes of a cluster, below
@pytest.mark.nightly
def test_the_bootstrap_is_the_same_however_it_is_shared_out():
    fit = regress(LIFT, record(np.random.default_rng(2), 15.0))
    one, two = bootstrap(fit, 40, seed=7), bootstrap(fit, 40, seed=7, jobs=2)
    xr.testing.assert_identical(one.replicates, two.replicates)


@pytest.mark.slow
def test_a_study_counts_bias_and_coverage():
    study = monte_carlo(line, LINE, range(60), jobs=2)
    e = study.estimates
    assert (np.abs(e["bias"] / e["bias_stderr"]) < 4).all()
    assert study.coverage == pytest.approx(0.95, abs=0.07)  # 120 estimates
    np.testing.assert_allclose(e["stderr"], e["scatter"], rtol=0.3)
    assert list(study.runs["run"].values) == list(range(60))
    direct = line(17).estimates
    np.testing.assert_allclose(study.runs["estimate"].sel(run=17), direct["estimate"])
    assert "60 runs" in study.report()


def test_studies_without_sense_are_refused():
    with pytest.raises(IdentificationError, match="5 replicates; 20 at least"):
        bootstrap(line(17), 5)
    with pytest.raises(
        IdentificationError, match="3 seeds; 20 at least, and 200 to distinguish 95 % from 92 %"
    ):
        monte_carlo(line, LINE, range(3))
    with pytest.raises(IdentificationError, match="seed 0 did not estimate beta; it has 1, alpha"):
        monte_carlo(line, {"beta": 1.0}, range(20), jobs=1)


@pytest.fixture(scope="module")
def cluster():
    """Two workers in processes of their own."""
    distributed = pytest.importorskip(
        "distributed", reason="dask.distributed is not installed (extra `cluster`)"
    )
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as local,
        distributed.Client(local) as client,
    ):
        client.wait_for_workers(2, timeout=1200)
        yield client


@pytest.mark.nightly
@pytest.mark.serial
def test_a_cluster_of_processes_gives_the_same_study_and_the_same_bootstrap(cluster):
    import joblib

    fit = regress(RegressionModel.parse("CL = 1 + alpha"), record(np.random.default_rng(3), 15.0))
    here, boot = monte_carlo(line, LINE, range(24), jobs=1), bootstrap(fit, 40)
    with joblib.parallel_config(backend="dask"):
        there, boot_there = monte_carlo(line, LINE, range(24)), bootstrap(fit, 40, jobs=-1)
    xr.testing.assert_identical(there.runs, here.runs)
    xr.testing.assert_identical(boot_there.replicates, boot.replicates)
    assert (
        len(cluster.nthreads()) == 2
    )  # asked of the scheduler; scheduler_info is a copy that may be out of date


@pytest.mark.slow
@pytest.mark.parametrize("fitted", ["time", "frequency"])
@pytest.mark.nightly
def test_two_hundred_records_are_covered_without_bias(fitted):
    """The demand: 92 to 98 %; measured 93 % in both. Bias of four terms within 3.5 of its standard
    errors.
    """

    def identify(seed):
        data = record(np.random.default_rng(seed))
        return (
            regress(LIFT, data) if fitted == "time" else regress_frequency(LIFT, data, (0.1, 1.0))
        )

    study = monte_carlo(identify, TRUTH, range(200), jobs=1)
    assert 0.92 <= study.coverage <= 0.98
    assert (np.abs(study.estimates["bias"] / study.estimates["bias_stderr"]) < 3.5).all()
