"""What was flown, kept for the figures of LR-743: against the records that it was taken from."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
import flighttest
from aerodb.figures.lr743_set.flown import is_clean
from aeromatch.workflow.flown import flown_tree
from aeromatch.workflow.submodels import Submodels
from flighttest.submodels.ground_effect.result import GroundTerm

_NOTHING = {**vars(Submodels()), "found": {}}


@pytest.fixture(scope="module")
def record():
    """Twenty seconds at 50 Hz: a doublet from 5 to 10 s, whose input begins after half a second."""
    time = np.arange(0.0, 20.0, 0.02)
    alpha = 0.06 + 0.03 * np.sin(2.0 * np.pi * (time - 5.5)) * (time > 5.5)
    data = {
        "alpha": alpha,
        "mach": 0.3 + 0.0 * time,
        "h": 1500.0 + time,
        "mass": 2000.0 - time,
        "delta_f": 0.0 * time,
    }
    data["CL"] = 0.2 + 5.0 * alpha
    return xr.Dataset({name: ("time", values) for name, values in data.items()}, {"time": time})


@pytest.fixture(scope="module")
def tree(record):
    fit = flighttest.regress(
        flighttest.RegressionModel.parse("CL = 1 + alpha"),
        [record.sel(time=slice(5.0, 9.99))],
        name="run_1: pitch",
    )
    table = pd.DataFrame(
        {"manoeuvre": ["doublet"], "control": ["elevator"], "start": [5.0], "end": [10.0]}
    )
    coefficient = SimpleNamespace(
        form="k h^s",
        warnings=["CL: the form k h^s does not fit"],
        not_identified={"qhat": "1.3 standard errors from zero, 3 are needed"},
        rows=lambda: [
            GroundTerm("1", 0.8, 0.6, k_stderr=0.02, s=-1.4, s_stderr=0.1, correlation=-0.9)
        ],
    )
    found = SimpleNamespace(coefficients={"CL": coefficient})
    submodels = SimpleNamespace(**{**vars(Submodels()), "ground_effect": found, "found": {}})
    taken = [{"run_1": [(5.0, 10.0)]}, {"run_1": [(5.0, 10.0), (12.0, 13.0)]}]
    return flown_tree("T", {"run_1": record}, taken, {"run_1": table}, [fit], submodels)


def test_manoeuvres_begin_from_the_steady_condition_of_the_record(tree, record):
    rows = tree["manoeuvres"].to_dataset().to_dataframe()
    assert list(rows["label"]) == [
        "doublet elevator",
        "window",
    ]  # one that two fits take stands once
    steady = record.sel(time=slice(5.0, 5.5))
    for name in ("alpha", "CL", "h", "mass"):
        np.testing.assert_allclose(rows[name].iloc[0], float(steady[name].mean()))
    assert (rows["gear"].iloc[0], rows["h_agl"].iloc[0]) == (
        0.0,
        1e4,
    )  # not recorded: at rest, free air


def test_samples_are_those_of_the_record_at_ten_hertz(tree, record):
    samples = tree["samples"].to_dataset().to_dataframe()
    first = samples[samples["manoeuvre"] == 0]
    np.testing.assert_allclose(np.diff(first["time"]), 0.1, atol=1e-6)
    same = record["CL"].sel(time=first["time"].to_numpy(float), method="nearest")
    np.testing.assert_allclose(first["CL"], same, rtol=1e-6)


def test_estimates_and_table_2_are_what_was_found(tree):
    rows = tree["estimates"].to_dataset().to_dataframe().set_index("term")
    np.testing.assert_allclose(rows.loc["alpha", "estimate"], 5.0)
    np.testing.assert_allclose(rows.loc["alpha", "mach"], 0.3)
    ground = tree["ground"].to_dataset().to_dataframe().set_index("term")
    assert tuple(ground.loc["1", ["y_inf", "k", "s"]]) == (0.8, 0.6, -1.4)
    assert ground.loc["1", "law"] == "k h^s"
    assert ground.loc["1", "note"].endswith("; CL: the form k h^s does not fit")
    assert ground.loc["qhat", "note"] == "1.3 standard errors from zero, 3 are needed"
    assert np.isnan(ground.loc["qhat", "k"])


def test_flights_with_ice_are_not_those_of_the_clean_aeroplane(record):
    """A record without the setting is clean where another has it; without any there is no column.

    Its terms are known at the samples either way.
    """
    iced = record.assign({"device.ice.setting": ("time", np.ones(record.sizes["time"]))})
    taken, table = [{"clean": [(5.0, 10.0)], "iced": [(5.0, 10.0)]}], {"start": [], "end": []}
    for second, settings in ((iced, [0.0, 1.0]), (record, None)):
        marks = dict.fromkeys(("clean", "iced"), pd.DataFrame(table))
        data = {"clean": record, "iced": second}
        tree = flown_tree("T", data, taken, marks, [], SimpleNamespace(**_NOTHING))
        rows = tree["manoeuvres"].to_dataset().to_dataframe().sort_values("record")
        if settings is None:
            assert "device.ice.setting" not in rows
            assert is_clean(rows).all()
        else:
            assert list(rows["device.ice.setting"]) == settings
            assert list(is_clean(rows)) == [True, False]


@pytest.mark.nightly
def test_the_file_is_read_again(tree, tmp_path):
    tree.to_netcdf(tmp_path / "flown.nc", engine="h5netcdf")
    flown = aerodb.figures.read_flown(tmp_path / "flown.nc")
    assert flown.source == "T: what the databases were identified from"
    assert flown.submodels["technique"].tolist() == [
        "type 1, batch least squares",
        "type 2, equation error",
    ]
    assert flown.manoeuvres["record"].tolist() == ["run_1", "run_1"]
