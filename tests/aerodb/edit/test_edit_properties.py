"""What holds for every edit of every database: databases and conditions drawn at random."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import aerodb
from aerodb.store.grids import value_breakpoints
from aerodb.store.schema import FORCE_AXES
from flightmech import axes, terms
from flightmech.errors import AeromatchWarning

AXES = {  # ranges of the tables; conditions are drawn inside
    "alpha": (-0.2, 0.35),
    "beta": (-0.3, 0.3),
    "mach": (0.1, 0.7),
    "delta_e": (-0.4, 0.3),
    "delta_f": (0.0, 0.7),
    "h_agl": (0.0, 40.0),
}
CAUSES = {
    "basic": (),
    "flap": (),
    "elevator": (),
    "beta": ("beta",),
    "qhat": ("qhat",),
    "slope": ("alpha", "delta_r"),
    "gear": ("gear",),
}
REACH = {"qhat": 0.02, "delta_r": 0.3, "gear": 1.0}
ROOT = {
    "title": "drawn",
    "aircraft": "none",
    "S": 20.0,
    "cbar": 1.7,
    "b": 11.0,
    "x_ref": -3.0,
    "y_ref": 0.0,
    "z_ref": 0.2,
}
seeds = st.integers(0, 2**32 - 1)
thorough = settings(max_examples=6, deadline=None)


def drawn(rng, force_axes="stability", zeros=True, most=3):
    """Return a random database: tables of few axes, some with a factor K1, without standard error
    or without source.
    """
    leaves = {}
    for coefficient in FORCE_AXES[force_axes]:
        for cause in rng.choice(list(CAUSES), rng.integers(1, 4), replace=False):
            leaves[f"{coefficient}/{cause}"] = leaf(rng, CAUSES[cause], zeros, most)
    return aerodb.make_database(
        leaves, **ROOT, force_axes=force_axes, history="drawn", absent="CL/power"
    )


def leaf(rng, regressors, zeros, most):
    names = list(rng.permutation(list(AXES)))
    own, factor = names[: rng.integers(0, most + 1)], names[4] if rng.random() < 0.3 else None
    points = {axis: breakpoints(rng, axis) for axis in own}
    shape = tuple(len(p) for p in points.values())
    K1 = None
    if factor:
        x = breakpoints(rng, factor)
        K1 = xr.DataArray(rng.normal(size=len(x)), {factor: x}, factor)
    sd = rng.uniform(0.01, 0.3, shape) * (rng.random(shape) > 0.2 if zeros else 1.0)
    new = terms.make_term(
        rng.normal(size=shape),
        points,
        regressors,
        stderr=sd if rng.random() < 0.8 or not zeros else None,
        source="datcom",
        K1=K1,
    )
    new["source"] = (
        new["value"].dims,
        rng.integers(0, 3, shape).astype(np.uint8),
        new["source"].attrs,
    )
    return new if rng.random() < 0.8 else new.drop_vars("source")


def breakpoints(rng, axis):
    low, high = AXES[axis]
    inner = np.sort(rng.uniform(low, high, rng.integers(0, 4)))
    return np.unique(np.round(np.concatenate([[low], inner, [high]]), 6))


def conditions(rng, count=40):
    found = {axis: rng.uniform(*ends, count) for axis, ends in AXES.items()}
    return found | {name: rng.uniform(-reach, reach, count) for name, reach in REACH.items()}


def value(db, name, at):
    return terms.evaluate_term(aerodb.terms(db)[name], at)


def table(rng, leaf, axes=None):
    """Return a random table over some axes of a leaf: numbers and breakpoints."""
    own = value_breakpoints(leaf)
    chosen = [axis for axis in own if rng.random() < 0.6] if axes is None else axes
    points = {axis: np.unique(np.round(rng.uniform(*AXES[axis], 3), 6)) for axis in chosen}
    return rng.normal(size=tuple(len(p) for p in points.values())), points


def unchanged_apart_from(before, after, names):
    old, new = aerodb.terms(before), aerodb.terms(after)
    assert [name for name in old if name in new] == [name for name in new if name in old]
    for name in old:
        if name not in names:
            xr.testing.assert_identical(old[name], new[name])


def sound(before, after, copy):
    """What every edit owes: a sound tree, one more line, the way back, and the old tree as it
    was.
    """
    assert aerodb.check(after) == []
    assert after.attrs["history"].splitlines()[:-1] == before.attrs["history"].splitlines()
    assert aerodb.store.undo_edits(after).identical(before)
    assert list(aerodb.terms(aerodb.store.undo_edits(after))) == list(aerodb.terms(before))
    assert before.identical(copy)


def any_edit(rng, db, name):
    """Return a random edit of a term."""
    leaf = aerodb.terms(db)[name]
    own = value_breakpoints(leaf)
    edits = {
        "scale": lambda: aerodb.edit.scale(db, name, *table(rng, leaf), stderr=0.1),
        "shift": lambda: aerodb.edit.shift(db, name, *table(rng, leaf), stderr=0.1, note="a\nnote"),
        "delete": lambda: aerodb.delete_terms(db, [name]),
        "replace": lambda: aerodb.replace_terms(
            db, {name: terms.make_term(0.5), "CL/new_one": terms.make_term(1.0)}
        ),
    }
    if own:
        axis = str(rng.choice(list(own)))
        edits["regrid"] = lambda: aerodb.edit.regrid(db, name, {axis: own[axis][[0, -1]]})
        edits["extend"] = lambda: aerodb.edit.extend(
            db, name, axis, [own[axis][-1] + 0.3, own[axis][-1] + 0.5], "linear", note="further"
        )
    return edits[str(rng.choice(list(edits)))]()


@pytest.mark.nightly
@thorough
@given(seeds)
@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_an_edit_leaves_all_else_alone_and_can_be_taken_back(seed):
    rng = np.random.default_rng(seed)
    first = drawn(rng)
    states = [first]
    for _ in range(3):
        before = states[-1]
        copy, name = before.copy(deep=True), str(rng.choice(list(aerodb.terms(before))))
        after = any_edit(rng, before, name)
        sound(before, after, copy)
        unchanged_apart_from(before, after, [name, "CL/new_one"])
        states.append(after)
    assert aerodb.store.undo_edits(states[-1], steps=3).identical(first)
    assert aerodb.store.undo_edits(states[-1], edit=2).identical(states[1])
    rows = aerodb.store.history(states[-1])
    assert list(rows["edit"]) == [None, 1, 2, 3]
    for k, row in enumerate(rows.iloc[1:].itertuples()):
        assert aerodb.store.undo_edits(states[-1], edit=row.edit).identical(states[k])
    released = aerodb.store.drop_undo_history(states[-1])
    assert "previous" not in released.children
    assert released.attrs == states[-1].attrs


@pytest.mark.nightly
@thorough
@given(seeds, st.integers(-30, 30), st.integers(0, 5))
def test_a_factor_multiplies_everywhere(seed, tenths, hundredths):
    f, sd, rng = tenths / 10, hundredths / 100, np.random.default_rng(seed)
    db = drawn(rng)
    name, at = str(rng.choice(list(aerodb.terms(db)))), conditions(rng)
    new = aerodb.edit.scale(db, name, f, stderr=sd)
    np.testing.assert_allclose(
        value(new, name, at), f * value(db, name, at), rtol=1e-12, atol=1e-13
    )
    old, leaf = aerodb.terms(db)[name], aerodb.terms(new)[name]
    if "stderr" in old:
        np.testing.assert_allclose(
            leaf["stderr"], np.sqrt((f * old["stderr"]) ** 2 + (sd * old["value"]) ** 2), rtol=1e-12
        )
    else:
        assert ("stderr" in leaf) == (sd > 0)


@pytest.mark.slow
@thorough
@given(seeds)
def test_a_factor_table_multiplies_the_nodes(seed):
    rng = np.random.default_rng(seed)
    db = drawn(rng)
    name = str(rng.choice(list(aerodb.terms(db))))
    old = aerodb.terms(db)[name]
    numbers, points = table(rng, old)
    new = aerodb.edit.scale(db, name, numbers, points)
    leaf, factor = aerodb.terms(new)[name], terms.make_term(numbers, points)
    nodes = (
        dict(
            zip(
                value_breakpoints(leaf),
                np.meshgrid(*value_breakpoints(leaf).values(), indexing="ij"),
            )
        )
        if value_breakpoints(leaf)
        else {}
    )
    bare = [part[["value"]].assign_attrs(regressors="") for part in (old, leaf)]
    before, after = (terms.evaluate_term(part, nodes) for part in bare)
    np.testing.assert_allclose(
        after, before * terms.evaluate_term(factor, nodes, "clamp"), rtol=1e-9, atol=1e-12
    )
    for axis, own in value_breakpoints(old).items():
        assert {*own} <= {*value_breakpoints(leaf)[axis]}


@pytest.mark.nightly
@thorough
@given(seeds)
def test_a_factor_over_another_axis_multiplies_everywhere(seed):
    rng = np.random.default_rng(seed)
    db = drawn(rng)
    name, at = str(rng.choice(list(aerodb.terms(db)))), conditions(rng)
    old = aerodb.terms(db)[name]
    other = next(axis for axis in AXES if axis not in old.coords)
    points = np.linspace(*AXES[other], 4)
    numbers = rng.normal(size=4)
    new = aerodb.edit.scale(db, name, numbers, {other: points})
    np.testing.assert_allclose(
        value(new, name, at),
        np.interp(at[other], points, numbers) * value(db, name, at),
        rtol=1e-9,
        atol=1e-12,
    )


@pytest.mark.nightly
@thorough
@given(seeds)
def test_an_amount_adds_everywhere(seed):
    rng = np.random.default_rng(seed)
    db = drawn(rng, zeros=False)
    name, at = str(rng.choice(list(aerodb.terms(db)))), conditions(rng)
    old = aerodb.terms(db)[name]
    numbers, points = table(rng, old)
    new = aerodb.edit.shift(db, name, numbers, points, stderr=0.2)
    more = terms.evaluate_term(
        terms.make_term(numbers, points, terms.list_regressors(old), K1=old.get("K1")), at, "clamp"
    )
    np.testing.assert_allclose(
        value(new, name, at), value(db, name, at) + more, rtol=1e-9, atol=1e-12
    )
    assert (aerodb.terms(new)[name]["stderr"] > 0.2).all()


@pytest.mark.nightly
@thorough
@given(seeds)
def test_the_error_of_a_regrid_is_the_largest_difference_there_is(seed):
    rng = np.random.default_rng(seed)
    db = drawn(rng)
    names = [name for name, leaf in aerodb.terms(db).items() if value_breakpoints(leaf)]
    if not names:
        return
    name = str(rng.choice(names))
    old = aerodb.terms(db)[name]
    axis = str(rng.choice(list(value_breakpoints(old))))
    own = old[axis].values
    points = np.unique([own[0], own[-1], *rng.choice(own, 1), *rng.uniform(own[0], own[-1], 2)])
    error = aerodb.edit.regrid_error(db, name, {axis: points})
    new = aerodb.edit.regrid(db, name, {axis: points}, tolerance=error)
    at = conditions(rng, 300) | dict.fromkeys((*REACH,), 1.0)
    bare = {
        key: aerodb.terms(tree)[name].assign_attrs(regressors="")
        for key, tree in (("old", db), ("new", new))
    }
    differences = np.abs(
        terms.evaluate_term(bare["new"], at) - terms.evaluate_term(bare["old"], at)
    )
    assert differences.max() <= error * (1 + 1e-9) + 1e-12
    np.testing.assert_allclose(aerodb.terms(new)[name][axis], points)
    finer = aerodb.edit.regrid(db, name, {axis: np.union1d(own, points)})
    assert aerodb.edit.regrid_error(db, name, {axis: np.union1d(own, points)}) < 1e-12
    np.testing.assert_allclose(value(finer, name, at), value(db, name, at), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@thorough
@given(seeds, st.sampled_from(["hold", "linear"]))
def test_an_extended_table_is_the_old_one_inside_and_follows_the_rule_outside(seed, how):
    rng = np.random.default_rng(seed)
    db = drawn(rng)
    names = [name for name, leaf in aerodb.terms(db).items() if value_breakpoints(leaf)]
    if not names:
        return
    name = str(rng.choice(names))
    old = aerodb.terms(db)[name]
    axis = str(rng.choice(list(value_breakpoints(old))))
    low, high = AXES[axis]
    new = aerodb.edit.extend(db, name, axis, [low - 0.3, high + 0.1, high + 0.5], how)
    at = conditions(rng)
    np.testing.assert_allclose(value(new, name, at), value(db, name, at), rtol=1e-9, atol=1e-12)
    at[axis] = np.concatenate([rng.uniform(low - 0.3, low, 20), rng.uniform(high, high + 0.5, 20)])
    without_factor = [
        leaf.drop_vars("K1", errors="ignore")
        for leaf in (old.assign_attrs(outside=how), aerodb.terms(new)[name])
    ]
    expected, found = (terms.evaluate_term(leaf, at, "clamp") for leaf in without_factor)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    leaf = aerodb.terms(new)[name]
    assert (leaf["source"].sel({axis: [low - 0.3, high + 0.1, high + 0.5]}) == 2).all()
    inside = leaf["source"].sel({axis: old[axis]})
    np.testing.assert_array_equal(
        inside, old["source"] if "source" in old else np.full(inside.shape, 2)
    )
    if "stderr" in old:
        ends = old["stderr"].sel({axis: [low, high, high]}).values
        assert (
            leaf["stderr"].sel({axis: [low - 0.3, high + 0.1, high + 0.5]}).values >= ends
        ).all()


def body_forces(db, at):
    """Return the force coefficients in body axes (samples, 3), by matrices."""
    force_axes = db.attrs["force_axes"]
    names = FORCE_AXES[force_axes][:3]
    c = {
        name: np.broadcast_to(aerodb.evaluate(db, name, "clamp", **at), at["alpha"].shape)
        for name in names
    }
    if force_axes == "body":
        return np.stack([c["CX"], c["CY"], c["CZ"]], axis=-1)
    along = np.stack([-c["CD"], c["CY"], -c["CL"]], axis=-1)
    if force_axes == "wind":  # wind axes to stability axes: a turn by -beta about z
        s, k = np.sin(at["beta"]), np.cos(at["beta"])
        along = np.stack(
            [along[:, 0] * k - along[:, 1] * s, along[:, 0] * s + along[:, 1] * k, along[:, 2]],
            axis=-1,
        )
    return axes.stability_to_body(along, at["alpha"])


def moments(db, at):
    return np.stack(
        [
            np.broadcast_to(aerodb.evaluate(db, c, "clamp", **at), at["alpha"].shape)
            for c in ("Cl", "Cm", "Cn")
        ],
        axis=-1,
    )


def size(leaf):
    return float(np.prod([np.abs(leaf[key]).max() for key in ("value", "K1", "K2") if key in leaf]))


def bound(db, at, d, tolerance):
    """Return what the tolerance allows at each sample, times the length of the moment."""
    leaves = {
        n: leaf for n, leaf in aerodb.terms(db).items() if n.split("/")[0] not in ("Cl", "Cm", "Cn")
    }
    kinds = {
        n: (n.split("/")[0], *sorted(terms.list_regressors(leaf))) for n, leaf in leaves.items()
    }
    total = np.zeros(at["alpha"].shape)
    for name, leaf in leaves.items():
        largest = max(size(leaves[other]) for other in leaves if kinds[other] == kinds[name])
        total += largest * np.abs(
            np.prod([at[word] for word in terms.list_regressors(leaf)], axis=0)
        )
    return tolerance * total * np.linalg.norm(d)


@pytest.mark.nightly
@settings(max_examples=5, deadline=None)
@given(seeds, st.sampled_from(["stability", "wind", "body"]), st.sampled_from([1e-2, 1e-4]))
def test_moments_about_another_point_are_those_of_the_cross_product(seed, force_axes, tolerance):
    rng = np.random.default_rng(seed)
    db, at = drawn(rng, force_axes, most=2 if force_axes == "wind" else 3), conditions(rng)
    point = np.array([-3.0, 0.0, 0.2]) + rng.uniform(-0.5, 0.5, 3) * [1, rng.integers(0, 2), 0]
    new = aerodb.transform.move_reference(db, point, tolerance=tolerance)
    sound(db, new, db.copy(deep=True))
    d = np.array([-3.0, 0.0, 0.2]) - point
    lengths = np.array([11.0, 1.7, 11.0])
    expected = (
        axes.transfer_moment(
            moments(db, at) * lengths, body_forces(db, at), [-3.0, 0.0, 0.2], point
        )
        / lengths
    )
    off = np.abs(moments(new, at) - expected) * lengths
    assert (off <= bound(db, at, d, tolerance)[:, None] + 1e-11).all()
    np.testing.assert_array_equal(body_forces(new, at), body_forces(db, at))
    unchanged_apart_from(db, new, [n for n in aerodb.terms(db) if n[:2] in ("Cl", "Cm", "Cn")])
    # back again: to the bit while the undo entry is kept, else to rounding
    back = aerodb.transform.move_reference(new, [-3.0, 0.0, 0.2])
    assert {n: leaf for n, leaf in aerodb.terms(back).items()}.keys() == aerodb.terms(db).keys()
    for name, leaf in aerodb.terms(back).items():
        xr.testing.assert_identical(leaf, aerodb.terms(db)[name])
    back = aerodb.transform.move_reference(
        aerodb.store.drop_undo_history(new), [-3.0, 0.0, 0.2], tolerance=tolerance
    )
    np.testing.assert_allclose(moments(back, at), moments(db, at), rtol=0, atol=1e-12)


@pytest.mark.nightly
@thorough
@given(seeds, st.sampled_from(["inverse_variance", "correlated"]))
@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_a_blend_is_no_worse_than_either(seed, rule):
    rng = np.random.default_rng(seed)
    db = drawn(rng, zeros=False)
    other = aerodb.edit.shift(db, "*", 0.1, stderr=0.2)
    name = str(rng.choice(list(aerodb.terms(db))))
    new = aerodb.edit.blend(db, other, name, rule)
    sound(db, new, db.copy(deep=True))
    unchanged_apart_from(db, new, [name])
    ours, theirs, joined = (aerodb.terms(tree)[name] for tree in (db, other, new))
    assert (
        joined["stderr"].values <= np.minimum(ours["stderr"], theirs["stderr"]).values * (1 + 1e-9)
    ).all()
    if rule == "inverse_variance":
        w1, w2 = ours["stderr"].values ** -2, theirs["stderr"].values ** -2
        np.testing.assert_allclose(
            joined["value"], (w1 * ours["value"] + w2 * theirs["value"]) / (w1 + w2), rtol=1e-9
        )
        np.testing.assert_allclose(joined["stderr"], (w1 + w2) ** -0.5, rtol=1e-9)
    same = aerodb.edit.blend(other, db, name)
    np.testing.assert_allclose(
        aerodb.terms(same)[name]["value"],
        aerodb.terms(aerodb.edit.blend(db, other, name))[name]["value"],
        rtol=1e-9,
    )


@pytest.mark.nightly
@settings(max_examples=3, deadline=None)
@given(seed=seeds)
def test_edited_files_come_back_whole(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    db = drawn(rng, zeros=False)
    name = next(iter(aerodb.terms(db)))
    new = aerodb.transform.move_reference(
        aerodb.edit.scale(db, name, 1.2, note="größer"), [-2.9, 0.0, 0.2]
    )
    path = tmp_path_factory.mktemp("edited") / "edited.nc"
    aerodb.save(new, path)
    again = aerodb.open(path)
    assert again.identical(new)
    assert aerodb.store.undo_edits(again, 2).identical(db)
    assert aerodb.store.history(again).equals(aerodb.store.history(new))


def test_nodes_that_are_zero_by_definition_are_watched(small):
    with pytest.warns(AeromatchWarning, match="1 nodes of CL/flap were zero by definition"):
        aerodb.edit.shift(small, "CL/flap", 0.01)
    new = aerodb.edit.shift(
        small, "CL/flap", [0.0, 0.01, 0.01], {"delta_f": np.radians([0, 20, 40])}
    )
    np.testing.assert_allclose(aerodb.terms(new)["CL/flap"]["value"], [0.0, 0.21, 0.37])
