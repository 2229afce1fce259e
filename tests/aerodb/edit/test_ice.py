"""Differences of terms by ice."""

import warnings

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from aerodb.edit.ice import add_ice
from aerodb.edit.ice_file import read_ice
from flightmech import terms
from flightmech.aircraft.controls import ICE
from flightmech.errors import AeromatchWarning, ParseError, SchemaError, UnknownName
from flightmech.units import DEGREE

ALPHA = np.array([-4.0, 0.0, 4.0, 8.0, 12.0]) * DEGREE
# seen in text: NASA, Icing effects on aircraft stability and control determined from flight data,
# 1993, abstract (tail ice: elevator -12 %, rudder -8 %), and the lift increments of the UIUC model
# of the DHC-6 at 0, 4, 8 and 12 deg; the standard errors are ours
HEAD = 'title = "tail ice"\nreference = "NASA, 1993"\nvalid = "flap 0"\n'
ELEVATOR = '[terms."Cm/elevator"]\nfactor = 0.88\nfactor_stderr = 0.05\n'
LIFT = """[terms."CL/basic"]
axes = { alpha = ["0 deg", "4 deg", "8 deg", "12 deg"] }
offset = [-0.0884, -0.1017, -0.1131, -0.1385]
offset_stderr = 0.03
"""


@pytest.fixture
def clean():
    """A database with a square term, which has no room for a further regressor."""
    leaves = {
        "CL/basic": terms.make_term(0.3 + 5.0 * ALPHA, {"alpha": ALPHA}, stderr=0.05),
        "CD/basic": terms.make_term(0.03 + ALPHA**2, {"alpha": ALPHA}, stderr=0.003),
        "Cm/basic": terms.make_term(0.05 - 0.9 * ALPHA, {"alpha": ALPHA}, stderr=0.02),
        "Cm/elevator": terms.make_term(-1.2, {}, ("delta_e",), stderr=0.12),
        "Cm/twice": terms.make_term(-0.5, {}, ("delta_e", "alpha"), stderr=0.1),
    }
    return aerodb.make_database(
        leaves,
        title="box",
        aircraft="box",
        S=16.0,
        cbar=1.5,
        b=11.0,
        x_ref=0.0,
        y_ref=0.0,
        z_ref=0.0,
        force_axes="stability",
    )


@pytest.fixture
def ice(tmp_path):
    """Return the differences in a text."""

    def write(text, name="ice.toml"):
        file = tmp_path / name
        file.write_text(text)
        return read_ice(file)

    return write


def at(setting, **more):
    return {"alpha": 6.0 * DEGREE, "delta_e": 0.1, ICE: setting, **more}


def test_the_setting_applies_the_difference(clean, ice):
    iced = add_ice(clean, ice(HEAD + ELEVATOR + LIFT))
    names = ("CL", "Cm")
    without = [aerodb.evaluate(clean, name, **at(0.0)) for name in names]
    # setting 0 is the clean database, to the last bit
    assert [aerodb.evaluate(iced, name, **at(0.0)) for name in names] == without
    lift, moment = (aerodb.evaluate(iced, name, **at(1.0)) for name in names)
    assert lift - without[0] == pytest.approx(-0.1074, abs=1e-12)
    assert moment - without[1] == pytest.approx(-0.12 * -1.2 * 0.1, rel=1e-12)
    half = aerodb.evaluate(iced, "Cm", **at(0.5))
    assert half - without[1] == pytest.approx(0.5 * (moment - without[1]), rel=1e-12)


def test_the_clean_terms_and_the_clean_file_stay(clean, ice, tmp_path):
    aerodb.save(clean, tmp_path / "clean.nc")
    before = (tmp_path / "clean.nc").read_bytes()
    iced = add_ice(aerodb.open(tmp_path / "clean.nc"), ice(HEAD + ELEVATOR), note="before winter")
    aerodb.save(iced, tmp_path / "iced.nc")
    assert (tmp_path / "clean.nc").read_bytes() == before
    for name, leaf in aerodb.terms(clean).items():
        xr.testing.assert_identical(aerodb.terms(iced)[name], leaf)
    assert "valid for flap 0" in iced.attrs["notices"]
    assert aerodb.store.history(iced).iloc[-1].verb == "ice"
    undone = aerodb.store.previous(iced)
    assert list(aerodb.terms(undone)) == list(aerodb.terms(clean))
    assert "notices" not in undone.attrs


def test_standard_errors_are_those_of_factor_and_table(clean, ice):
    leaf = aerodb.terms(add_ice(clean, ice(HEAD + ELEVATOR)))["Cm/elevator_ice"]
    assert leaf["value"] == pytest.approx(0.144)
    assert leaf["stderr"] == pytest.approx(np.hypot(0.05 * 1.2, 0.12 * 0.12))
    assert leaf.attrs["origin"] == "tail ice"


def test_a_factor_on_the_slope_leaves_the_value_at_its_angle(clean, ice):
    text = '[terms."Cm/basic"]\nfactor = 0.9\nfactor_stderr = 0.05\nabout = "0 deg"\n'
    leaf = aerodb.terms(add_ice(clean, ice(HEAD + text)))["Cm/basic_ice"]
    assert leaf["value"].values == pytest.approx(0.09 * ALPHA, abs=1e-15)
    wrong = text.replace("Cm/basic", "Cm/elevator")
    with pytest.raises(SchemaError, match="about needs a table over alpha"):
        add_ice(clean, ice(HEAD + wrong))


IMPROVED = [
    ("CD/basic", "offset = -0.02\noffset_stderr = 0.005", "ice lowers the drag, by up to 0.02"),
    ("CL/basic", "factor = 1.2\nfactor_stderr = 0.05", "raises the largest lift coefficient by"),
    ("Cm/elevator", "factor = 1.12\nfactor_stderr = 0.05", "control power is 12 % larger"),
    ("Cm/qhat", "factor = 1.1\nfactor_stderr = 0.05", "damping is 10 % larger"),
]


@pytest.mark.parametrize(("name", "text", "words"), IMPROVED)
def test_ice_that_improves_the_aeroplane_is_warned_of(clean, ice, name, text, words):
    db = aerodb.replace_terms(clean, {"Cm/qhat": terms.make_term(-12.0, {}, ("qhat",), stderr=2.0)})
    with pytest.warns(AeromatchWarning, match=words):
        add_ice(db, ice(f'{HEAD}[terms."{name}"]\n{text}\n'))


def test_ice_that_delays_the_stall_is_warned_of(clean, ice):
    curve = np.array([-0.3, 0.2, 0.7, 0.9, 0.6])
    db = aerodb.replace_terms(
        clean, {"CL/basic": terms.make_term(curve, {"alpha": ALPHA}, stderr=0.02)}
    )
    text = '[terms."CL/basic"]\naxes = { alpha = ["-4 deg", "8 deg", "12 deg"] }\n'
    text += "offset = [0.0, -0.4, 0.0]\noffset_stderr = 0.02\n"
    with pytest.warns(AeromatchWarning, match="largest lift from alpha 8 to 12 deg"):
        add_ice(db, ice(HEAD + text))


def test_ice_that_makes_the_aeroplane_worse_has_no_warning(clean, ice):
    drag = '[terms."CD/basic"]\nfactor = 1.5\nfactor_stderr = 0.1\n'
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        add_ice(clean, ice(HEAD + ELEVATOR + LIFT + drag))


def test_factors_in_per_cent(ice):
    text = ELEVATOR.replace("0.88", "88").replace("0.05", "5")
    with pytest.raises(SchemaError) as caught:
        ice(HEAD + text)
    factor, stderr = caught.value.problems
    assert "write 0.88 for 88 %" in factor
    assert "write 0.05 for 5 %" in stderr


def test_an_offset_must_not_act_without_the_cause_of_the_term(clean, ice):
    delta = np.array([-10.0, 0.0, 10.0]) * DEGREE
    curve = terms.make_term(-0.1 * delta, {"delta_a": delta}, stderr=0.01 * abs(delta))
    db = aerodb.replace_terms(clean, {"Cn/aileron": curve})
    text = '[terms."Cn/aileron"]\noffset = 0.001\noffset_stderr = 0.001\n'
    with pytest.raises(SchemaError, match="acts at delta_a 0 deg, where the term is zero by"):
        add_ice(db, ice(HEAD + text))
    axes = 'axes = { delta_a = ["-10 deg", "0 deg", "10 deg"] }\n'
    text = text.replace("= 0.001", "= [0.001, 0.0, -0.001]", 1).replace(
        "err = 0.001", "err = [0.001, 0.0, 0.001]"
    )
    iced = add_ice(db, ice(HEAD + text + axes))
    assert aerodb.terms(iced)["Cn/aileron_ice"]["value"].values.tolist() == [0.001, 0.0, -0.001]


def test_a_term_with_two_regressors_has_the_setting_as_a_factor(clean, ice):
    text = '[terms."Cm/twice"]\nfactor = 0.8\nfactor_stderr = 0.1\n'
    iced = add_ice(clean, ice(HEAD + text))
    added = aerodb.evaluate(iced, "Cm", **at(1.0)) - aerodb.evaluate(iced, "Cm", **at(0.0))
    assert added == pytest.approx(-0.2 * -0.5 * 0.1 * 6.0 * DEGREE, rel=1e-12)


def test_a_csv_file_is_the_same(clean, ice):
    rows = [
        "# title: tail ice",
        "# reference: NASA, 1993",
        "# valid: flap 0",
        "term,factor,factor_stderr,offset,offset_stderr,alpha [deg]",
        "Cm/elevator,0.88,0.05,,,",
        "CL/basic,,,-0.0884,0.03,0",
        "CL/basic,,,-0.1017,0.03,4",
    ]
    lift = LIFT.replace(', "8 deg", "12 deg"', "").replace(", -0.1131, -0.1385", "")
    first = add_ice(clean, ice("\n".join(rows), "ice.csv"))
    second = add_ice(clean, ice(HEAD + ELEVATOR + lift))
    for name, leaf in aerodb.terms(second).items():
        xr.testing.assert_identical(aerodb.terms(first)[name], leaf)
    rows[4] = "Cm/elevator,-12 %,0.05,,,"
    with pytest.raises(ParseError, match=r"ice.csv.*line 5.*factor '-12 %'"):
        ice("\n".join(rows), "ice.csv")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("factor_stderr = 0.05\n", "", "factor and factor_stderr go together"),
        ("factor = 0.88\nfactor_stderr = 0.05\n", "", "neither factor nor offset"),
        ("factor = 0.88", 'factor = 0.88\naxes = { alpha = ["0 deg"] }', "axes go with an offset"),
        ("factor_stderr = 0.05", "factor_stderr = -0.05", "greater than or equal to 0"),
        ('valid = "flap 0"\n', "", "valid"),
    ],
)
def test_a_faulty_file_is_refused(ice, old, new, message):
    text = HEAD + ELEVATOR
    assert old in text
    with pytest.raises(SchemaError, match=message):
        ice(text.replace(old, new))


def test_ice_upon_ice_and_unknown_terms_are_refused(clean, ice):
    iced = add_ice(clean, ice(HEAD + ELEVATOR))
    with pytest.raises(SchemaError, match="has ice already"):
        add_ice(iced, ice(HEAD + LIFT))
    with pytest.raises(UnknownName, match="Cm/elevator"):
        add_ice(clean, ice(HEAD + ELEVATOR.replace("Cm/elevator", "Cm/elevatr")))


def test_the_model_has_the_setting_as_an_input_and_a_scale_of_each_difference(clean, ice):
    craft = flightmech.Aircraft(
        "box", S=16.0, cbar=1.5, b=11.0, mass=900.0, Ixx=2e3, Iyy=2.5e3, Izz=4e3
    )
    iced = flightmech.compile(craft, add_ice(clean, ice(HEAD + ELEVATOR)))
    assert ICE in iced.inputs
    assert "term.Cm.elevator_ice" in iced.parameters
    # the clean database has no such input
    assert ICE not in flightmech.compile(craft, clean).inputs


ROWS = "# title: tail ice\n# reference: NASA, 1993\n# valid: flap 0\n"


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ("term,offset,offset_stderr,alpha\nCL/basic,-0.1,0.02,0\nCL/basic,-0.1,0.02,4\n", "a unit"),
        ("term,factor,factor_stderr\nCm/elevator,0,88,0,05\n", "5 cells; expected 3 cells"),
        ("term,factor,factor_stderr\nCL/basic,0.9,0.05\nCL/basic,0.5,0.05\n", "in the row before"),
    ],
)
def test_a_csv_file_that_could_be_misread_is_refused(ice, rows, text):
    with pytest.raises(ParseError, match=text):
        ice(ROWS + rows, "ice.csv")


def test_numbers_in_other_units_are_refused(clean, ice):
    # percent, and a change in place of a factor
    for factor in ("88", "-0.12"):
        with pytest.raises(SchemaError, match="factor"):
            ice(HEAD + ELEVATOR.replace("0.88", factor))
    degrees = (
        LIFT.replace(' deg"', "").replace('"', "").replace("[terms.CL/basic]", '[terms."CL/basic"]')
    )
    with pytest.raises(SchemaError, match=r"alpha reaches 687\.5 deg"):
        add_ice(clean, ice(HEAD + degrees))
    text = '[terms."Cm/basic"]\nfactor = 0.9\nfactor_stderr = 0.05\nabout = "40 deg"\n'
    with pytest.raises(SchemaError, match="about lies beyond the alpha of the table"):
        add_ice(clean, ice(HEAD + text))


@pytest.mark.parametrize(
    ("factor", "text"), [(1.0, ""), (0.9, "factor = 0.9\nfactor_stderr = 0\n")]
)
def test_an_offset_holds_its_end_values(clean, ice, factor, text):
    """Within the clean table and beyond, also where the clean table goes on with its slope."""
    leaf = terms.make_term(0.3 + 5.0 * ALPHA, {"alpha": ALPHA}, stderr=0.05, outside="linear")
    tree = aerodb.replace_terms(clean, {"CL/basic": leaf})
    iced = add_ice(tree, ice(HEAD + LIFT + text))
    alpha = np.append(ALPHA, [-0.2, 0.4])
    state = {"alpha": alpha, ICE: 1.0}
    found = terms.evaluate_term(aerodb.terms(iced)["CL/basic_ice"], state, "clamp")
    offset = np.interp(alpha, ALPHA[1:], [-0.0884, -0.1017, -0.1131, -0.1385])
    expected = (factor - 1.0) * (0.3 + 5.0 * alpha) + offset
    np.testing.assert_allclose(found, expected, atol=1e-12)
