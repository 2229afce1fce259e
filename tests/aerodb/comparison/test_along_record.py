import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.comparison.record_conditions import fill_missing_devices
from flightmech import terms
from flightmech.errors import ParseError, UnknownName


@pytest.fixture
def states():
    return xr.Dataset(
        {
            "mach": ("time", [0.3, 0.31]),
            "alpha": ("time", [0.05, 0.06]),
            "qhat": ("time", [0.0, 0.001]),
            "nz": ("time", [1.0, 1.4]),
        },
        {"time": [0.0, 0.02]},
    )


@pytest.fixture
def equipped(small):
    more = {
        "CL/gear": terms.make_term(-0.02, regressors=["gear"]),
        "CL/load_factor": terms.make_term(0.01, regressors=["dnz"]),
        "CL/ground": terms.make_term([0.1, 0.0], {"h_agl": [1.0, 20.0]}),
        "CL/basic_ice": terms.make_term(-0.05, regressors=["device.ice.setting"]),
    }
    return aerodb.replace_terms(small, more)


def test_devices_that_were_not_recorded_are_at_rest_and_that_is_reported(
    states, equipped, tmp_path
):
    states.to_netcdf(tmp_path / "path.nc", group="states", engine="h5netcdf")
    found, messages = aerodb.comparison.read_conditions(tmp_path / "path.nc", equipped)
    assert messages == [
        "device.ice.setting is not in the record; taken as 0",
        "delta_f is not in the record; taken as 0 deg",
        "gear is not in the record; taken as 0",
        "h_agl is not in the record; taken in free air",
    ]
    np.testing.assert_allclose(found["dnz"], [0.0, 0.4], atol=1e-15)
    frame = aerodb.compare(equipped, equipped, found)
    assert frame.loc["CL", "value_a"] == pytest.approx(0.2 + (5.0 + 0.4 * 0.5) * 0.05)
    assert (frame["max_difference"] == 0.0).all()


def test_a_manoeuvre_in_the_root_will_do(states, small, tmp_path):
    states.assign(delta_f=0.1).to_netcdf(tmp_path / "cut.nc", engine="h5netcdf")
    found, messages = aerodb.comparison.read_conditions(tmp_path / "cut.nc", small)
    assert messages == []
    assert float(found["delta_f"]) == 0.1


def test_states_that_a_table_needs_must_be_there(states, small, tmp_path):
    states.drop_vars("qhat").to_netcdf(tmp_path / "path.nc", group="states", engine="h5netcdf")
    with pytest.raises(
        UnknownName,
        match=r"unknown condition 'qhat'.*CL/qhat needs it and the record does not hold it",
    ):
        aerodb.comparison.read_conditions(tmp_path / "path.nc", small)


@pytest.mark.slow
def test_other_files_are_refused(small, tmp_path):
    with pytest.raises(
        FileNotFoundError, match="no such file; `aeromatch flight reconstruct` writes a path"
    ):
        aerodb.comparison.read_conditions(tmp_path / "missing.nc", small)
    (tmp_path / "text.nc").write_text("nothing")
    with pytest.raises(ParseError, match="no netCDF-4 file"):
        aerodb.comparison.read_conditions(tmp_path / "text.nc", small)
    aerodb.save(small, tmp_path / "db.nc")
    with pytest.raises(ParseError, match="found CL, Cm; expected states over one clock"):
        aerodb.comparison.read_conditions(tmp_path / "db.nc", small)


def test_lift_that_multiplies_a_moment_comes_from_the_terms(states, small, tmp_path):
    """A record may hold the lift coefficient itself, and that one is taken then."""
    roll = aerodb.replace_terms(
        small, {"Cl/ground": aerodb.transform.bank_in_ground_effect(-0.078, -1.09, 1.7)}
    )
    low = states.assign(delta_f=0.0, h_agl=3.0, phi=("time", [0.1, 0.1]))
    low.to_netcdf(tmp_path / "path.nc", group="states", engine="h5netcdf")
    found, messages = aerodb.comparison.read_conditions(tmp_path / "path.nc", roll)
    assert messages == ["CL is not in the record; taken from the terms of the first database"]
    lift = aerodb.evaluate(small, "CL", **{str(name): found[name] for name in found})
    np.testing.assert_allclose(found["CL"], lift, rtol=1e-15)
    assert found["CL"].dims == ("time",)
    frame = aerodb.compare(roll, roll, found)
    assert frame.loc["Cl/ground", "value_a"] == pytest.approx(
        float(-0.078 * 3.0**-1.09 * 0.1 * lift[0])
    )
    given, messages = fill_missing_devices(low.assign(CL=1.0), roll)
    assert messages == []
    assert float(given["CL"]) == 1.0
