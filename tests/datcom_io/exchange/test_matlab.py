"""The structure of datcomimport: there and back over the whole corpus, shapes, and a structure as
MATLAB itself leaves it.
"""

from pathlib import Path

import numpy as np
import pytest
from sampling import sampled
from scipy.io import loadmat, savemat

import datcom_io
from datcom_io.cells import ABSENT, FILLED, NDM, OK, SUSPECT
from datcom_io.exchange.matlab_fields import BUILD, FIELDS, MISSING
from flightmech.errors import ParseError

pytestmark = pytest.mark.usefixtures("mat_files_in_this_process")

CORPUS = Path(__file__).parents[3] / ".." / "shared" / "data" / "datcom"
LISTINGS = sorted(CORPUS.glob("*/*.out")) if CORPUS.is_dir() else []
HELD = {(field.leaf, field.quantity) for field in FIELDS if field.name != "fc_con"}
NOT_HELD = (
    "case",
    "file",
    "notes",
    "power",
    "V",
    "p_static",
    "temperature",
    "reynolds_per_m",
    "drag_node",
)
DEG = np.pi / 180.0


def is_short(path):
    """Return whether a listing is written and read quickly; build B prints what build A prints, and
    long listings only repeat it.
    """
    return ".pdas" not in path.name and path.stat().st_size <= 50_000


def properties_of(path):
    """Return the folder and the build of a listing, and how long it is."""
    return path.parent.name, ".pdas" in path.name, path.stat().st_size > 200_000


# the others for .ci/nightly
SHORT = [
    path if place % 12 == 0 else pytest.param(path, marks=pytest.mark.nightly)
    for place, path in enumerate(filter(is_short, LISTINGS))
]
LONG = [path for path in LISTINGS if not is_short(path)]


@pytest.fixture
def exported(t37, tmp_path):
    """Return a call that writes a T-37 listing and loads its first structure with scipy."""

    def call(name, **options):
        path = tmp_path / "x.mat"
        datcom_io.exchange.write_matlab(t37(name), path, **options)
        return loadmat(path, struct_as_record=True)["aero"][0, 0][0, 0]

    return call


@pytest.mark.nightly
@pytest.mark.skipif(not LISTINGS, reason="needs the corpus ../shared/data/datcom")
@pytest.mark.parametrize(
    "path", [*SHORT, *sampled(LONG, properties_of, order=1)], ids=lambda path: path.name
)
def test_there_and_back(path, tmp_path):
    listing = datcom_io.read(path)
    left_out = datcom_io.exchange.write_matlab(listing, tmp_path / "x.mat")
    tree, back = listing.to_datatree(), datcom_io.exchange.read_matlab(tmp_path / "x.mat")
    held = {
        name: HELD & {(leaf, str(v)) for leaf in case.children for v in case[leaf].data_vars}
        for name, case in tree.children.items()
    }
    assert list(back.children) == [name for name, variables in held.items() if variables]
    for name, case in back.children.items():
        for leaf in tree[name].children:
            _compare(
                tree[name],
                case,
                leaf,
                "\n".join(text for text in left_out if text.startswith(f"{name}: ")),
            )


def _compare(case, other, leaf, left_out):
    """Every variable of a leaf comes back with its coordinates, or is named among what was left
    out.
    """
    mine = case[leaf].to_dataset(inherit=False)
    mine = mine.isel(power=0) if "power" in mine.dims else mine
    names = [str(name) for name in mine.data_vars if not str(name).endswith("_flag")]
    assert (
        all(name in left_out for name in names if (leaf, name) not in HELD)
        or f"leaf {leaf}" in left_out
    )
    names = [
        name for name in names if (leaf, name) in HELD and (mine[f"{name}_flag"] != ABSENT).any()
    ]
    if not names:
        return
    back = other[leaf].to_dataset(inherit=False)
    lost = [
        str(c)
        for c in np.atleast_1d(mine.coords.get("configuration", ""))
        if f"configuration {c} of" in left_out
    ]
    if "configuration" in mine.dims and lost and leaf in ("static", "dynamic"):
        mine = mine.sel(configuration=[c for c in mine["configuration"].values if c not in lost])
    for device in {"delta_f", "delta_e"} & set(mine.dims):
        angles = np.round(np.rad2deg(mine[device].values), 6)
        mine = mine.isel(
            {device: [f"{device} {angle:g} deg of leaf {leaf}" not in left_out for angle in angles]}
        )
        mine = mine.squeeze(device) if mine.sizes[device] == 1 and device not in back.dims else mine
    for name in names:
        value = back[name].transpose(*mine[name].dims)
        np.testing.assert_allclose(
            value, mine[name], rtol=1e-12, equal_nan=True, err_msg=f"{leaf} {name}"
        )  # unit factors there and back
        number = np.isin(mine[f"{name}_flag"], (OK, FILLED, SUSPECT))
        np.testing.assert_array_equal(
            np.isin(back[f"{name}_flag"].transpose(*mine[name].dims), (OK, FILLED)), number
        )
    for key in (
        key for key in mine.coords if key not in NOT_HELD and not str(key).startswith("lines")
    ):
        if leaf == "jet" and key == "alpha":
            assert "leaf jet: the angle of attack at each time" in left_out
        elif mine[key].dtype.kind == "f":
            np.testing.assert_allclose(
                back[key], mine[key], rtol=1e-9, equal_nan=True, err_msg=f"{leaf} {key}"
            )
        elif not (key == "configuration" and (lost or "the words TWIN VERTICAL PANEL" in left_out)):
            np.testing.assert_array_equal(back[key], mine[key], err_msg=f"{leaf} {key}")


@pytest.mark.nightly
def test_shapes_and_scalars(exported):
    aero = exported("t37_build.out")
    assert aero["case"][0] == "T-37 OWN DECK COMPONENT BUILD-UP"
    assert (aero["dim"][0], aero["deriv"][0]) == ("ft", "rad")
    assert aero["build"].item() == 10.0
    assert aero["damp"].dtype == bool or aero["damp"].dtype == np.uint8
    alphas, machs = aero["alpha"].shape[1], aero["mach"].shape[1]
    assert (aero["nalpha"].item(), aero["nmach"].item()) == (alphas, machs)
    assert aero["cd"].shape[-1] == len(BUILD)
    assert aero["cd"].shape[:2] == (alphas, machs)
    assert aero["sref"].item() == pytest.approx(182.0, rel=1e-9)
    assert aero["cbar"].item() == pytest.approx(5.47, rel=1e-9)
    assert {"body", "wing", "htail", "vtail", "vfin"} == set(aero["config"].dtype.names)
    assert aero["version"].item() == 1976


@pytest.mark.slow
def test_numbers_are_as_printed(exported):
    aero = exported("t37_elevator.out")
    # line 190: alpha -4, Mach 0.15, per radian
    for name, value in {
        "cd": 0.022,
        "cl": -0.224,
        "cm": 0.1249,
        "cla": 5.334,
        "cma": -1.094,
        "clb": -5.983e-02,
    }.items():
        assert aero[name][2, 0] == pytest.approx(value, rel=1e-12), name
    assert np.ptp(aero["cyb"][:, 0]) == 0.0  # printed in the first row only
    assert np.isnan(aero["cm"][-1, 0])  # NA, line 206
    assert aero["dcl_sym"].shape == (aero["delta"].shape[1], aero["mach"].shape[1])
    assert aero["dcdi_sym"].shape[:2] == (aero["alpha"].shape[1], aero["delta"].shape[1])


def test_zero_instead_of_nan(exported):
    assert exported("t37_elevator.out", usenan=False)["cm"][-1, 0] == 0.0


@pytest.mark.slow
def test_ground_heights_end_with_free_air(exported):
    aero = exported("t37_ground_elevator.out")
    np.testing.assert_array_equal(
        aero["grndht"][0], [2.5, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, np.inf]
    )
    assert aero["ngh"].item() == 8
    assert aero["cl"].shape == (10, 1, 1, 1, 9, 9)
    zero = int(np.flatnonzero(aero["delta"][0] == 0.0)[0])
    assert (
        aero["cl"][:, 0, 0, 0, -1, [k for k in range(9) if k != zero]] == MISSING
    ).all()  # free air is printed without deflection
    assert (aero["cl"][:, 0, 0, 0, -1, zero] != MISSING).all()


@pytest.mark.nightly
def test_omissions_are_stated(t37, tmp_path):
    left_out = datcom_io.exchange.write_matlab(t37("t37_build.out"), tmp_path / "x.mat")
    assert "the moment centre" in left_out[0]
    assert any(
        text.startswith("T-37 OWN DECK COMPONENT BUILD-UP: leaf section") for text in left_out
    )
    history = str(loadmat(tmp_path / "x.mat")["history"][0])
    assert all(text in history for text in left_out)


def test_a_structure_as_matlab_leaves_it(tmp_path):
    """Columns that are constant stand in the first row only, 99999 below; trailing indices of
    length one are gone.
    """
    aero = {
        **{
            "case": "OWN",
            "mach": [[0.2, 0.9]],
            "alt": 0.0,
            "alpha": [[-2.0, 0.0, 2.0]],
            "dim": "ft",
            "deriv": "deg",
            "loop": 2.0,
        },
        **{
            "stmach": 0.6,
            "tsmach": 1.4,
            "build": 1.0,
            "sref": 100.0,
            "config": {"body": True, "wing": True},
        },
        "cl": np.array([[0.1, 0.2], [0.3, 0.4], [np.nan, 0.6]]),
        "cyb": np.array([[-0.01, -0.02], [MISSING, MISSING], [MISSING, MISSING]]),
    }
    savemat(tmp_path / "m.mat", {"alldata": np.array([[aero]], object)})
    case = datcom_io.exchange.read_matlab(tmp_path / "m.mat")["OWN"]
    static = case["static"]
    np.testing.assert_array_equal(static["CL"], [[0.1, 0.3, np.nan], [0.2, 0.4, 0.6]])
    assert static["CL_flag"].values.tolist() == [[OK, OK, NDM], [OK, OK, OK]]
    np.testing.assert_allclose(static["CY_beta"][0], -0.01 / DEG)
    assert static["CY_beta_flag"].values.tolist() == [
        [OK, FILLED, FILLED],
        [OK, ABSENT, ABSENT],
    ]  # not at transonic Mach numbers
    assert str(static["configuration"].values) == "WING-BODY"
    assert case.attrs["S"] == pytest.approx(100.0 * 0.3048**2)


def test_faults(tmp_path):
    path = tmp_path / "m.mat"
    savemat(path, {"x": 1.0})
    with pytest.raises(ParseError, match="0 of them among the variables x"):
        datcom_io.exchange.read_matlab(path)
    aero = {
        "mach": 0.2,
        "alt": 0.0,
        "alpha": [[0.0, 2.0]],
        "dim": "ft",
        "deriv": "deg",
        "cl": np.zeros((3, 1)),
    }
    savemat(path, {"aero": np.array([[aero]], object)})
    with pytest.raises(
        ParseError, match="case 1: cl of size 3 x 1; expected alpha 2 x mach 1 x alt 1 x build 1"
    ):
        datcom_io.exchange.read_matlab(path)
    savemat(path, {"aero": np.array([[{**aero, "dim": "furlong"}]], object)})
    with pytest.raises(ParseError, match="dim 'FURLONG'"):
        datcom_io.exchange.read_matlab(path)
    savemat(path, {"aero": np.array([[{**aero, "cl": "text"}]], object)})
    with pytest.raises(ParseError, match="cl without numbers"):
        datcom_io.exchange.read_matlab(path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(ParseError, match="no MAT file"):
        datcom_io.exchange.read_matlab(path)
    path.write_bytes(b"no mat file")
    with pytest.raises(ParseError, match="no MAT file"):
        datcom_io.exchange.read_matlab(path)


def test_a_file_does_not_depend_on_the_time(tmp_path, monkeypatch):
    deck = Path(__file__).parents[3] / "data" / "c182" / "datcom" / "clean.out"
    listing = datcom_io.read(deck)
    files = []
    for number in (1, 2):
        monkeypatch.setattr("time.asctime", lambda *_, number=number: f"time {number}")
        files.append(tmp_path / f"{number}.mat")
        datcom_io.exchange.write_matlab(listing, files[-1])
    assert files[0].read_bytes() == files[1].read_bytes()
    assert "aero" in loadmat(files[0])
