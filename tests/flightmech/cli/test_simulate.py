"""aeromatch fmu simulate: inputs from CSV and netCDF, units, wrong input."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import flightmech
from flightmech.cli.group import fmu
from flightmech.errors import ParseError, UnitError, UnknownName
from flightmech.simulation.kernel import INPUT
from flightmech.simulation.stated_values.odd_values import describe_odd_values
from flightmech.terms import make_term


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    craft = flightmech.Aircraft(
        name="glider", S=16.0, cbar=1.5, b=10.0, mass=900.0, Ixx=2000.0, Iyy=2500.0, Izz=4000.0
    )
    leaves = {
        "CL/basic": make_term([-0.8, 1.6], {"alpha": [-0.2, 0.3]}),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
        "Cm/qhat": make_term(-14.0, regressors=["qhat"]),
    }
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    tree.to_netcdf(folder / "db.nc", engine="h5netcdf")
    return str(flightmech.write_aircraft(craft, folder / "a.toml")), str(folder / "db.nc"), folder


def run(files, *arguments: str):
    return CliRunner().invoke(
        fmu, ["simulate", files[0], files[1], *arguments], catch_exceptions=False
    )


@pytest.mark.nightly
def test_a_run_below_the_runway_is_stated(files):
    folder = files[2]
    (folder / "low.csv").write_text("time, delta_e [deg]\n0,5\n4.0,5\n")
    arguments = [
        "--inputs",
        str(folder / "low.csv"),
        "-o",
        str(folder / "y.nc"),
        "--set",
        "init.V=40",
    ]
    low = run(files, *arguments, "--set", "init.h=2").output
    assert "\nc.g. below the runway from 4.0 s on, by up to " in low
    assert "below the runway" not in run(files, *arguments, "--set", "init.h=500").output


@pytest.mark.slow
def test_csv_in_degrees_to_netcdf_with_terms(files):
    folder = files[2]
    (folder / "u.csv").write_text("# doublet\ntime, delta_e [deg]\n0,0\n0.5,-2\n1.0,2\n1.5,0\n")
    result = run(
        files,
        "--inputs",
        str(folder / "u.csv"),
        "--set",
        "init.V=80 kt",
        "--set",
        "init.h=500",
        "-o",
        str(folder / "y.nc"),
        "--terms",
    )
    assert result.output.startswith("4 samples of ")
    with xr.open_dataset(folder / "y.nc", engine="h5netcdf") as found:
        assert float(found["V"][0]) == pytest.approx(80 * 1852 / 3600, rel=1e-12)
        np.testing.assert_allclose(np.degrees(found["applied.delta_e"]), [0, -2, 2, 0], atol=1e-12)
        assert list(found["term"].values) == ["CL/basic", "Cm/elevator", "Cm/qhat"]


def test_netcdf_to_csv(files):
    folder = files[2]
    xr.Dataset({"delta_e": ("time", [0.0, 0.01])}, {"time": [0.0, 0.1]}).to_netcdf(
        folder / "u.nc", engine="h5netcdf"
    )
    result = run(files, "--inputs", str(folder / "u.nc"), "-o", str(folder / "y.csv"), "--json")
    assert '"samples": 2' in result.output
    assert (folder / "y.csv").read_text().splitlines()[0].startswith("time,V,V_cas")


@pytest.mark.parametrize(
    ("text", "setting", "error", "message"),
    [
        ("time,delta_e [kt]\n0,0\n", "init.V=40", UnitError, "kt"),
        ("time,delta_q\n0,0\n", "init.V=40", ParseError, "unknown quantity 'delta_q'"),
        (
            "t,delta_e\n0,0\n",
            "init.V=40",
            ParseError,
            "found t, delta_e; expected a column 'time' in s",
        ),
        ("delta_e\n0\n", "init.V=40", ParseError, "a column 'time' in s"),
        ("time,delta_e\n0,x\n", "init.V=40", ParseError, "over numbers"),
        ("time,delta_e\n0,0\n", "init.W=40", UnknownName, "init.W"),
    ],
)
def test_wrong_input(files, text, setting, error, message):
    path = files[2] / "bad.csv"
    path.write_text(text)
    with pytest.raises(error, match=message.replace("[", r"\[")):
        run(files, "--inputs", str(path), "--set", setting, "-o", str(files[2] / "z.nc"))
    assert not (files[2] / "z.nc").exists()


@pytest.mark.parametrize(("size", "is_stated"), [(5.0, True), (0.1, False)])
def test_an_input_far_beyond_its_limit_is_stated(size, is_stated):
    """Degrees under a heading without a unit are read as radians."""
    rows = [
        SimpleNamespace(name="delta_e", units="rad", display_units="deg", low=-0.5, high=0.4),
        SimpleNamespace(
            name="delta_f", units="rad", display_units="deg", low=-1.8e308, high=1.8e308
        ),
    ]
    names = [row.name for row in rows]
    sim = SimpleNamespace(inputs=names, entries=lambda kind: rows if kind == INPUT else [])
    inputs = xr.Dataset({name: ("time", [0.0, size]) for name in names})
    texts = describe_odd_values(sim, {}, inputs)
    assert len(texts) == is_stated
    assert not texts or "delta_e reaches 286.5 deg, its limit is 22.92 deg" in texts[0]
