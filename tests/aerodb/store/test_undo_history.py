"""Undo history: kept, listed, applied, dropped; check cases go with the numbers they belong to."""

import hashlib

import h5py
import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from flightmech.errors import OutOfRange, SchemaError, UnknownName

CHECKS = {
    "/checks/one": xr.Dataset({"alpha": ("case", [0.0, 0.1]), "CL": ("case", [0.2, 0.7])}),
    "/checks": xr.Dataset(attrs={"by": "hand"}),
}


@pytest.fixture
def checked(small):
    nodes = {node.path: node.to_dataset(inherit=False) for node in small.subtree}
    return xr.DataTree.from_dict({**nodes, **CHECKS})


def test_the_group_of_an_edit_holds_what_it_replaced(small):
    new = aerodb.replace_terms(
        aerodb.edit.scale(small, "CL/flap", 2.0),
        {"CL/gear": aerodb.terms(small)["CL/flap"]},
        note="by guess",
    )
    assert sorted(new["previous"].children) == ["e001", "e002"]
    np.testing.assert_allclose(new["previous/e001/CL/flap"]["value"], [0.0, 0.2, 0.36])
    assert new["previous/e002"].attrs["added"] == "CL/gear"
    assert new.attrs["edits"] == 2
    assert "previous/e001/CL/flap" not in aerodb.terms(new)


def test_history_holds_the_edits(small):
    new = aerodb.delete_terms(aerodb.edit.scale(small, "CL/*", 2.0, note="twice"), ["Cm/qhat"])
    rows = aerodb.store.history(new)
    assert rows.loc[1].to_list() == [None, "", "", "", "by hand"]
    assert rows.loc[2].to_list() == [
        1,
        "scale",
        "CL/basic CL/qhat CL/flap",
        "twice",
        "scale: CL/basic CL/qhat CL/flap by 2 (twice)",
    ]
    assert rows.loc[3].to_list() == [2, "delete_terms", "Cm/qhat", "", "delete_terms: Cm/qhat"]


def test_a_group_that_no_edit_wrote_is_named_in_a_file_too(small, tmp_path):
    path = tmp_path / "a.nc"
    aerodb.save(aerodb.edit.scale(small, "CL/flap", 2.0), path)
    content = path.read_bytes()
    path.write_bytes(content[: content.rindex(b"\noverview")])
    with h5py.File(path, "a") as file:
        file["previous"].move("e001", "before")
    whole = path.read_bytes()
    path.write_bytes(
        whole + b"\nsha256 of the bytes above: %s\n" % hashlib.sha256(whole).hexdigest().encode()
    )
    with pytest.raises(SchemaError, match="/previous/before is not the undo entry of an edit"):
        aerodb.store.history(aerodb.open(path))


def test_deleting_is_taken_back_in_the_old_order(small):
    new = aerodb.delete_terms(small, ["CL/qhat"])
    back = aerodb.store.undo_edits(new)
    assert list(aerodb.terms(back)) == list(aerodb.terms(small))
    assert back.identical(small)
    assert back.attrs == small.attrs


def test_attributes_that_were_not_there_go_again(small):
    bare = small.copy()
    del bare.attrs["history"], bare.attrs["absent"]
    new = aerodb.delete_terms(bare, ["CL/qhat"])
    assert new.attrs["absent"] == "CL/qhat"
    assert aerodb.store.undo_edits(new).attrs == bare.attrs
    assert aerodb.store.history(new)["edit"].to_list() == [1]
    assert aerodb.store.history(bare).empty


def test_numbers_go_on_after_forgetting(small):
    released = aerodb.store.drop_undo_history(
        aerodb.edit.scale(aerodb.edit.scale(small, "CL/flap", 2.0), "CL/flap", 2.0)
    )
    assert released.attrs["history"].count("scale") == 2
    with pytest.raises(OutOfRange, match="1 edits cannot be undone; the undo history holds 0"):
        aerodb.store.undo_edits(released)
    new = aerodb.edit.scale(released, "CL/flap", 0.25)
    assert list(aerodb.store.history(new)["edit"]) == [None, None, None, 3]
    assert aerodb.store.undo_edits(new, edit=3).identical(released)
    with pytest.raises(
        UnknownName, match=r"unknown edit '1'; allowed: 3; aerodb\.store\.history lists"
    ):
        aerodb.store.undo_edits(new, edit=1)
    with pytest.raises(OutOfRange, match="0 edits cannot"):
        aerodb.store.undo_edits(new, steps=0)


def test_check_cases_of_the_old_numbers_are_set_aside(checked):
    first = aerodb.edit.scale(checked, "CL/flap", 2.0)
    assert "checks" not in first.children
    assert first.attrs["history"].endswith("scale: CL/flap by 2; check cases set aside")
    assert aerodb.store.history(first).loc[2, "terms"] == "CL/flap"
    second = aerodb.edit.scale(first, "CL/flap", 2.0)
    assert aerodb.store.undo_edits(second, 2).identical(checked)
    assert aerodb.store.undo_edits(second).identical(first)
    assert "checks" in aerodb.store.drop_undo_history(checked).children


def test_an_edit_that_changes_nothing_keeps_the_check_cases(checked):
    same = aerodb.transform.move_reference(checked, [-3.0, 0.0, 0.0])
    assert same["checks/one"].to_dataset().identical(checked["checks/one"].to_dataset())
    assert aerodb.store.undo_edits(same).identical(checked)


@pytest.mark.parametrize("name", ["e001", "before", "e-01"])
def test_a_group_that_no_edit_wrote_is_named(small, name):
    nodes = {node.path: node.to_dataset(inherit=False) for node in small.subtree}
    foreign = xr.DataTree.from_dict(
        {**nodes, f"/previous/{name}/CL/flap": aerodb.terms(small)["CL/flap"]}
    )
    for ask in (
        aerodb.store.history,
        aerodb.store.undo_edits,
        lambda db: aerodb.edit.scale(db, "CL/flap", 2.0),
    ):
        with pytest.raises(
            SchemaError,
            match=rf"/previous/{name} is not the undo entry of an edit; aerodb\.store\.forget "
            rf"drops",
        ):
            ask(foreign)
    assert aerodb.store.drop_undo_history(foreign).identical(small)


@pytest.mark.slow
def test_files_keep_the_states_and_the_simulation_does_not_see_them(small, tmp_path):
    aircraft = flightmech.Aircraft(
        "t", 16.9, 1.667, 10.31, 2000.0, 9e3, 8e3, 15e3, reference=(-3.0, 0.0, 0.0)
    )
    plain = aerodb.replace_terms(small, {"CL/flap": aerodb.terms(small)["CL/flap"]})
    new = aerodb.delete_terms(
        aerodb.edit.scale(aerodb.edit.scale(small, "CL/flap", 2.0), "CL/flap", 0.5), ["CL/qhat"]
    )
    aerodb.save(new, tmp_path / "new.nc")
    again = aerodb.open(tmp_path / "new.nc")
    assert again.identical(new)
    assert aerodb.store.undo_edits(again, 3).identical(small)
    plain = aerodb.delete_terms(plain, ["CL/qhat"])
    assert (
        flightmech.compile(aircraft, again).terms
        == flightmech.compile(aircraft, aerodb.store.drop_undo_history(plain)).terms
    )
