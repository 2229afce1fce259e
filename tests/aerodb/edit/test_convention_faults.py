"""Sources that differ by a slip of units, signs or reference quantities."""

import warnings
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import aerodb
from aerodb.edit.joined_sources.convention_faults import (
    UNLIKELY_BY_CHANCE,
    SourcePair,
    find_convention_faults,
    joint_errors,
)
from aerodb.edit.joined_sources.prior_blending import blend_sources
from aerodb.prior.prior_errors import PRIOR_ERRORS
from flightmech import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE

# the small databases here lack most terms
pytestmark = pytest.mark.filterwarnings("ignore:.*implausible:flightmech.errors.AeromatchWarning")

ALPHA = np.array([0.0, 4.0, 8.0]) * DEGREE
CALIBRATION = Path(__file__).parents[3] / "data" / "calibration" / "estimates.csv"
BOX = {"S": 16.0, "cbar": 1.5, "b": 11.0}
# Two opinions on one light aeroplane: derivatives of the C182 by DATCOM and by AVL, per rad.
FIRST = {
    "CY/beta": (-0.39, "beta"),
    "Cl/beta": (-0.092, "beta"),
    "Cn/beta": (0.059, "beta"),
    "Cl/phat": (-0.48, "phat"),
    "Cn/phat": (-0.028, "phat"),
    "Cl/rhat": (0.080, "rhat"),
    "Cn/rhat": (-0.094, "rhat"),
    "CL/qhat": (6.9, "qhat"),
    "Cm/qhat": (-16.0, "qhat"),
    "Cm/elevator": (-1.3, "delta_e"),
    "CL/elevator": (0.45, "delta_e"),
    "CY/rudder": (0.19, "delta_r"),
    "Cl/rudder": (0.015, "delta_r"),
    "Cn/rudder": (-0.066, "delta_r"),
}
SCATTER = (0.8, 1.15, 1.2, 0.9, 1.5, 1.3, 1.1, 0.9, 0.85, 1.2, 1.15, 0.9, 1.3, 0.95)
SECOND = {name: (s * v, of) for (name, (v, of)), s in zip(FIRST.items(), SCATTER)}


def database(numbers, program, **box):
    """Return a database of constant derivatives with the standard errors of the guide."""
    leaves = {}
    for name, (value, regressor) in numbers.items():
        relative, absolute = PRIOR_ERRORS[name]
        leaves[name] = terms.make_term(
            np.full(3, value),
            {"alpha": ALPHA},
            (regressor,),
            stderr=np.full(3, np.hypot(relative * value, absolute)),
            source="estimate",
        )
    attributes = {**BOX, **box, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    return aerodb.make_database(
        leaves,
        title=f"box from {program}",
        aircraft="box",
        force_axes="stability",
        source=program,
        **attributes,
    )


def changed(factor, *endings, starts=("",)):
    """Return the numbers of the second source with a factor on some terms."""
    numbers = {}
    for name, (value, of) in SECOND.items():
        is_changed = name.endswith(endings) and name.startswith(starts)
        numbers[name] = (factor * value if is_changed else value, of)
    return numbers


@pytest.fixture
def aircraft():
    return Aircraft("box", **BOX, mass=1e3, Ixx=1e3, Iyy=1e3, Izz=1e3, reference=(0.0, 0.0, 0.0))


def refusal(aircraft, numbers, **keywords):
    """Return the message of a blend that is refused."""
    sources = [database(FIRST, "Digital DATCOM"), database(numbers, "AVL")]
    with pytest.raises(SchemaError) as caught:
        blend_sources(sources, aircraft, **keywords)
    return str(caught.value)


def test_two_opinions_are_blended_without_a_word_on_conventions(aircraft, recwarn):
    sources = [database(FIRST, "Digital DATCOM"), database(SECOND, "AVL")]
    assert blend_sources(sources, aircraft).table["decision"].eq("blended").all()
    assert not any("probable cause" in str(item.message) for item in recwarn)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [DEGREE, 1.0 / DEGREE])
@pytest.mark.parametrize("of", ["beta", "elevator", "rudder"])
def test_a_derivative_per_degree_is_refused(aircraft, factor, of):
    text = refusal(aircraft, changed(factor, f"/{of}"))
    assert f"AVL is {factor:.4g} times Digital DATCOM" in text
    assert "probable cause: per degree in one, per radian in the other" in text
    assert f"--take '*/{of}=Digital DATCOM'" in text
    # both values of a term are stated
    name = {"beta": "Cn/beta", "elevator": "Cm/elevator", "rudder": "CY/rudder"}[of]
    assert f"{name} (Digital DATCOM {FIRST[name][0]:.4g}, AVL" in text


def test_one_term_per_degree_is_refused_and_may_be_taken(aircraft):
    numbers = SECOND | {"Cn/beta": (SECOND["Cn/beta"][0] / DEGREE, "beta")}
    sources = [database({"Cn/beta": FIRST["Cn/beta"]}, "A"), database(numbers, "B")]
    with pytest.raises(SchemaError, match=r"B is 57\.3 times A.*--take 'Cn/beta=A'"):
        blend_sources(sources, aircraft)
    # the other terms of beta agree: one of them alone has another unit
    with pytest.raises(SchemaError, match=r"- Cn/beta \(A 0.059, .* B is 57\.3 times A"):
        blend_sources([database(FIRST, "A"), database(numbers, "B")], aircraft)
    tree = blend_sources(sources, aircraft, take={"Cn/beta": "A"}).database
    assert aerodb.terms(tree)["Cn/beta"]["value"].values == pytest.approx(0.059)


def test_rates_reduced_by_the_whole_speed(aircraft):
    # two tunnels with small errors: the factor 2 alone is seen
    sources = []
    for numbers, program in ((FIRST, "tunnel A"), (changed(0.5, "hat"), "tunnel B")):
        tree = database(numbers, program)
        precise = {}
        for name, leaf in aerodb.terms(tree).items():
            precise[name] = leaf.assign(stderr=0.6 * leaf["stderr"])
        sources.append(aerodb.make_database(precise, **tree.attrs))
    with pytest.raises(SchemaError, match="rates reduced by V in one, by 2V in the other"):
        blend_sources(sources, aircraft)


@pytest.mark.slow
def test_a_less_certain_factor_of_two_is_a_warning(aircraft):
    sources = [database(FIRST, "Digital DATCOM"), database(changed(0.5, "hat"), "AVL")]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        tree = blend_sources(sources, aircraft).database
    assert any("by V in one, by 2V in the other" in str(item.message) for item in caught)
    assert "by V in one, by 2V in the other" in tree.attrs["notices"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("numbers", "cause"),
    [
        (changed(-1.0, "/rudder"), "the positive sense of rudder"),
        (changed(-1.0, "", starts=("Cl", "Cn")), "the positive sense of Cl and Cn"),
        (changed(2.0, ""), "the area of one half, or a half model"),
        (changed(BOX["b"] / BOX["cbar"], "/qhat"), "reduced by the span in one"),
        (changed(BOX["b"] / BOX["cbar"], "", starts=("Cm",)), "divided by the span in one"),
    ],
)
def test_other_slips_are_named(aircraft, numbers, cause):
    assert f"probable cause: {cause}" in refusal(aircraft, numbers).replace(
        "coefficients of another reference area: ", ""
    ).replace("rates reduced", "reduced").replace("moments divided", "divided")


def test_an_area_that_was_stated_and_not_used(aircraft):
    # the coefficients refer to 16 m2 already, the database states 11 m2
    sources = [database(FIRST, "Digital DATCOM"), database(SECOND, "AVL", S=5.5)]
    with pytest.raises(SchemaError, match=r"reference areas in the ratio 2\.91"):
        blend_sources(sources, aircraft)


TERMS = {
    "CY_beta": "CY/beta",
    "Cl_beta": "Cl/beta",
    "Cn_beta": "Cn/beta",
    "Cl_phat": "Cl/phat",
    "Cn_phat": "Cn/phat",
    "Cl_rhat": "Cl/rhat",
    "Cn_rhat": "Cn/rhat",
    "CL_qhat": "CL/qhat",
    "Cm_qhat": "Cm/qhat",
    "CL_delta_e": "CL/elevator",
    "Cm_delta_e": "Cm/elevator",
    "Cl_delta_a": "Cl/aileron",
}


def calibration_pairs(aircraft, factor=1.0, of=""):
    """Return the pairs of DATCOM and OptVL for an aircraft of the calibration."""
    numbers = pd.read_csv(CALIBRATION, comment="#").set_index(["aircraft", "program", "quantity"])
    pairs = []
    for quantity, name in TERMS.items():
        keys = [(aircraft, program, quantity) for program in ("DATCOM", "OptVL")]
        if not all(key in numbers.index for key in keys):
            continue
        values = np.array([float(numbers.loc[key, "value"]) for key in keys])
        values[1] *= factor if name.endswith(of) else 1.0
        relative, absolute = PRIOR_ERRORS[name]
        errors = joint_errors(list(values**2), list((relative * values) ** 2 + absolute**2))
        pairs.append(
            SourcePair(
                name,
                ("DATCOM", "OptVL"),
                first=values[:1],
                second=values[1:],
                relative=errors[0],
                absolute=errors[1],
                location="",
                stated=(float(values[0]), float(values[1])),
            )
        )
    return pairs


def test_no_alarm_for_the_aircraft_of_the_calibration():
    # eleven aeroplanes that nobody mistook; one slip is seen in most of them
    aircraft = pd.read_csv(CALIBRATION, comment="#")["aircraft"].unique()
    assert len(aircraft) >= 10
    seen = []
    for name in aircraft:
        assert find_convention_faults(calibration_pairs(name), 1.5, 11.0) == []
        faults = find_convention_faults(
            calibration_pairs(name, 1.0 / DEGREE, "/elevator"), 1.5, 11.0
        )
        seen.append(any("elevator in another unit" in fault.text for fault in faults))
    assert np.mean(seen) > 0.8


def test_a_number_near_its_zero_is_no_slip():
    # 57.3 by chance, within the constant part of the errors
    pair = SourcePair(
        "Cn/beta",
        ("A", "B"),
        first=np.array([0.0005]),
        second=np.array([0.0287]),
        relative=0.35,
        absolute=0.014,
        location="alpha 0 deg",
        stated=(0.0005, 0.0287),
    )
    assert find_convention_faults([pair], 1.5, 11.0) == []


def test_the_other_source_splits_the_errors_of_a_table_of_equal_values():
    # s^2 = (0.3 v)^2 + a^2 of both; a is at least a tenth of the smaller table
    squares = (1.0, 9.0)
    found = joint_errors(squares, [0.09 * v2 + 4e-4 for v2 in squares])
    assert found == pytest.approx((0.3 * np.sqrt(2.0), 0.1))
    found = joint_errors(squares, [0.09 * v2 + 0.04 for v2 in squares])
    assert found == pytest.approx((0.3 * np.sqrt(2.0), 0.2 * np.sqrt(2.0)))
    # equal values: a constant error, so that a sign counts as it does in standard errors
    _, absolute = joint_errors((1.0, 1.0), (0.04, 0.04))
    assert absolute == pytest.approx(0.2 * np.sqrt(2.0))


def test_a_difference_on_the_scale_of_the_errors():
    pair = SourcePair(
        "Cn/phat",
        ("A", "B"),
        first=np.array([1.0]),
        second=np.array([57.3]),
        relative=0.5,
        absolute=1e-6,
        location="",
        stated=(1.0, 57.3),
    )
    # far above the constant part z is the logarithm of the ratio by the relative error
    assert pair.mean_square() == pytest.approx((np.log(57.3) / 0.5) ** 2, rel=1e-6)
    assert pair.mean_square(57.3) == pytest.approx(0.0, abs=1e-12)
    (fault,) = find_convention_faults([pair], 1.5, 11.0)
    assert fault.probability < UNLIKELY_BY_CHANCE


PROGRAMS = ("DATCOM", "OptVL", "OptVL with body")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("of", [("phat", "qhat", "rhat", "alphadothat"), ("phat", "rhat")])
def test_rates_by_two_are_seen_in_every_aircraft_of_the_calibration(factor, of):
    numbers = pd.read_csv(CALIBRATION, comment="#").set_index(["aircraft", "program", "quantity"])
    rates = {quantity: name for quantity, name in TERMS.items() if name.endswith("hat")}
    seen = []
    for aircraft in numbers.index.unique("aircraft"):
        for labels in combinations(PROGRAMS, 2):
            pairs = []
            for quantity, name in rates.items():
                one, other = (numbers.loc[(aircraft, label, quantity), "value"] for label in labels)
                pairs.append(wide_pair(name, labels, one, other))
            assert find_convention_faults(pairs, 1.5, 11.0) == []
            slipped = [
                wide_pair(p.name, labels, p.first[0], p.second[0] * factor)
                if p.contribution in of
                else p
                for p in pairs
            ]
            faults = find_convention_faults(slipped, 1.5, 11.0)
            seen.append(any("by V in one, by 2V in the other" in fault.text for fault in faults))
    assert len(seen) == 33
    assert all(seen)


def wide_pair(name, labels, one, other):
    """Return a pair with the standard errors of the guide, within which a factor of 2 often is."""
    relative, absolute = PRIOR_ERRORS[name]
    values = np.array([one, other], float)
    errors = joint_errors(list(values**2), list((relative * values) ** 2 + absolute**2))
    return SourcePair(
        name,
        labels,
        first=values[:1],
        second=values[1:],
        relative=errors[0],
        absolute=errors[1],
        location="",
        stated=(float(one), float(other)),
    )


def test_a_factor_of_two_in_all_coefficients_is_no_fault_of_the_rates():
    pairs = [
        wide_pair(name, ("A", "B"), v, 2.0 * SECOND[name][0]) for name, (v, _) in FIRST.items()
    ]
    texts = " ".join(fault.text for fault in find_convention_faults(pairs, 1.5, 11.0))
    assert "the area of one half" in texts
    assert "by V in one" not in texts
    # a rate derivative of the other sign has no ratio
    rates = {"Cl/phat": -0.5, "Cn/rhat": 0.09, "Cm/qhat": -16.0}
    pairs = [wide_pair(name, ("A", "B"), FIRST[name][0], 2.0 * v) for name, v in rates.items()]
    assert not any(
        "by V in one" in fault.text and "Cn/rhat" in fault.names
        for fault in find_convention_faults(pairs, 1.5, 11.0)
    )
