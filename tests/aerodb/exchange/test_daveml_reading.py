"""DAVE-ML files: content, values, what is refused.

The sample files are third-party material: NASA's F-16 and check-case models, and the examples of
the DAVE-ML schema.
"""

from pathlib import Path

import numpy as np
import pytest

from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.document.tables import FunctionAxis, Gridded
from aerodb.exchange.daveml.document.units import code_of, same_units, unit_of_code
from flightmech.errors import (
    AeromatchWarning,
    OutOfRange,
    ParseError,
    SchemaError,
    UnitError,
    UnknownName,
)
from flightmech.names import VOCABULARY
from flightmech.units import parse_unit

FLIGHT = Path(__file__).parents[3] / ".." / "shared" / "data" / "flight"
EXAMPLES = FLIGHT / "aero_databases" / "daveml_examples"
NESC = FLIGHT / "nesc_checkcases" / "models"
samples = pytest.mark.skipif(not NESC.exists(), reason="needs the DAVE-ML samples of ../shared")

# shots and judged values (outputs and internal values) in each sample, counted in the files
SHOTS = {
    "alpha_beta_to_alphaT_phi": (17, 34), "basic_functions": (3, 33), "ceil_floor_min_max": (1, 8),
    "tables": (6, 12),
    "trig_functions": (3, 21), "twoD_ungridded": (4, 4), "F16_aero": (16, 944), "F16_prop": (9, 93),
}  # fmt: skip
FILES = sorted(EXAMPLES.glob("*.dml")) + sorted(NESC.glob("*.dml"))
NO_NUMBER = "orbital_sphere_inertia"  # initialValue="(2/5)π"

HEADER = (
    '<fileHeader name="test"><author name="A" org="B"/><creationDate '
    'date="2020-01-01"/></fileHeader>'
)


def document(tmp_path, body, head=HEADER, name="test.dml"):
    path = tmp_path / name
    path.write_text(
        f'<?xml version="1.0"?>\n<DAVEfunc '
        f'xmlns="http://daveml.org/2010/DAVEML">{head}{body}</DAVEfunc>',
        encoding="utf-8",
    )
    return path


def variable(name, inside="", **attributes):
    more = "".join(f' {key}="{text}"' for key, text in {"units": "nd", **attributes}.items())
    return f'<variableDef name="{name}" varID="{name}"{more}>{inside}</variableDef>'


def calculation(math):
    return f"<calculation><math>{math}</math></calculation>"


def calculated(tmp_path, math, inputs=("a", "b", "c"), **values):
    """Return what a calculation gives."""
    given = "".join(variable(name, "<isInput/>") for name in inputs)
    return read(
        document(tmp_path, given + variable("y", calculation(math) + "<isOutput/>"))
    ).evaluate({**dict.fromkeys(inputs, 0.0), **values})["y"]


def apply(operator, *arguments):
    return f"<apply><{operator}/>{''.join(arguments)}</apply>"


def ci(name):
    return f"<ci> {name} </ci>"


def cn(value):
    return f"<cn>{value}</cn>"


def function(tmp_path, attributes, element="independentVarRef"):
    """Return a model with the table of the reference manual's figures, y over x."""
    points, values, given = (
        "1, 3, 4, 6, 7.5",
        "2, 6, 5, 7, 1.5",
        variable("x", "<isInput/>") + variable("y"),
    )
    if element == "independentVarPts":
        return read(document(tmp_path, given + simple({"x": points}, values, attributes)))
    return read(
        document(
            tmp_path,
            f"{given}<breakpointDef "
            f'bpID="B"><bpVals>{points}</bpVals></breakpointDef><function '
            f'name="f"><independentVarRef varID="x" '
            f'{attributes}/><dependentVarRef varID="y"/><functionDefn><griddedTableDef '
            f'gtID="T"><breakpointRefs><bpRef bpID="B"/>'
            f"</breakpointRefs><dataTable>{values}</dataTable></griddedTableDef></functionDefn>"
            f"</function>",
        )
    )


def simple(points, values, attributes=""):
    """Return a function that carries its points itself."""
    axes = "".join(
        f'<independentVarPts varID="{name}" {attributes}>{text}</independentVarPts>'
        for name, text in points.items()
    )
    return (
        f'<function name="f">{axes}<dependentVarPts varID="y">{values}</dependentVarPts></function>'
    )


# ---- the samples


@pytest.mark.slow
@samples
@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_every_check_case_of_every_sample_passes(path):
    if path.stem == NO_NUMBER:
        with pytest.raises(ParseError, match=r"line 39: found '\(2/5\)π'; expected finite numbers"):
            read(path)
        return
    model = read(path)
    table = model.check()
    assert (len(model.shots), len(table)) == SHOTS.get(path.stem, (0, 0))
    assert table["passed"].all()


@samples
def test_mass_propulsion_and_control_models_evaluate():
    inertia = read(NESC / "F16_inertia.dml").evaluate({"CG_PCT_MAC": [25.0, 35.0]})
    assert inertia["DXCG"] == pytest.approx(
        [1.132, 0.0], abs=1e-12
    )  # (35 - 25) % of 11.32 ft, TM-2015-218675: c.g. at 25 %
    assert inertia["XMASS"].tolist() == [637.1595, 637.1595]
    thrust = read(NESC / "F16_prop.dml").evaluate({"PWR": [50.0, 100.0], "ALT": 0.0, "RMACH": 0.0})
    assert thrust["FEX"] == pytest.approx([12680.0, 20000.0])  # the nodes of T_MIL and T_MAX
    for name in ("F16_control", "F16_gnc"):
        model = read(NESC / f"{name}.dml")
        found = model.evaluate(dict.fromkeys(model.inputs, 0.1))
        assert all(np.isfinite(value).all() for value in found.values())
        assert set(found) >= {"el", "ail", "rdr"}


@samples
def test_the_header_of_the_f16_model_is_kept():
    model = read(NESC / "F16_aero.dml")
    assert model.header.version == "Mod P, 2013-10-21"
    assert [m.modID for m in model.header.modifications] == list("ABCDEFGHIJKLMNOP")
    assert model.header.references[1].accession == "NASA TM-2003-212145"
    assert model.functions["cxt"].provenance.references == ("REF01", "REF02", "REF03")
    assert model.variables["vt"].low == 0.1
    assert model.inputs == ("vt", "alpha", "beta", "p", "q", "r", "el", "ail", "rdr")


@samples
def test_uncertainties_and_old_forms_are_read():
    bounds = read(EXAMPLES / "uncertain_1D_table.dml").functions["Cm_u"].uncertainty
    assert (bounds.effect, bounds.sigmas) == ("multiplicative", 3.0)
    assert bounds.bounds[0] == pytest.approx([0.10, 0.08, 0.06, 0.05, 0.05, 0.06, 0.07, 0.12])
    uneven = read(EXAMPLES / "uncertain_variable_asym.dml").variables["Cm_u"].uncertainty
    assert (uneven.sigmas, [float(b[0]) for b in uneven.bounds]) == (0.0, [0.5, 0.0])
    old = read(EXAMPLES / "twoD_table.dml")
    assert "<griddedTable> is deprecated since DAVE-ML 2.0; read all the same" in old.notes
    assert old.evaluate({"MACH": 0.1, "ALPHA": 0.0})["CL"] == pytest.approx(
        0.25 * 0.61543 + 0.75 * 0.79194
    )  # limited to Mach 0.3


# ---- mathematics


@pytest.mark.parametrize(
    ("math", "expected"),
    [
        (apply("plus", ci("a"), ci("b"), cn(1)), 6.0),
        (apply("minus", ci("a")), -2.0),
        (apply("minus", ci("a"), ci("b")), -1.0),
        (apply("times", ci("a"), ci("b"), ci("b")), 18.0),
        (apply("divide", ci("a"), ci("b")), 2.0 / 3.0),
        (apply("power", ci("a"), ci("b")), 8.0),
        (apply("rem", cn(-7), ci("b")), -1.0),
        (apply("root", "<degree><cn>3</cn></degree>", cn(-8)), -2.0),
        (apply("root", ci("b")), np.sqrt(3.0)),
        (apply("exp", ci("a")), np.exp(2.0)),
        (apply("ln", ci("a")), np.log(2.0)),
        (apply("log", cn(1000)), 3.0),
        (apply("log", "<logbase><cn>2</cn></logbase>", cn(8)), 3.0),
        (apply("abs", cn(-3)), 3.0),
        (apply("floor", cn(-1.5)), -2.0),
        (apply("ceiling", cn(-1.5)), -1.0),
        (apply("min", ci("a"), ci("b"), ci("c")), 0.0),
        (apply("max", ci("a"), ci("b"), ci("c")), 3.0),
        (apply("sin", ci("a")), np.sin(2.0)),
        (apply("cos", ci("a")), np.cos(2.0)),
        (apply("tan", ci("a")), np.tan(2.0)),
        (apply("arcsin", cn(0.5)), np.arcsin(0.5)),
        (apply("arccos", cn(0.5)), np.arccos(0.5)),
        (apply("arctan", ci("a")), np.arctan(2.0)),
        (apply("sec", ci("a")), 1.0 / np.cos(2.0)),
        (apply("sinh", ci("a")), np.sinh(2.0)),
        (apply("arctanh", cn(0.5)), np.arctanh(0.5)),
        ("<apply><csymbol> atan2 </csymbol><cn>1</cn><cn>-1</cn></apply>", 0.75 * np.pi),
        (apply("lt", cn(1), ci("a"), ci("b")), 1.0),
        (apply("lt", cn(1), ci("b"), ci("a")), 0.0),
        (apply("geq", ci("a"), ci("a")), 1.0),
        (apply("neq", ci("a"), ci("a")), 0.0),
        (apply("and", "<true/>", apply("eq", ci("a"), cn(2))), 1.0),
        (apply("or", "<false/>", ci("c")), 0.0),
        (apply("xor", ci("a"), ci("b")), 0.0),
        (apply("not", ci("c")), 1.0),
        (apply("times", "<pi/>", "<exponentiale/>"), np.pi * np.e),
        ('<cn type="e-notation">1.5<sep/>3</cn>', 1500.0),
        ('<cn type="rational">3<sep/>4</cn>', 0.75),
        ("<cn>1.5D+01</cn>", 15.0),
    ],
)
def test_operators(tmp_path, math, expected):
    assert calculated(tmp_path, math, a=2.0, b=3.0, c=0.0) == pytest.approx(expected, rel=1e-14)


def test_pieces_are_tried_in_order_over_arrays_and_a_branch_that_does_not_count_may_divide_by_zero(
    tmp_path,
):
    pieces = (
        f"<piece>{cn(10)}{apply('gt', ci('a'), cn(2))}</piece>"
        f"<piece>{apply('divide', cn(1), ci('a'))}{apply('gt', ci('a'), cn(0))}</piece>"
        f"<otherwise>{cn(-1)}</otherwise>"
    )
    # with an apply around it, as NASA's files have it
    math = f"<apply><piecewise>{pieces}</piecewise></apply>"
    assert calculated(tmp_path, math, a=[3.0, 0.5, 0.0]) == pytest.approx([10.0, 2.0, -1.0])
    assert np.isnan(
        calculated(
            tmp_path, f"<piecewise><piece>{cn(1)}{apply('gt', ci('a'), cn(0))}</piece></piecewise>"
        )
    )


@pytest.mark.parametrize(
    ("math", "text"),
    [
        (apply("factorial", cn(3)), "the operator factorial; expected one of plus, minus"),
        (apply("divide", cn(3)), "divide with 1 arguments; expected 2"),
        ("<apply/>", "an empty <apply>"),
        (
            "<piecewise><otherwise><cn>1</cn></otherwise></piecewise>",
            "<piecewise> with something else",
        ),
        ("<cn base='2'>101</cn>", "a number to the base 2"),
        ("<cn>1_0</cn>", "'1_0'; expected finite numbers"),
        ("<cn>nan</cn>", "'nan'; expected finite numbers"),
        ("<cn>1 2</cn>", "'1 2'; expected one number"),
        (ci("nowhere"), "a reference to nowhere; expected varIDs"),
        ("<ci>a</ci><ci>b</ci>", "<math> with 2 elements; expected one expression"),
        ("<bvar/>", "<bvar>; expected apply, piecewise"),
    ],
)
def test_mathematics_that_is_not_understood_is_refused_with_its_line(tmp_path, math, text):
    with pytest.raises(ParseError, match=r"line 2: found ") as caught:
        calculated(tmp_path, math)
    assert text in str(caught.value)


# ---- tables


@pytest.mark.parametrize(
    ("attributes", "x", "expected"),
    [
        ("", [0.0, 2.0, 3.5, 9.0], [2.0, 4.0, 5.5, 1.5]),
        ('extrapolate="both"', [0.0, 9.0], [0.0, -4.0]),
        ('extrapolate="min"', [0.0, 9.0], [0.0, 1.5]),
        ('extrapolate="max"', [0.0, 9.0], [2.0, -4.0]),
        ('extrapolate="both" min="1" max="8"', [0.0, 9.0], [2.0, -0.333333333333333]),
        ('interpolate="discrete"', [0.0, 1.9, 2.0, 5.0, 9.0], [2.0, 2.0, 6.0, 7.0, 1.5]),
    ],
)
def test_look_up_of_the_manuals_table(tmp_path, attributes, x, expected):
    model = function(tmp_path, attributes)
    assert model.evaluate({"x": x})["y"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("rule", "expected"), [("floor", [2.0, 2.0, 6.0, 1.5]), ("ceiling", [2.0, 6.0, 6.0, 1.5])]
)
def test_floor_and_ceiling_are_meant_as_the_words_state(tmp_path, rule, expected):
    x = [0.0, 1.1, 3.0, 9.0]
    simple = function(tmp_path, f'interpolate="{rule}"', "independentVarPts")
    assert simple.evaluate({"x": x})["y"] == pytest.approx(expected)
    with pytest.warns(AeromatchWarning, match="the DTD states the opposite for independentVarRef"):
        model = function(tmp_path, f'interpolate="{rule}"')
    assert model.evaluate({"x": x})["y"] == pytest.approx(expected)
    assert any("the opposite" in note for note in model.notes)


def test_cubic_splines_are_natural_where_held_and_follow_the_end_slope_where_open():
    points, values = np.array([0.0, 1.0, 2.0, 4.0]), np.array([1.0, 3.0, 2.0, 0.0])
    held, both = FunctionAxis(points, "cubicSpline"), FunctionAxis(points, "cubicSpline", "both")
    table, step = Gridded(values), 1e-4
    x = np.array([0.0, 1.0, 2.0, 4.0])
    for axis in (held, both):
        assert table.look_up([axis], [x]) == pytest.approx(values, abs=1e-12)
    at = [np.array([0.0, step, 2.0 * step])]
    assert np.diff(table.look_up([held], at), 2)[0] / step**2 == pytest.approx(
        0.0, abs=1e-2
    )  # second derivative, f''' step
    assert table.look_up([both], [np.array([-1.0, 5.0])]) == pytest.approx([-1.0, -1.0])
    assert table.look_up([held], [np.array([-1.0, 5.0])]) == pytest.approx([1.0, 0.0])
    polynomial = Gridded(
        np.add.outer(x**2, x)
    )  # a spline along one axis, straight lines along the other
    assert polynomial.look_up(
        [held, FunctionAxis(points)], [np.array([1.0]), np.array([3.0])]
    ) == pytest.approx([4.0])


def test_tables_have_the_last_index_fastest_and_answer_broadcast_inputs(tmp_path):
    table = simple({"p": "0 1", "q": "0,1;2"}, "0 1 2 <!-- row --> 10, 11, 12")
    body = variable("p", "<isInput/>") + variable("q", "<isInput/>") + variable("y") + table
    found = read(document(tmp_path, body)).evaluate(
        {"p": np.array([[0.0], [1.0]]), "q": np.array([0.0, 1.0, 2.0])}
    )["y"]
    assert found.tolist() == [[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]]


def test_an_ungridded_table_is_held_at_its_box_and_refuses_holes(tmp_path):
    points = "".join(
        f"<dataPoint>{x} {y} {x + 2 * y}</dataPoint>"
        for x, y in [(0, 0), (1, 0), (0, 1), (0.4, 0.4)]
    )
    body = (
        f"{variable('p')}{variable('q')}{variable('y')}<ungriddedTableDef "
        f'utID="U">{points}</ungriddedTableDef><function name="f">'
        '<independentVarRef varID="p"/><independentVarRef varID="q"/><dependentVarRef '
        'varID="y"/><functionDefn>'
        '<ungriddedTableRef utID="U"/></functionDefn></function>'
    )
    model = read(document(tmp_path, body))
    assert model.evaluate({"p": [0.2, -1.0], "q": [0.3, 0.5]})["y"] == pytest.approx([0.8, 1.0])
    with pytest.raises(OutOfRange, match=r"\(1, 1\) lies between no points of an ungridded table"):
        model.evaluate({"p": 1.0, "q": 1.0})


# ---- variables


def test_limits_hold_for_inputs_and_results(tmp_path):
    result = variable("y", calculation(apply("times", ci("a"), cn(2))), maxValue="3")
    body = variable("a", "<isInput/>", minValue="-1", maxValue="2") + result
    assert read(document(tmp_path, body)).evaluate({"a": [-9.0, 1.0, 9.0]})["y"].tolist() == [
        -2.0,
        2.0,
        3.0,
    ]


def test_order_in_the_file_does_not_matter_and_constants_may_be_changed(tmp_path):
    twice = variable("y", calculation(apply("times", ci("x"), ci("k"))))
    body = (
        twice
        + variable("k", initialValue="2").replace('name="k"', 'name="factor"')
        + variable("x", "<isInput/>")
    )
    model = read(document(tmp_path, body))
    assert (model.inputs, model.outputs) == (("x",), ("y",))
    assert float(model.evaluate({"x": 3.0})["y"]) == 6.0
    assert float(model.evaluate({"x": 3.0, "factor": 5.0})["y"]) == 15.0
    with pytest.raises(UnknownName, match=r"unknown input 'x'.*needs x"):
        model.evaluate({})
    with pytest.raises(UnknownName, match="unknown variable 'z'"):
        model.evaluate({"x": 1.0, "z": 1.0})
    with pytest.raises(SchemaError, match="y is computed by the model; leave it out"):
        model.evaluate({"x": 1.0, "y": 1.0})


def shot(value, tolerance, units="nd"):
    signal = (
        f"<signalName>a</signalName><signalUnits>{units}</signalUnits><signalValue>3</signalValue>"
    )
    answer = f"<signalID>y</signalID><signalValue>{value}</signalValue><tol>{tolerance}</tol>"
    return (
        f"{variable('a', '<isInput/>')}{variable('y', calculation(apply('times', ci('a'), cn(2))))}<checkData><staticShot "
        f'name="one">'
        f"<checkInputs><signal>{signal}</signal></checkInputs><checkOutputs>"
        f"<signal>{answer}</signal></checkOutputs></staticShot></checkData>"
    )


def test_a_check_case_that_fails_stops_the_reading_unless_it_is_ignored(tmp_path):
    assert read(document(tmp_path, shot(6.05, 0.1))).check()["passed"].all()
    path = document(tmp_path, shot(6.2, 0.1))
    with pytest.raises(
        SchemaError,
        match=r"(?s)check cases of .*1 of 1 values.*one: y is 6, expected 6.2 within 0.1",
    ):
        read(path)
    table = read(path, checks="ignore").check()
    assert table.loc[0, ["found", "passed"]].tolist() == [6.0, False]
    with pytest.raises(SchemaError, match="given in ft, the variable is in nd"):
        read(document(tmp_path, shot(6.0, 0.1, "ft")))
    with pytest.raises(ValueError, match="allowed: raise, ignore"):
        read(path, checks="no")


def test_the_name_of_a_signal_counts_before_a_varid_that_is_the_same_word(tmp_path):
    both = variable("y", initialValue="8").replace(
        'varID="y"', 'varID="z"'
    )  # named y, next to the variable with the varID y
    body = shot(8.0, 0.1).replace(
        "<signalID>y</signalID>", "<signalName>y</signalName><signalUnits>nd</signalUnits>"
    )
    body = body.replace('name="y" varID="y"', 'name="doubled" varID="y"')
    assert read(document(tmp_path, both + body)).check()["variable"].tolist() == ["z"]


def two_angles(units, value):
    """A check case that gives an angle by name, of which the file has one in degrees and one in
    radians; y is their sum.
    """
    body = variable("angleOfAttack", "<isInput/>", units="deg").replace(
        'varID="angleOfAttack"', 'varID="ALD"'
    )
    body += variable("angleOfAttack", "<isInput/>", units="rad", initialValue="0.5").replace(
        'varID="angleOfAttack"', 'varID="ALR"'
    )
    body += variable(
        "y", calculation(apply("plus", ci("ALD"), apply("times", cn(1000), ci("ALR"))))
    )
    given = [("angleOfAttack", "deg", 3), ("angleOfAttack", units, value)]
    signals = "".join(
        f"<signal><signalName>{name}</signalName><signalUnits>{unit}</signalUnits>"
        f"<signalValue>{number}</signalValue></signal>"
        for name, unit, number in given
    )
    answer = (
        "<signal><signalName>y</signalName><signalUnits>nd</signalUnits>"
        "<signalValue>203</signalValue><tol>1e-9</tol></signal>"
    )
    shots = (
        f"<staticShot "
        f'name="one"><checkInputs>{signals}</checkInputs><checkOutputs>{answer}</checkOutputs>'
        f"</staticShot>"
    )
    return f"{body}<checkData>{shots}</checkData>"


def test_of_variables_with_one_name_a_signal_is_the_one_in_its_units(tmp_path):
    table = read(
        document(tmp_path, two_angles("rad", 0.2))
    ).check()  # by name alone the file was refused: two variables have it
    assert table["passed"].all()
    with pytest.raises(
        SchemaError,
        match="ALD in deg, ALR in rad have this name, the signal is in ft; give signalUnits of "
        "one of them",
    ):
        read(document(tmp_path, two_angles("ft", 0.2)))


def test_check_values_in_other_units_of_the_same_quantity_are_converted(tmp_path):
    speed = shot(6.0, 0.1, "km_h").replace(
        'units="nd"', 'units="m_s"'
    )  # a = 3 km/h, y = 2 a in m/s
    speed = speed.replace(
        "<signalID>y</signalID>", "<signalID>y</signalID><signalUnits>km_h</signalUnits>"
    )
    row = read(document(tmp_path, speed)).check().loc[0]
    assert row["passed"]
    assert row[["expected", "found", "tolerance"]].tolist() == pytest.approx(
        [6.0 / 3.6, 6.0 / 3.6, 0.1 / 3.6], rel=1e-14
    )
    with pytest.raises(SchemaError, match=r"y is 1\.66666667, expected 1\.38888889 within"):
        read(document(tmp_path, speed.replace("<signalValue>6.0", "<signalValue>5.0")))
    with pytest.raises(
        SchemaError,
        match="given in deg, the variable is in nd: no conversion between them; correct "
        "signalUnits",
    ):
        read(document(tmp_path, shot(6.0, 0.1, "deg")))  # an angle is not a plain number


def test_a_check_case_of_an_unknown_signal_is_a_failure(tmp_path):
    with pytest.raises(SchemaError, match="unknown variable 'nosuch'"):
        read(document(tmp_path, shot(6.0, 0.1).replace("<signalName>a<", "<signalName>nosuch<")))
    with pytest.raises(SchemaError, match="unknown variable 'nosuch'"):
        read(document(tmp_path, shot(6.0, 0.1).replace("<signalID>y<", "<signalID>nosuch<")))


# ---- units


def test_units_are_read_as_s119_encodes_them():
    assert [unit_of_code(code) for code in ("ft_s", "rad_s2", "slugft2", "ftlbf", "_deg", "nmi_h",
        "kg_m3", "d", "ND", "")] == [
        "ft/s", "rad/s2", "slug ft2", "ft lbf", "1/deg", "nmi/h", "kg/m3", "deg", "1", "1",
    ]  # fmt: skip
    assert same_units("d", "deg")
    assert same_units("nd", "ND")
    assert not same_units("ft", "m")
    with pytest.raises(UnitError, match="unknown unit code 'furlong'"):
        unit_of_code("furlong")


def test_every_unit_of_the_vocabulary_can_be_written_and_read():
    for row in VOCABULARY.values():
        assert parse_unit(unit_of_code(code_of(row.units))) == parse_unit(row.units), row.name


# ---- what is refused


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (
            '<variableDef name="x" varID="x" units="nd" initialValue="1,5 2"/>',
            "'1,5 2'; expected one number",
        ),
        ('<variableDef varID="x" units="nd"/>', "<variableDef> without the attribute name"),
        (
            '<variableDef name="x" varID="x" units="nd"/><variableDef name="y" varID="x" '
            'units="nd"/>',
            "a second varID 'x'",
        ),
        (
            '<variableDef name="x" varID="x" units="nd" minValue="2" maxValue="1"/>',
            "minValue 2 over maxValue 1",
        ),
        (
            "".join(variable(a, calculation(apply("plus", ci(b)))) for a, b in ("xy", "yz", "zx")),
            "variables computed from each other: ",
        ),
        (
            variable("x")
            + simple({"x": "0 1"}, "")
            .replace("<dependentVarPts", "<noPts")
            .replace("/dependentVarPts", "/noPts"),
            "<function> without <dependentVarPts>",
        ),
        (variable("x", "<isInput/>" + calculation(cn(1))), "the input x with a calculation"),
    ],
)
def test_files_that_break_the_rules_are_refused(tmp_path, body, text):
    with pytest.raises(ParseError) as caught:
        read(document(tmp_path, body))
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("points", "values", "attributes", "text"),
    [
        ("0 1 1", "0 1 2", "", "breakpoints that do not rise: 1, then 1"),
        ("0 1 2", "0 1", "", "2 values; expected 3, as the breakpoints have it"),
        ("", "", "", "no breakpoints"),
        ("0 1", "0 1", 'interpolate="quadraticSpline"', "quadratic splines are not unique"),
        (
            "0 1",
            "0 1",
            'extrapolate="none"',
            "extrapolate='none'; expected neither, min, max, both",
        ),
        ("0 1", "0 x", "", "'x'; expected finite numbers"),
        ("0 1", "0 inf", "", "'inf'; expected finite numbers"),
    ],
)
def test_tables_that_break_the_rules_are_refused(tmp_path, points, values, attributes, text):
    body = variable("x") + variable("y") + simple({"x": points}, values, attributes)
    with pytest.raises(ParseError) as caught:
        read(document(tmp_path, body))
    assert text in str(caught.value)


BOMB = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("content", "text"),
    [
        (
            f'<!DOCTYPE DAVEfunc [<!ENTITY l0 "lol">{BOMB}]><DAVEfunc>&l11;</DAVEfunc>',
            "a declaration of the entity 'l0'",
        ),
        (
            "<!DOCTYPE DAVEfunc [<!ENTITY x SYSTEM "
            '"file:///etc/hostname">]><DAVEfunc>&x;</DAVEfunc>',
            "a declaration of the entity 'x'",
        ),
        (
            '<!DOCTYPE DAVEfunc [<!ENTITY % x SYSTEM "http://127.0.0.1:9/x">%x;]><DAVEfunc/>',
            "a declaration of the entity 'x'",
        ),
        (
            '<!DOCTYPE DAVEfunc SYSTEM "http://127.0.0.1:9/x.dtd"><DAVEfunc>&alpha;</DAVEfunc>',
            "the entity 'alpha'; expected plain text",
        ),
        ("<a>" * 100_000, "elements nested more than 200 deep"),
        ("<DAVEfunc>" + "<a/>" * 200_000, "more than 200000 elements"),
        ("<DAVEfunc>" * 50, "broken XML"),
        ('<?xml version="1.0" encoding="klingon"?><DAVEfunc/>', "encoding"),
        ("", "broken XML (no element found)"),
        ("not xml", "broken XML"),
        ("<html/>", "<html> as root; expected <DAVEfunc>"),
        ("<DAVEfunc/>", "<DAVEfunc> without <fileHeader>"),
    ],
)
def test_hostile_and_damaged_files_end_in_an_error(tmp_path, content, text):
    path = tmp_path / "hostile.dml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(ParseError) as caught:
        read(path)
    assert text in str(caught.value)


def test_every_truncation_and_wrong_bytes_end_in_an_error(tmp_path):
    content = document(tmp_path, shot(6.0, 0.1)).read_bytes()
    path = tmp_path / "cut.dml"
    for end in range(0, len(content) - 1, 7):
        path.write_bytes(content[:end])
        with pytest.raises(ParseError):
            read(path)
    path.write_bytes(content.replace(b"one", b"\xff\xfe\xfd"))
    with pytest.raises(ParseError, match="broken XML"):
        read(path)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "nowhere.dml")


def test_other_encodings_are_read(tmp_path):
    text = (
        document(tmp_path, shot(6.0, 0.1))
        .read_text()
        .replace('<?xml version="1.0"?>', "")
        .replace('name="test"', 'name="Flügel"')
    )
    for name, declared in (("utf-16", "utf-16"), ("latin-1", "ISO-8859-1")):
        path = tmp_path / "other.dml"
        path.write_bytes(f'<?xml version="1.0" encoding="{declared}"?>{text}'.encode(name))
        assert read(path).header.name == "Flügel"
