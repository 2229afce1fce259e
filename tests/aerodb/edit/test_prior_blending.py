"""A-priori sources blended by the covariance of their errors."""

import warnings

import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.edit.joined_sources.prior_blending import blend_sources
from aerodb.edit.joined_sources.prior_sources import COMMON_ERROR, collect_tables, label_sources
from aerodb.edit.joined_sources.source_blending import NODE_ERROR, blend_term
from aerodb.edit.joined_sources.source_nodes import spread_on_grid
from flightmech import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.units import DEGREE

# the small databases here lack most terms
pytestmark = pytest.mark.filterwarnings("ignore:.*implausible:flightmech.errors.AeromatchWarning")

ALPHA = np.array([0.0, 4.0, 8.0]) * DEGREE
BOX = {"S": 16.0, "cbar": 1.5, "b": 11.0}


def table(value, alpha=ALPHA, stderr=0.1, source="datcom", regressors=("beta",), **axes):
    """Return a term over alpha and further axes."""
    axes = {**axes, "alpha": alpha}
    shape = tuple(len(points) for points in axes.values())
    return terms.make_term(
        np.broadcast_to(value, shape).copy(),
        axes,
        regressors,
        stderr=np.broadcast_to(stderr, shape),
        source=source,
    )


def database(leaves, program, point=0.0, **box):
    """Return a database of one program."""
    return aerodb.make_database(
        leaves,
        title=f"box from {program}",
        aircraft="box",
        **{**BOX, **box},
        x_ref=point,
        y_ref=0.0,
        z_ref=0.0,
        force_axes="stability",
        source=program,
    )


def blended(*leaves, programs=("Digital DATCOM", "AVL", "Wind tunnel"), name="Cn/beta"):
    """Return the blend of one term of several sources."""
    databases = [database({name: leaf}, program) for leaf, program in zip(leaves, programs)]
    return blend_term(name, collect_tables(label_sources(databases), name))


@pytest.fixture
def aircraft():
    return Aircraft("box", **BOX, mass=1e3, Ixx=1e3, Iyy=1e3, Izz=1e3, reference=(0.0, 0.0, 0.0))


def test_absolute_errors_of_two_methods_weigh_by_their_variance():
    # constant values and errors: scalar weights 1/s^2, and no node adds to another
    term = blended(table(0.10, stderr=0.02), table(0.16, stderr=0.04))
    assert term.leaf["value"].values == pytest.approx(0.112, rel=1e-9)
    # weights 0.8 and 0.2, and the common error of all methods
    variance = 0.016**2 + 0.008**2 + 2 * COMMON_ERROR["aeroplane"] * 0.016 * 0.008
    assert term.leaf["stderr"].values == pytest.approx(np.sqrt(variance), rel=1e-9)


def test_a_common_error_is_not_averaged_over_the_nodes():
    many = np.linspace(0.0, 8.0, 33) * DEGREE
    few = blended(table(0.1, stderr=0.02), table(0.1, stderr=0.02))
    dense = blended(table(0.1, alpha=many, stderr=0.02), table(0.1, alpha=many, stderr=0.02))
    assert dense.leaf["stderr"].values == pytest.approx(few.leaf["stderr"].values[0], rel=1e-6)


def test_two_runs_of_one_program_are_not_independent():
    pair = [table(0.10, stderr=0.02), table(0.12, stderr=0.02)]
    apart = blended(*pair)
    same = blended(*pair, programs=("AVL", "AVL"))
    renamed = blended(*pair, programs=("AVL", "OptVL"))
    assert renamed.leaf["stderr"].values == pytest.approx(same.leaf["stderr"].values, rel=1e-12)
    method = blended(*pair, programs=("AVL", "VSPAERO"))
    for term in (apart, same, method):
        assert term.leaf["value"].values == pytest.approx(0.11, rel=1e-9)
    rho = COMMON_ERROR["program"]
    assert same.leaf["stderr"].values == pytest.approx(0.02 * np.sqrt((1 + rho) / 2), rel=1e-9)
    rho = COMMON_ERROR["method"]
    assert method.leaf["stderr"].values == pytest.approx(0.02 * np.sqrt((1 + rho) / 2), rel=1e-9)
    rho = COMMON_ERROR["aeroplane"]
    assert apart.leaf["stderr"].values == pytest.approx(0.02 * np.sqrt((1 + rho) / 2), rel=1e-9)
    assert same.labels == ("AVL 1", "AVL 2")


def test_correlated_sources_of_different_size_stay_between_them():
    # the best weights of correlation 0.9 and errors 1 : 3 would be negative
    term = blended(table(0.10, stderr=0.01), table(0.16, stderr=0.03), programs=("AVL", "AVL"))
    assert np.all((term.leaf["value"].values > 0.10) & (term.leaf["value"].values < 0.16))


def test_relative_errors_refer_to_the_common_value():
    # 30 % of each value: with errors of their own the smaller one would weigh four times as much
    value = np.array([1.0, 1.1, 0.9])
    term = blended(table(value, stderr=0.3 * value), table(2 * value, stderr=0.6 * value))
    assert term.leaf["value"].values == pytest.approx(1.5 * value, rel=1e-6)


def test_a_silent_source_lets_the_other_be_corrected_there():
    # AVL ends at 4 deg; the common part of the error of DATCOM reaches 8 deg
    term = blended(table(0.10, stderr=0.02), table(0.14, alpha=ALPHA[:2], stderr=0.02))
    value = term.leaf["value"].values
    assert value[:2] == pytest.approx(0.12, rel=1e-9)
    assert 0.11 < value[2] < 0.12
    # beyond, the error is at least that of the nodes where both speak
    assert np.all(np.diff(term.leaf["stderr"].values) >= -1e-12)


def test_interpolation_of_a_coarse_table_has_an_error():
    fine = np.linspace(0.0, 8.0, 9) * DEGREE
    curved = table(fine**2, alpha=fine, stderr=1e-4)
    coarse = table(fine[[0, 8]] ** 2, alpha=fine[[0, 8]], stderr=1e-4)
    sources = label_sources(
        [database({"Cn/beta": curved}, "A"), database({"Cn/beta": coarse}, "B")]
    )
    _, (first, second) = spread_on_grid(collect_tables(sources, "Cn/beta"), {})
    assert not first.own_error.any()
    # a parabola: t (1 - t) h^2 with f'' = 2 is exactly the error of the chord
    missed = second.value - fine**2
    assert second.own_error == pytest.approx(missed, rel=1e-9, abs=1e-15)


def test_mach_numbers_beyond_a_source_cost_the_compressibility_change():
    low = table(0.1, mach=np.array([0.2]), stderr=0.0)
    high = table(0.1, mach=np.array([0.2, 0.5, 0.8]), stderr=0.01)
    sources = label_sources([database({"Cn/beta": low}, "A"), database({"Cn/beta": high}, "B")])
    _, (first, _) = spread_on_grid(collect_tables(sources, "Cn/beta"), {})
    change = np.sqrt((1 - 0.2**2) / (1 - 0.5**2)) - 1.0
    assert first.rank[:, 0].tolist() == [0, 0, 2]
    assert first.stderr[1] == pytest.approx(0.1 * change, rel=1e-12)


def test_judged_nodes_are_silent_where_another_source_computed():
    judged = table(0.5, stderr=0.01, source="judgement")
    term = blended(judged, table(0.1, stderr=0.02))
    assert term.leaf["value"].values == pytest.approx(0.1, rel=1e-9)
    assert (term.leaf["source"].values == terms.SOURCES.index("datcom")).all()


def test_a_derivative_meets_a_table_over_the_deflection():
    delta = np.array([-20.0, -10.0, 0.0, 10.0, 20.0]) * DEGREE
    curve = xr.DataArray(-1.0 * np.clip(delta, -15 * DEGREE, 15 * DEGREE), {"delta_e": delta})
    flat = terms.make_term(
        curve.values, {"delta_e": delta}, stderr=0.1 * abs(curve.values), source="datcom"
    )
    slope = terms.make_term(-1.4, {}, ("delta_e",), stderr=0.14, source="estimate")
    term = blended(flat, slope, name="Cm/elevator")
    value = term.leaf["value"].values
    assert term.leaf.attrs["regressors"] == ""
    assert value[2] == 0.0
    assert term.leaf["stderr"].values[2] == 0.0
    # both speak at 10 deg, the linear theory is silent at 20 deg
    assert value[3] == pytest.approx(-1.2 * delta[3], rel=1e-6)
    assert abs(value[4]) < 1.2 * 15 * DEGREE + 1e-9


def test_sources_that_disagree_are_widened_and_named(aircraft):
    first = database(
        {"CL/basic": table(0.5, regressors=()), "Cn/beta": table(0.10, stderr=0.01)}, "A"
    )
    second = database({"Cn/beta": table(0.16, stderr=0.01, source="estimate")}, "B")
    with pytest.warns(AeromatchWarning, match=r"Cn/beta: A and B disagree by up to 4\.2 standard"):
        blend = blend_sources([first, second], aircraft)
    leaf = aerodb.terms(blend.database)["Cn/beta"]
    # the standard error reaches both values
    assert leaf["stderr"].values == pytest.approx(0.03, rel=1e-6)
    assert blend.table.loc["Cn/beta", "decision"] == "widened"
    assert blend.table.loc["Cn/beta", "probability"] == pytest.approx(2.2e-5, rel=0.05)
    assert "Cn/beta: A and B disagree" in blend.database.attrs["notices"]
    assert "widened" in leaf.attrs["history"]


def test_sources_eight_standard_errors_apart_need_a_decision(aircraft):
    first = database({"Cn/beta": table(0.10, stderr=0.01), "CY/beta": table(-0.5)}, "A")
    second = database({"Cn/beta": table(0.27, stderr=0.01)}, "B")
    with pytest.raises(SchemaError, match=r"A and B disagree by 12 .*one of them is wrong.*--take"):
        blend_sources([first, second], aircraft)
    blend = blend_sources([first, second], aircraft, take={"Cn/beta": "A"})
    assert aerodb.terms(blend.database)["Cn/beta"]["value"].values == pytest.approx(0.10)


def test_opposite_signs_far_beyond_the_errors_are_refused_unless_one_is_taken(aircraft):
    first = database({"Cn/beta": table(0.10, stderr=0.01), "CY/beta": table(-0.5)}, "A")
    second = database({"Cn/beta": table(-0.10, stderr=0.01)}, "B")
    with pytest.raises(SchemaError, match=r"opposite signs.*--take 'Cn/beta=A'"):
        blend_sources([first, second], aircraft)
    blend = blend_sources([first, second], aircraft, take={"Cn/*": "A"})
    assert aerodb.terms(blend.database)["Cn/beta"]["value"].values == pytest.approx(0.10)
    with pytest.raises(UnknownName, match="near it"):
        blend_sources([first, second], aircraft, take={"Cn/*": "AA"})
    with pytest.raises(UnknownName, match="take from B"):
        blend_sources([first, second], aircraft, take={"CY/beta": "B"})


def test_exact_values_that_differ_are_refused():
    with pytest.raises(SchemaError, match=r"exact values .* differ at alpha 0 deg"):
        blended(table(0.1, stderr=0.0), table(0.2, stderr=0.0))


def test_regressors_that_cannot_meet_are_refused():
    with pytest.raises(SchemaError, match="regressors differ: Digital DATCOM beta; AVL phat"):
        blended(table(0.1), table(0.1, regressors=("phat",)))


def test_reference_quantities_and_point_are_those_of_the_aircraft(aircraft):
    lift = table(np.array([0.2, 0.6, 1.0]), regressors=())
    moment = table(np.array([0.0, -0.1, -0.2]), regressors=())
    rates = table(-10.0, regressors=("qhat",))
    leaves = {"CL/basic": lift, "Cm/basic": moment, "Cm/qhat": rates}
    first = database(leaves, "A", S=8.0, cbar=3.0)
    second = database({"Cn/beta": table(0.1)}, "B")
    with pytest.warns(AeromatchWarning, match="not the reference quantities"):
        tree = blend_sources([first, second], aircraft).database
    after = aerodb.terms(tree)
    # S halves the coefficient, cbar doubles a moment, and once more a rate derivative
    assert after["CL/basic"]["value"].values == pytest.approx(0.5 * lift["value"].values)
    assert after["Cm/basic"]["value"].values == pytest.approx(moment["value"].values)
    assert after["Cm/qhat"]["value"].values == pytest.approx(-10.0 * 0.5 * 2.0 * 2.0)
    far = database({"Cn/beta": table(0.1)}, "B", point=1.0)
    with pytest.raises(SchemaError, match=r"0\.67 chords from"):
        blend_sources([first, far], aircraft)


def test_databases_from_flight_or_without_source_are_no_sources(aircraft):
    flown = database({"Cn/beta": table(0.1, source="flight")}, "A")
    unknown = database({"Cn/beta": table(0.1)}, "")
    with pytest.raises(SchemaError) as caught:
        blend_sources([flown, unknown], aircraft)
    text = str(caught.value)
    assert "terms from flight (Cn/beta)" in text
    assert "does not state its source" in text
    with pytest.raises(SchemaError, match="1 source"):
        blend_sources([unknown], aircraft)


def test_terms_of_one_source_cover_the_basic_tables(aircraft):
    basic = table(np.array([0.2, 0.6, 1.0]), regressors=())
    rudder = table(-0.07, alpha=ALPHA[:2], stderr=0.01, source="estimate", regressors=("delta_r",))
    first = database({"CL/basic": basic}, "Digital DATCOM")
    second = database({"Cn/rudder": rudder}, "AVL")
    blend = blend_sources([first, second], aircraft)
    leaf = aerodb.terms(blend.database)["Cn/rudder"]
    assert leaf["alpha"].values == pytest.approx(ALPHA)
    assert leaf["stderr"].values == pytest.approx([0.01, 0.01, 0.02])
    assert leaf["source"].values.tolist() == [3, 3, 2]
    assert leaf.attrs["origin"] == "AVL"
    assert blend.table.loc["Cn/rudder", "decision"] == "only AVL"
    decisions = aerodb.update.decisions(blend.database)
    assert decisions.loc["Cn/rudder", "reason"] == "no fit informs it; a priori from AVL"


def test_the_blend_is_generalised_least_squares():
    # independent check with dense matrices: both speak everywhere, errors as they are
    rng = np.random.default_rng(3)
    first = table(0.1 + 0.01 * rng.standard_normal(3), stderr=np.array([0.02, 0.03, 0.05]))
    second = table(0.1 + 0.01 * rng.standard_normal(3), stderr=np.array([0.03, 0.03, 0.02]))
    term = blended(first, second)
    value = term.leaf["value"].values
    d2 = np.subtract.outer(ALPHA, ALPHA) ** 2 / (5 * DEGREE) ** 2
    correlation = 0.5 + 0.5 * np.exp(-0.5 * d2)
    correlation = (1 - NODE_ERROR) * correlation + NODE_ERROR * np.eye(3)
    covariances = []
    for leaf in (first, second):
        s = leaf["stderr"].values
        covariances.append(np.outer(s, s) * correlation)
    A, B = map(np.linalg.inv, covariances)
    wanted = np.linalg.solve(A + B, A @ first["value"].values + B @ second["value"].values)
    # errors in proportion to the value are a small part here
    assert value == pytest.approx(wanted, abs=2e-3)
    assert not np.allclose(value, 0.5 * (first["value"] + second["value"]), atol=2e-3)


def test_the_blend_repeats_to_rounding():
    value = np.array([1.0, 1.1, 0.9])
    pair = [table(value, stderr=0.3 * value), table(1.2 * value, stderr=0.2)]
    moved = [pair[0].assign(value=pair[0]["value"] * (1.0 + 1e-12)), pair[1]]
    one, other = blended(*pair).leaf, blended(*moved).leaf
    assert other["value"].values == pytest.approx(one["value"].values, rel=1e-10)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        blended(*pair)


@pytest.mark.parametrize("share", [0.5, 0.3, 0.1])
def test_a_large_correction_reaches_silent_nodes_with_its_own_sign(share):
    # errors in proportion to the values; the second source is silent at 12 and 16 deg
    wide = np.array([0.0, 4.0, 8.0, 12.0, 16.0]) * DEGREE
    first = table(-20.0, alpha=wide, stderr=5.0, regressors=("qhat",))
    second = table(-20.0 * share, stderr=5.0 * share, regressors=("qhat",))
    value = blended(first, second, name="Cm/qhat").leaf["value"].values
    assert np.all((value >= -20.0) & (value <= -20.0 * share))
    # most of the correction is common to the table
    assert value[3:] == pytest.approx(value[0], rel=0.2)


def test_a_blend_or_a_repeated_source_is_refused(aircraft):
    first = database({"Cn/beta": table(0.10)}, "Digital DATCOM")
    second = database({"Cn/beta": table(0.12)}, "AVL")
    joined = blend_sources([first, second], aircraft).database
    with pytest.raises(SchemaError, match="is a blend, whose sources could count twice"):
        blend_sources([joined, second], aircraft)
    edited = aerodb.edit.blend(first, second)
    with pytest.raises(SchemaError, match="is a blend"):
        blend_sources([edited, second], aircraft)
    with pytest.raises(SchemaError, match=r"sources 1 and 2 .* hold the same numbers"):
        blend_sources([first, first.copy(deep=True)], aircraft)


def test_the_order_of_the_sources_does_not_matter(aircraft):
    sources = [
        database({"Cn/beta": table(0.10, stderr=0.02)}, "Digital DATCOM"),
        database({"Cn/beta": table([0.12, 0.13, 0.16], stderr=0.03)}, "AVL"),
        database({"Cn/beta": table(0.14, alpha=ALPHA[:2], stderr=0.03)}, "VSPAERO"),
    ]
    first = aerodb.terms(blend_sources(sources, aircraft).database)["Cn/beta"]
    other = aerodb.terms(blend_sources(sources[::-1], aircraft).database)["Cn/beta"]
    for key in ("value", "stderr"):
        assert other[key].values == pytest.approx(first[key].values, rel=1e-9)
    assert np.array_equal(first["source"].values, other["source"].values)


def test_another_rule_outside_of_a_source_is_a_notice(aircraft):
    leaves = [table(0.10), table(0.12).assign_attrs(outside="linear")]
    programs = ("Digital DATCOM", "AVL")
    sources = [database({"Cn/beta": leaf}, name) for leaf, name in zip(leaves, programs)]
    with pytest.warns(AeromatchWarning, match=r"Cn/beta: the rule outside is 'hold' .*, 'linear'"):
        blend = blend_sources(sources, aircraft)
    assert "the rule outside" in blend.database.attrs["notices"]
    # one source alone decides
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*rule outside")
        warnings.filterwarnings("ignore", ".*implausible")
        taken = blend_sources(sources, aircraft, take={"Cn/beta": "AVL"}).database
    assert aerodb.terms(taken)["Cn/beta"].attrs["outside"] == "linear"
