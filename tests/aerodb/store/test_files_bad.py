"""Files that are not a database, damaged, or written by others."""

import os
import shutil
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import aerodb
from flightmech import terms
from flightmech.errors import ParseError, SchemaError
from flightmech.support import hdf5_seal
from flightmech.support.array_files import netcdf_trees as netcdf


@pytest.fixture
def file(small, tmp_path):
    aerodb.save(small, tmp_path / "small.nc")
    return tmp_path / "small.nc"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Return a database, the bytes of its file, and a place for harmed copies."""
    root = {
        "title": "t",
        "aircraft": "a",
        "S": 1.0,
        "cbar": 1.0,
        "b": 1.0,
        "x_ref": 0.0,
        "y_ref": 0.0,
        "z_ref": 0.0,
    }
    basic = terms.make_term(
        [[1.0, 2.0], [3.0, 4.0]],
        {"mach": [0.1, 0.2], "alpha": [0.0, 0.1]},
        stderr=0.1,
        source="datcom",
        history="one\ntwo",
    )
    db = aerodb.make_database(
        {"CL/basic": basic, "Cm/qhat": terms.make_term(-3.0, regressors=["qhat"])},
        force_axes="stability",
        **root,
    )
    path = tmp_path_factory.mktemp("harmed") / "a.nc"
    aerodb.save(db, path)
    return SimpleNamespace(db=db, content=path.read_bytes(), path=path)


@pytest.mark.nightly
@settings(
    max_examples=3 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_flipped_bytes_are_a_clear_error(saved, data):
    content = bytearray(saved.content)
    places = data.draw(
        st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4, unique=True)
    )
    for place in places:
        content[place] ^= data.draw(st.integers(1, 255))
    saved.path.write_bytes(content)
    with pytest.raises(ParseError, match=r"a damaged file|no netCDF-4 \(HDF5\) signature"):
        aerodb.open(saved.path)


@pytest.mark.slow
@settings(
    max_examples=settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_a_file_that_ends_early_is_a_clear_error(saved, data):
    keep = data.draw(st.integers(0, len(saved.content) - 1))
    saved.path.write_bytes(saved.content[:keep])
    if keep == len(saved.content) - 93:  # the seal is gone to the last byte, and nothing else
        xr.testing.assert_identical(aerodb.open(saved.path), saved.db)
        return
    with pytest.raises(ParseError, match=r"a damaged file|no netCDF-4 \(HDF5\) signature"):
        aerodb.open(saved.path)


@settings(
    max_examples=2 * settings.default.max_examples // 3,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_a_tail_of_zeros_is_a_clear_error(saved, data):
    """What a copy that broke off leaves in a file of the full length."""
    keep = data.draw(st.integers(0, len(saved.content) - 1))
    saved.path.write_bytes(saved.content[:keep] + bytes(len(saved.content) - keep))
    with pytest.raises(ParseError, match=r"a damaged file|no netCDF-4 \(HDF5\) signature"):
        aerodb.open(saved.path)


@pytest.mark.parametrize("more", [b"\n", bytes(4096), b"more"])
def test_a_file_that_goes_on_behind_its_end_is_a_clear_error(saved, more):
    saved.path.write_bytes(saved.content + more)
    with pytest.raises(ParseError, match="a damaged file"):
        aerodb.open(saved.path)


@pytest.mark.parametrize("layout", [("earliest", "v110"), ("v110", "v110"), ("latest", "latest")])
def test_any_layout_of_hdf5_is_read(small, tmp_path, monkeypatch, layout):
    """Other programs write older and newer ones than this package, and no seal."""
    monkeypatch.setattr(netcdf, "_FORMAT", layout)
    (tmp_path / "other.nc").write_bytes(netcdf.encode_tree(small))
    xr.testing.assert_identical(aerodb.open(tmp_path / "other.nc"), small)


def test_files_that_are_no_database(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"nowhere.nc: no such file; `aeromatch db build` writes a database"
    ):
        aerodb.open(tmp_path / "nowhere.nc")
    for content in (b"", b"not a database"):
        (tmp_path / "text.nc").write_bytes(content)
        with pytest.raises(ParseError, match="no netCDF-4 \\(HDF5\\) signature"):
            aerodb.open(tmp_path / "text.nc")
    with pytest.raises(ParseError, match="no netCDF-4"):
        aerodb.open(tmp_path)
    other = tmp_path / "other.nc"
    xr.Dataset({"x": ("time", [1.0])}, {"time": [0.0]}).to_netcdf(other, engine="h5netcdf")
    with pytest.raises(SchemaError, match="root holds the variables x") as caught:
        aerodb.open(other)
    assert (
        len(caught.value.problems) > 8
    )  # with the root attributes that a database has and this file lacks


def test_files_of_another_kind_are_called_by_it(tmp_path):
    """A list of everything that a record lacks as a database had 121 lines."""
    samples = xr.Dataset({"p": ("time", [1.0])}, {"time": [0.0]})
    kinds = {
        "flight show": {"/imu": samples, "/air_data": samples},
        "flight identify": {"/states": samples, "/biases": xr.Dataset(), "/residuals": samples},
    }
    for verb, groups in kinds.items():
        xr.DataTree.from_dict(groups).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
        with pytest.raises(
            SchemaError, match=rf"\(`aeromatch {verb}` reads it\), no aero database"
        ) as caught:
            aerodb.open(tmp_path / "other.nc")
        assert len(caught.value.problems) == 1


@pytest.mark.slow
def test_a_database_that_xarray_wrote_is_one(small, tmp_path):
    small.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
    xr.testing.assert_identical(aerodb.open(tmp_path / "x.nc"), small)


def test_a_dimension_without_breakpoints_is_reported(small, tmp_path):
    tree = xr.DataTree.from_dict(
        {**small.to_dict(), "/CL/flap": xr.Dataset({"value": ("delta_f", [0.0, 0.2])})}
    )
    tree.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
    with pytest.raises(SchemaError) as caught:
        aerodb.open(tmp_path / "x.nc")
    assert caught.value.problems == ["CL/flap: axis delta_f has no breakpoints"]


def test_xarray_opens_the_file(small, file):
    with xr.open_datatree(file, engine="h5netcdf") as tree:
        xr.testing.assert_identical(tree.load(), small)


def test_a_change_by_another_program_is_taken_and_checked(small, file):
    with h5py.File(file, "r+") as other:
        other["CL/flap/value"][1] = 0.3
    assert aerodb.terms(aerodb.open(file))["CL/flap"]["value"].values[1] == 0.3
    with h5py.File(file, "r+") as other:
        other["CL/flap/delta_f"][1] = 2.0
        other["CL/basic/alpha"].attrs["units"] = "deg"
        other["Cm/qhat"].attrs["regressors"] = "qhut"
        del other.attrs["S"], other.attrs["title"]
    with pytest.raises(SchemaError) as caught:
        aerodb.open(file)
    assert [problem[:60] for problem in caught.value.problems] == [
        "root attribute title is None; a text is needed",
        "root attribute S is None; a finite number in SI is needed",
        "CL/basic: axis alpha is given in 'deg', a term holds 'rad': ",
        "CL/flap: axis delta_f does not rise: 2 is followed by 0.6981",
        "Cm/qhat: regressor: unknown quantity 'qhut'; near it: qhat, ",
    ]


def objects(file):
    file["CL/flap/note"] = np.array(["a", "b"], dtype=h5py.string_dtype())
    file["CL/flap/note"].dims[0].attach_scale(file["CL/flap/delta_f"])


def five_axes(file):
    leaf = file.create_group("CD/basic")
    leaf["value"] = np.zeros((2,) * 5)
    for number, axis in enumerate(["mach", "alpha", "delta_e", "delta_f", "h_agl"]):
        leaf[axis] = [0.0, 1.0]
        leaf[axis].make_scale(axis)
        leaf["value"].dims[number].attach_scale(leaf[axis])


def unnamed(file):
    file.create_group("CD/basic")["value"] = np.zeros((2, 3))


def endless(file):
    file.create_group("CD/basic").create_dataset("value", (1 << 40,), "f8", chunks=(1 << 20,))


def outside(file):
    file["CD"] = h5py.ExternalLink("/etc/passwd", "/")
    file["CL/again"] = h5py.SoftLink("/CL/flap")


def circle(file):
    file["CL/flap/again"] = file["CL"]
    file["CL/root"] = file["/"]


def packed(file):
    file["CL/flap/value"].attrs["scale_factor"] = 0.01


def lists(file):
    file["CL/flap"].attrs["references"] = np.array([1.0, 2.0])
    file.attrs["note"] = h5py.Empty("f8")


def virtual(file):
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "x", (3,))
    file.create_group("CD/basic").create_virtual_dataset("value", layout)


def false_dimensions(file):
    file["CL/flap/value"].attrs["DIMENSION_LIST"] = "x" * 100


def no_numbers(file):
    file.create_group("CD/basic").create_dataset("value", data=h5py.Empty("f8"))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("harm", "problem"),
    [
        (objects, "CL/flap/note holds objects or texts; tables hold numbers"),
        (five_axes, "CD/basic: value has 5 axes; at most 4 are allowed"),
        (
            unnamed,
            "CD/basic/value: dimension 2 has no name; attach the dimension scale of its axis",
        ),
        (endless, "CD/basic/value has the shape (1099511627776,); a table has at most 128 MiB"),
        (outside, "CD is a link to another place; a database holds its tables itself"),
        (outside, "CL/again is a link to another place; a database holds its tables itself"),
        (circle, "CL/flap/again: linked to more than once; a database holds each group once"),
        (circle, "CL/root: linked to more than once; a database holds each group once"),
        (
            packed,
            "CL/flap/value is packed (attribute scale_factor); unpack the numbers before you "
            "write them",
        ),
        (lists, "CL/flap: attribute references is neither a text nor a number"),
        (lists, "root: attribute note is neither a text nor a number"),
        (
            virtual,
            "CD/basic/value keeps its numbers in another file; a database holds its tables itself",
        ),
        (
            false_dimensions,
            "CL/flap/value has an attribute DIMENSION_LIST that is not a list of references for "
            "each dimension",
        ),
        (no_numbers, "CD/basic/value has the shape None; a table has at most 128 MiB"),
    ],
)
def test_what_is_no_table_is_named(file, harm, problem):
    with h5py.File(file, "r+") as other:
        harm(other)
    with pytest.raises(SchemaError) as caught:
        aerodb.open(file)
    assert problem in caught.value.problems


def test_a_sealed_file_with_false_dimensions_does_not_end_the_process(file):
    """One term is not read without the check; HDF5 would follow the text as an address."""
    with h5py.File(file, "r+") as other:
        false_dimensions(other)
    file.write_bytes(hdf5_seal.add_seal(file.read_bytes(), "none", None))
    with pytest.raises(SchemaError, match="DIMENSION_LIST"):
        aerodb.store.files.open_term(file, "CL/flap")


@pytest.mark.skipif(
    shutil.which("ncdump") is None, reason="needs ncdump (Debian package netcdf-bin)"
)
def test_ncdump_reads_the_file(file):
    text = os.popen(f"ncdump -k {file} && ncdump -h {file}").read()
    assert text.startswith("netCDF-4")
    assert "double value(mach, alpha) ;" in text


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (
            lambda db: db.attrs.update(note="a\0b"),
            "root: attribute note holds a character that no file can carry",
        ),
        (
            lambda db: db.attrs.update(note="\ud800"),
            "root: attribute note holds a character that no file can carry",
        ),
        (
            lambda db: db["CL/flap"]["value"].attrs.update(fine=True),
            "CL/flap: attribute fine of value is a bool; only text",
        ),
        (
            lambda db: db["CL/flap"].attrs.update(CLASS="x"),
            "CL/flap: attribute 'CLASS' has a name that the file format keeps for itself",
        ),
        (
            lambda db: db.update({"checks": xr.DataTree(xr.Dataset({"CL": ("case", [1.0])}))}),
            "checks: CL has the dimension case without",
        ),
        (
            lambda db: db.update({"checks": xr.DataTree(xr.Dataset({"CL": "text"}))}),
            "checks: CL holds <U4; a file holds numbers",
        ),
    ],
)
def test_what_no_file_can_hold_is_refused_before_anything_is_written(
    small, tmp_path, change, problem
):
    change(small)
    with pytest.raises(SchemaError) as caught:
        aerodb.save(small, tmp_path / "small.nc")
    assert [text for text in caught.value.problems if text.startswith(problem)], (
        caught.value.problems
    )
    assert not list(tmp_path.iterdir())


def test_a_crowd_of_groups_is_one_problem(file, monkeypatch):
    monkeypatch.setattr(netcdf, "MOST_GROUPS", 20)
    with h5py.File(file, "a") as content:
        for number in range(30):
            content.create_group(f"CL/g{number}")
    with pytest.raises(SchemaError) as caught:
        aerodb.open(file)
    assert caught.value.problems == ["more than 20 groups; a database has some hundred"]


def test_groups_inside_each_other_without_end(file):
    with h5py.File(file, "a") as content:
        content.create_group("CL" + "/x" * 2000)
    with pytest.raises(SchemaError, match="groups inside each other more than 20 deep"):
        aerodb.open(file)
