import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from flightmech.errors import AeromatchError, OutOfRange, UnknownName
from flighttest.cli_identify import identify
from flighttest.fit import open_fit

AIRCRAFT = """
name = "test"
S = 16.0
cbar = 1.6
b = 10.0
mass = 2000.0
Ixx = 11000.0
Iyy = 8000.0
Izz = 15000.0
"""


@pytest.fixture
def files(tmp_path):
    """A path whose side force is CY = -0.5 beta + 0.2 delta_r."""
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(1000)
    zero = np.zeros(1000)
    beta, rudder = 0.05 * np.sin(1.3 * t), 0.1 * np.sin(2.9 * t + 1)
    columns = {"V": zero + 80, "alpha": zero + 0.05, "beta": beta, "qbar": zero + 4000, "delta_r": rudder}
    columns |= {k: zero for k in ("p", "q", "r", "p_dot", "q_dot", "r_dot", "ax")}
    columns |= {"az": zero - 9.8, "ay": 4000 * 16 / 2000 * (-0.5 * beta + 0.2 * rudder + 1e-4 * rng.normal(size=1000))}
    states = xr.Dataset({k: ("time", v) for k, v in columns.items()}, coords={"time": t})
    xr.DataTree.from_dict({"/states": states}).to_netcdf(tmp_path / "path.nc", engine="h5netcdf")
    (tmp_path / "a.toml").write_text(AIRCRAFT)
    return [str(tmp_path / "path.nc"), "--aircraft", str(tmp_path / "a.toml")], tmp_path


def run(*arguments):
    return CliRunner().invoke(identify, arguments, catch_exceptions=False)


def test_the_table_and_the_file(files):
    base, folder = files
    result = run(*base, "--model", "CY = 1 + beta + delta_r", "-o", str(folder / "fit.nc"))
    assert result.exit_code == 0
    assert "CY = 1 + beta + delta_r" in result.output
    assert "std error" in result.output
    np.testing.assert_allclose(open_fit(folder / "fit.nc").estimates["estimate"], [0, -0.5, 0.2], atol=1e-3)


def test_the_document_and_windows(files):
    base, _ = files
    result = run(
        *base, "--model", "CY = 1 + beta + delta_r", "--window", "0", "8", "--window", "10", "18", "--intercepts", "separate", "--json"
    )
    found = json.loads(result.output)
    assert found["manoeuvres"] == 2
    assert set(found["terms"]) == {"1[0]", "1[1]", "beta", "delta_r"}
    assert found["terms"]["beta"]["estimate"] == pytest.approx(-0.5, abs=1e-3)
    assert len(found["covariance"]) == 4
    assert found["remarks"] == []


@pytest.mark.parametrize(
    ("more", "error"),
    [
        (["--model", "CY = 1 + betta"], UnknownName),
        (["--model", "CY = 1 + beta", "--window", "0", "99"], OutOfRange),
        (["--model", "CY = 1 + beta + gear"], UnknownName),
    ],
)
def test_bad_input_is_an_error_of_the_house_and_leaves_no_file(files, more, error):
    base, folder = files
    with pytest.raises(error) as caught:
        run(*base, *more, "-o", str(folder / "fit.nc"))
    assert isinstance(caught.value, AeromatchError)
    assert not (folder / "fit.nc").exists()
