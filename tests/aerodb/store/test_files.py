import os
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import aerodb
from aerodb.store import overview
from aerodb.store.files import open_term
from aerodb.store.seal import read_database_seal
from flightmech import terms
from flightmech.errors import SchemaError

AXES = ("mach", "alpha", "delta_e", "delta_f", "h_agl")
REGRESSORS = ("qhat", "beta", "alpha", "gear")
NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False)
TEXT = st.text(
    st.characters(codec="utf-8", exclude_characters="\0", exclude_categories=["Cs"]), max_size=30
)


@st.composite
def leaves(draw):
    axes = draw(st.lists(st.sampled_from(AXES), max_size=3, unique=True))
    points = {
        axis: np.array(sorted(draw(st.lists(NUMBERS, min_size=1, max_size=4, unique=True))))
        for axis in axes
    }
    shape = tuple(len(p) for p in points.values())
    count = int(np.prod(shape))
    values = np.array(draw(st.lists(NUMBERS, min_size=count, max_size=count))).reshape(shape)
    stderr = draw(st.none() | st.floats(0.0, 10.0))
    regressors = draw(st.lists(st.sampled_from(REGRESSORS), max_size=2))
    source = draw(st.none() | st.sampled_from(terms.SOURCES))
    outside = draw(st.sampled_from(["hold", "linear"]))
    K1 = (
        xr.DataArray([0.5, draw(NUMBERS)], coords={"x_cg": [0.1, 0.3]}, dims="x_cg")
        if draw(st.booleans())
        else None
    )
    more = {"history": draw(TEXT)} if draw(st.booleans()) else {}
    power = draw(
        st.none()
        | st.builds(
            terms.PowerFactor, st.just("h_agl"), st.floats(-10.0, 10.0), st.floats(1e-3, 1e3)
        )
    )
    facts = {"outside": outside, "comment": draw(TEXT), **more}
    leaf = terms.make_term(
        values, points, regressors, stderr=stderr, source=source, K1=K1, power=power, **facts
    )
    if draw(st.booleans()):
        leaf["value"].attrs["formula"] = draw(TEXT)
        leaf.attrs |= {"order": draw(st.integers(-(2**53), 2**53)), "weight": draw(NUMBERS)}
    return leaf


@st.composite
def databases(draw):
    names = draw(
        st.lists(
            st.sampled_from(["CL/basic", "CL/gear", "CD/basic", "Cl/beta", "Cm/qhat"]),
            min_size=1,
            unique=True,
        )
    )
    attributes = {
        "title": draw(TEXT),
        "aircraft": "any",
        "S": draw(st.floats(1e-3, 1e3)),
        "cbar": 1.5,
        "b": 10.0,
    }
    place = {
        "x_ref": draw(NUMBERS),
        "y_ref": 0.0,
        "z_ref": 0.0,
        "force_axes": "stability",
        "comment": draw(TEXT),
    }
    return aerodb.make_database({name: draw(leaves()) for name in names}, **attributes, **place)


@pytest.mark.nightly
@pytest.mark.parametrize("fmt", ["netcdf", "matlab", "csv"])
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(db=databases())
def test_there_and_back_gives_the_same_tree(mat_files_in_this_process, tmp_path, db, fmt):
    write, read = {
        "netcdf": (aerodb.save, aerodb.open),
        "matlab": (aerodb.exchange.export_matlab, aerodb.exchange.import_matlab),
        "csv": (aerodb.exchange.export_csv, aerodb.exchange.import_csv),
    }[fmt]
    write(db, tmp_path / "any")
    back = read(tmp_path / "any")
    xr.testing.assert_identical(back, db)
    assert list(aerodb.terms(back)) == list(aerodb.terms(db))
    for name, leaf in aerodb.terms(db).items():
        assert {key: item.dtype for key, item in aerodb.terms(back)[name].variables.items()} == {
            key: item.dtype for key, item in leaf.variables.items()
        }


@pytest.mark.nightly
@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(db=databases())
def test_a_look_at_a_file_shows_what_the_whole_tree_holds(tmp_path, db):
    path = tmp_path / "any.nc"
    aerodb.save(
        aerodb.store.with_checks(aerodb.edit.scale(db, [next(iter(aerodb.terms(db)))], 2.0), 1),
        path,
    )
    whole = aerodb.open(path)
    for name, leaf in aerodb.terms(whole).items():
        assert open_term(path, name).identical(leaf)
    assert read_database_seal(path).overview(overview.OVERVIEW) == [
        whole.attrs,
        overview.describe_database(whole),
    ]


@pytest.mark.nightly
@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(db=databases(), count=st.integers(1, 5), seed=st.integers(0, 9))
def test_check_cases_and_previous_states_travel_with_the_file(tmp_path, db, count, seed):
    name = next(iter(aerodb.terms(db)))
    edited = (
        aerodb.delete_terms(db, [name])
        if len(aerodb.terms(db)) > 1
        else aerodb.edit.scale(db, [name], 2.0)
    )
    edited = aerodb.store.with_checks(edited, count, seed)
    aerodb.save(edited, tmp_path / "any.nc")
    back = aerodb.open(tmp_path / "any.nc")
    xr.testing.assert_identical(back, edited)
    assert {"checks", "previous"} <= set(back.children)
    xr.testing.assert_identical(aerodb.store.undo_edits(back), aerodb.store.undo_edits(edited))


def test_the_same_database_gives_the_same_bytes(small, tmp_path):
    for name in ("a.nc", "b.nc"):
        aerodb.save(small.copy(deep=True), tmp_path / name)
    assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()
    aerodb.save(aerodb.open(tmp_path / "a.nc"), tmp_path / "b.nc")
    assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()


def test_plain_h5py_reads_the_file(small, tmp_path):
    aerodb.save(small, tmp_path / "small.nc")
    with h5py.File(tmp_path / "small.nc") as file:
        assert file.attrs["force_axes"] == "stability"
        assert file.attrs["S"] == 16.9
        leaf = file["CL/basic"]
        np.testing.assert_array_equal(leaf["value"][:, 1], [0.2, 0.2])
        np.testing.assert_array_equal(leaf["alpha"][:], np.radians([-8.0, 0.0, 8.0, 16.0]))
        assert leaf["alpha"].attrs["units"] == "rad"
        assert file["CL/qhat"].attrs["regressors"] == "qhat"
        assert leaf["source"].attrs["flag_meanings"] == "datcom flight judgement"
        assert [axis[0].name for axis in leaf["value"].dims] == [
            "/CL/basic/mach",
            "/CL/basic/alpha",
        ]
        assert [axis.label for axis in file["CL/qhat/stderr"].dims] == [""]
        assert list(file) == ["CL", "Cm"]
        scales = [
            leaf[axis]
            for leaf in file["CL"].values()
            for axis in leaf
            if axis in ("mach", "alpha", "delta_f")
        ]
        assert sorted(scale.attrs["_Netcdf4Dimid"] for scale in scales) == [
            0,
            1,
            2,
            3,
        ]  # netCDF finds dimensions by this number
        assert list(file["CL"]) == ["basic", "qhat", "flap"]


def test_a_faulty_database_leaves_the_old_file_and_no_other(small, tmp_path):
    path = tmp_path / "small.nc"
    aerodb.save(small, path)
    before = path.read_bytes()
    faulty = small.copy(deep=True)
    faulty["CL/flap"]["value"][0] = np.nan
    with pytest.raises(SchemaError, match="CL/flap: value holds 1 NaN"):
        aerodb.save(faulty, path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["small.nc"]


def test_a_write_that_breaks_off_leaves_the_old_file(small, tmp_path, monkeypatch):
    path = tmp_path / "small.nc"
    aerodb.save(small, path)
    before = path.read_bytes()

    def broken(part, content):
        with open(part, "wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_bytes", broken)
    with pytest.raises(OSError, match="no space left"):
        aerodb.save(small, path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["small.nc"]


def saved_by_another_process(db, path):
    """Replace a database as a process does that has never read it."""
    aerodb.save(db, path.with_name("theirs.nc"))
    path.with_name("theirs.nc").replace(path)


@pytest.mark.slow
def test_of_two_editors_of_one_database_the_second_is_refused(small, tmp_path):
    path = tmp_path / "a.nc"
    aerodb.save(small, path)
    ours, theirs = aerodb.open(path), aerodb.edit.scale(small, "CL/flap", 2.0)
    saved_by_another_process(theirs, path)
    ours = aerodb.edit.scale(ours, "CL/flap", 1.5)
    with pytest.raises(
        SchemaError,
        match="was saved by another program after it was read here; open it again and repeat the "
        "edit",
    ):
        aerodb.save(ours, path)
    xr.testing.assert_identical(aerodb.open(path), theirs)
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc"]
    aerodb.save(ours, path)  # opened again, it may be replaced, and once more by who saved it last
    aerodb.save(theirs, path)


def test_a_database_that_was_saved_again_with_the_same_content_is_the_one_that_was_read(
    small, tmp_path
):
    path = tmp_path / "a.nc"
    aerodb.save(small, path)
    aerodb.open(path)
    saved_by_another_process(small, path)
    aerodb.save(aerodb.edit.scale(small, "CL/flap", 1.5), path)


def test_a_file_has_no_time_of_its_writing(small, tmp_path):
    """Equal content gives equal bytes: a later saving would else look like a change."""
    aerodb.save(small, tmp_path / "a.nc")
    times = set()
    with h5py.File(tmp_path / "a.nc") as file:
        for name in ["/", *all_names(file)]:
            facts = h5py.h5o.get_info(file[name].id)
            times |= {facts.atime, facts.mtime, facts.ctime, facts.btime}
    assert times == {0}


def all_names(file):
    names = []
    file.visit(names.append)
    return names
