"""DAVE-ML models multiplied out into terms: equal to rounding, or refused."""

import numpy as np
import pytest
import xarray as xr
from daveml_files import (
    ALPHAS,
    CBAR,
    MACHS,
    ROUNDING,
    RUDDERS,
    B,
    S,
    apply,
    ci,
    cn,
    difference,
    document,
    in_file,
    made,
    one,
    states,
    table,
    values,
    variable,
)

import aerodb
import flightmech
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.vocabulary import has_opposite_sign
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.simulation.kernel import INPUT
from flightmech.units import DEGREE, FOOT

# ---- what is taken over exactly


@pytest.mark.slow
def test_a_model_like_the_hl20(tmp_path):
    """Cubic polynomials in alpha over tables of Mach, |rudder| with the sign of the rudder, rates,
    a transfer to the c.g.
    """
    cubic = ci("CZ3")
    for name in ("CZ2", "CZ1", "CZ0"):
        cubic = apply("plus", ci(name), apply("times", ci("AL"), cubic))
    turn = (
        f"<piece>{apply('minus', ci('CNR'))}{apply('lt', ci('RUD'), cn(0.0))}</piece>"
        f"<otherwise>{ci('CNR')}</otherwise>"
    )
    variables = (
        "".join(
            variable(name) for name in ("CZ0", "CZ1", "CZ2", "CZ3", "CNR", "CLP", "CMAD", "CM0")
        )
        + variable("abs_rud", made(apply("abs", ci("RUD")), ""), units="deg")
        + variable("aeroBodyForceCoefficient_Z", made(cubic), "CZ", sign="DOWN")
        + variable("aeroBodyMomentCoefficient_Yaw", made(f"<piecewise>{turn}</piecewise>"), "CN")
        + variable(
            "half_angle",
            made(
                apply(
                    "divide",
                    apply("times", ci("PB"), ci("BSPAN")),
                    apply("times", cn(2.0), ci("VT")),
                ),
                "",
            ),
        )
        + variable("to_si", made(apply("divide", ci("half_angle"), cn(FOOT * 180.0 / np.pi)), ""))
        + variable(
            "aeroBodyMomentCoefficient_Roll", made(apply("times", ci("to_si"), ci("CLP"))), "CLL"
        )
        + variable("arm", made(apply("minus", cn(0.35), ci("XCG")), ""))
        + variable(
            "aeroBodyMomentCoefficient_Pitch",
            made(
                apply(
                    "plus",
                    ci("CM0"),
                    apply("times", ci("CZ"), ci("arm")),
                    apply(
                        "divide",
                        apply("times", ci("CMAD"), ci("ALDOT"), ci("CBAR")),
                        apply("times", cn(2.0 * FOOT), ci("VT")),
                    ),
                )
            ),
            "CM",
        )
    )
    functions = (
        "".join(
            table(f"CZ{i}", (np.array(values(3)) * 0.03**i).tolist(), XMACH=MACHS) for i in range(4)
        )
        + table("CNR", [0.0, 0.0, 0.0, *values(6)], abs_rud=RUDDERS, XMACH=MACHS)
        + table("CLP", values(4), AL=ALPHAS)
        + table("CMAD", values(3), XMACH=MACHS)
        + table("CM0", values(12), AL=ALPHAS, XMACH=MACHS)
    )
    path = document(tmp_path, (variables, functions))
    outputs = {"CZ": "CZ", "Cn": "CN", "Cl": "CLL"}
    for coefficient, output in outputs.items():
        db, gap = difference(path, coefficient, output)
        assert gap < ROUNDING
    with pytest.raises(AssertionError):
        assert difference(path, "CZ", "CN")[1] < ROUNDING  # the comparison can fail
    db, gap = difference(path, "Cm", "CM")
    assert gap < ROUNDING
    terms = aerodb.terms(db)
    assert terms["CZ/alpha_alpha"].attrs["regressors"] == "alpha alpha"
    assert {"Cm/basic", "Cm/alphadothat", "Cm/x_cg", "Cl/phat", "Cn/rudder_CNR"} >= {
        "Cm/basic",
        "Cm/alphadothat",
        "Cl/phat",
    }
    assert (
        "K1" in terms["CZ/alpha_alpha_CZ3"]
    )  # the third power of alpha is a table that gives alpha
    assert dict(terms["Cl/phat"].sizes) == {"alpha": 4}
    assert terms["Cl/phat"]["value"].values == pytest.approx(np.array(values(4)), rel=1e-15)


@pytest.mark.parametrize(
    "ends", ["", 'extrapolate="both"', 'extrapolate="min"', 'extrapolate="max"']
)
def test_ends_of_tables_hold_or_go_on_as_the_file_states(tmp_path, ends):
    path = one(
        tmp_path, ci("T"), variable("T"), table("T", values(12), AL=(ALPHAS, ends), XMACH=MACHS)
    )
    db, gap = difference(path)
    assert gap < ROUNDING
    leaf = aerodb.terms(db)["CL/basic"]
    assert leaf.attrs["outside"] == ("hold" if not ends else "linear")
    assert leaf.sizes["alpha"] == {"": 4, 'extrapolate="both"': 4}.get(
        ends, 5
    )  # a flat piece behind the end that is held


@pytest.mark.nightly
@pytest.mark.parametrize(
    "argument",
    [
        apply("abs", ci("AL")),
        apply("plus", ci("AL"), cn(2.0)),
        apply("minus", cn(3.0), ci("AL")),
        apply("max", ci("AL"), cn(-5.0)),
        apply("min", ci("AL"), cn(5.0), apply("times", cn(2.0), ci("AL"))),
        apply("abs", apply("plus", apply("abs", ci("AL")), cn(-7.0))),
        apply("divide", apply("times", ci("AL"), cn(4.0)), cn(3.0)),
        cn(4.0),
        f"<piecewise><piece>{cn(0.0)}{apply('leq', ci('AL'), cn(0.0))}</piece>"
        f"<otherwise>{ci('AL')}</otherwise></piecewise>",
        f"<piecewise><piece>{cn(8.0)}{apply('gt', cn(0.0), cn(1.0))}</piece>"
        f"<otherwise>{ci('AL')}</otherwise></piecewise>",
    ],
)
@pytest.mark.parametrize("ends", ["", 'extrapolate="both"', 'extrapolate="min"'])
def test_look_ups_over_piecewise_functions_of_a_variable(tmp_path, argument, ends):
    variables = variable("T") + variable("argument", made(argument, ""), "ARG", units="deg")
    assert (
        difference(
            one(
                tmp_path,
                ci("T"),
                variables,
                table("T", values(12), ARG=(ALPHAS, ends), XMACH=MACHS),
            )
        )[1]
        < ROUNDING
    )


def test_limits_of_variables_and_products_of_tables(tmp_path):
    limited = variable(
        "limited",
        made(apply("times", cn(2.0), ci("AL")), ""),
        "LIM",
        units="deg",
        minValue="-8",
        maxValue="11",
    )
    variables = limited + "".join(variable(name) for name in ("A", "M", "R"))
    math = apply(
        "times",
        ci("A"),
        ci("M"),
        ci("R"),
        ci("EL"),
        apply("plus", cn(1.0), apply("power", ci("XCG"), cn(2.0))),
    )
    functions = (
        table("A", values(4), LIM=ALPHAS)
        + table("M", values(3), XMACH=(MACHS, 'extrapolate="max"'))
        + table("R", values(3), RUD=RUDDERS)
    )
    path = one(tmp_path, math, variables, functions)
    db, gap = difference(path)
    assert gap < ROUNDING
    assert {"K1", "K2"} <= set(aerodb.terms(db)["CL/elevator"])


def test_signs_of_the_file_are_turned_into_the_canonical_ones(tmp_path):
    db, gap = difference(
        one(tmp_path, apply("times", cn(0.5), ci("EL")))
    )  # EL is positive trailing edge up
    assert gap < ROUNDING
    assert float(aerodb.terms(db)["CL/elevator"]["value"]) == pytest.approx(-0.5 / DEGREE)
    assert has_opposite_sign("+TEU", "TED")
    assert has_opposite_sign("right wing down", "right TED, left roll")
    assert not has_opposite_sign("left roll", "right TED, left roll")
    assert not has_opposite_sign("", "TED")


def body_flap(tmp_path):
    """A pitching moment with an upper and a lower body flap, angles that the vocabulary does not
    have, and a door.
    """
    variables = variable(
        "upperBodyFlap", "<isInput/>", "DBFU", units="deg", minValue="-30", maxValue="0"
    )
    variables += variable("lowerBodyFlap", "<isInput/>", "DBFL", units="deg") + variable(
        "bayDoor", "<isInput/>", "DOOR"
    )
    variables += variable("T")
    math = apply(
        "plus",
        ci("T"),
        apply("times", cn(0.002), ci("DBFL"), ci("AL")),
        apply("times", cn(-0.01), ci("DOOR")),
    )
    return one(
        tmp_path,
        math,
        variables,
        table("T", values(9), DBFU=[-30.0, -10.0, 0.0], XMACH=MACHS),
        "pitchingMomentCoefficient",
    )


def test_inputs_that_the_vocabulary_does_not_have_are_named_inputs_of_the_model(tmp_path):
    path, upper, lower = body_flap(tmp_path), "device.DBFU.deflection", "device.DBFL.deflection"
    with pytest.warns(
        AeromatchWarning, match=f"DBFU is {upper}, DBFL is {lower}, DOOR is device.DOOR.setting"
    ):
        db = aerodb.exchange.import_daveml(path)
    assert "DBFU is device.DBFU.deflection" in db.attrs["comment"]
    assert {"Cm/alpha_DBFL", "Cm/DOOR"} <= set(aerodb.terms(db))
    state = states() | {
        upper: np.radians(np.linspace(-50, 20, 2000)),
        lower: np.radians(np.linspace(40, -40, 2000)),
    }
    state |= {"device.DOOR.setting": np.linspace(0, 1, 2000)}
    given = in_file(state) | {
        "DBFU": state[upper] / DEGREE,
        "DBFL": state[lower] / DEGREE,
        "DOOR": state["device.DOOR.setting"],
    }
    expected = read(path).evaluate(given)["OUT"]
    assert (
        np.abs(aerodb.evaluate(db, "Cm", outside="clamp", **state) - expected).max() < ROUNDING * 10
    )  # Cm up to 5
    craft = flightmech.Aircraft("body", S, CBAR, B, 1e3, 1e3, 1e3, 2e3, limits={upper: (-0.5, 0.0)})
    sim = flightmech.compile(craft, db)
    assert sim.inputs[-3:] == (lower, upper, "device.DOOR.setting")
    assert [(row.low, row.units) for row in sim.entries(INPUT) if row.name == upper] == [
        (-0.5, "rad")
    ]
    run = flightmech.simulate(
        sim,
        xr.Dataset({upper: -0.2, lower: 0.1, "device.DOOR.setting": 0.5}, {"time": [0.0]}),
        {"init.alpha": 0.1},
    )
    at = {
        "alpha": 0.1,
        "mach": float(run.mach[0]),
        upper: -0.2,
        lower: 0.1,
        "device.DOOR.setting": 0.5,
    }
    assert float(run.Cm[0]) == pytest.approx(
        float(aerodb.evaluate(db, "Cm", outside="clamp", **at)), rel=1e-12
    )


def test_a_name_goes_before_that_of_the_file_and_other_units_are_no_device(tmp_path):
    path = body_flap(tmp_path)
    named = {"DBFU": "delta_f", "DBFL": "device.lower_flap.deflection", "DOOR": "speedbrake"}
    db = aerodb.exchange.import_daveml(path, names=named)  # and no warning
    assert {"Cm/alpha_lower_flap", "Cm/speedbrake"} <= set(aerodb.terms(db))
    path.write_text(path.read_text().replace('varID="DBFL" units="deg"', 'varID="DBFL" units="ft"'))
    with pytest.raises(
        SchemaError,
        match="it uses DBFL: it is an input in ft that no quantity of the vocabulary belongs to",
    ):
        aerodb.exchange.import_daveml(path)


def test_uncertain_constants_and_their_products_have_standard_errors(tmp_path):
    spread = (
        '<uncertainty effect="percentage"><normalPDF '
        'numSigmas="2"><bounds>20</bounds></normalPDF></uncertainty>'
    )
    even = (
        '<uncertainty effect="additive"><uniformPDF><bounds>0.3</bounds></uniformPDF></uncertainty>'
    )
    variables = variable("k", spread, initialValue="0.5") + variable("l", even, initialValue="2")
    leaf = aerodb.terms(
        aerodb.exchange.import_daveml(
            one(tmp_path, apply("times", ci("k"), ci("l"), ci("XMACH")), variables)
        )
    )["CL/mach"]
    assert float(leaf["value"]) == 1.0
    assert float(leaf["stderr"]) == pytest.approx(np.hypot(2.0 * 0.05, 0.5 * 0.3 / np.sqrt(3.0)))


def test_wind_axes_and_both_axes(tmp_path):
    wind = (
        one(tmp_path, cn(0.4))
        .read_text()
        .replace('varID="OUT"', 'varID="OUT" axisSystem="wind axes"')
    )
    (tmp_path / "wind.dml").write_text(wind)
    assert aerodb.exchange.import_daveml(tmp_path / "wind.dml").attrs["force_axes"] == "wind"
    both = one(tmp_path, cn(0.4), variable("aeroBodyForceCoefficient_X", made(cn(0.1)), "CX"))
    with pytest.raises(SchemaError, match="gives both CX and CL; choose with force_axes="):
        aerodb.exchange.import_daveml(both)
    assert set(aerodb.terms(aerodb.exchange.import_daveml(both, force_axes="body"))) == {"CX/basic"}
    with pytest.raises(ValueError, match="allowed: stability, wind, body"):
        aerodb.exchange.import_daveml(both, force_axes="earth")


# ---- what is refused


ALL = "".join(variable(name) for name in ("T", "U"))


@pytest.mark.parametrize(
    ("math", "functions", "reason"),
    [
        (apply("sin", ci("AL")), "", "sin of alpha is not a sum of products"),
        (apply("divide", ci("AL"), ci("VT")), "", "it divides by V"),
        (apply("divide", cn(1.0), apply("plus", ci("XMACH"), cn(1.0))), "", "division by a sum"),
        (
            apply("divide", cn(1.0), ci("T")),
            table("T", values(4), AL=ALPHAS),
            "division by the table T",
        ),
        (
            apply("times", ci("T"), ci("U")),
            table("T", values(4), AL=ALPHAS) + table("U", values(4), AL=ALPHAS),
            "two tables of alpha, T and U",
        ),
        (
            apply("power", ci("AL"), cn(4.0)),
            "",
            "a product of alpha alpha alpha; a term has at most 2",
        ),
        (apply("power", ci("AL"), cn(0.5)), "", "the power 0.5 of alpha"),
        (apply("power", ci("AL"), cn(99.0)), "", "the power 99 of alpha"),
        (apply("abs", apply("plus", ci("AL"), ci("BE"))), "", "it depends on alpha, beta together"),
        (
            apply("abs", apply("times", ci("AL"), ci("AL"))),
            "",
            "it is not a piecewise-linear function of alpha",
        ),
        (
            ci("T"),
            table("T", values(4), AL=(ALPHAS, 'interpolate="cubicSpline"')),
            "not linear in AL but cubicSpline",
        ),
        (
            ci("T"),
            table("T", values(16), AL=ALPHAS, LIM=ALPHAS),
            "two of its inputs depend on alpha",
        ),
        (
            ci("T"),
            table("T", values(4), TOT=ALPHAS),
            "its input TOT cannot be an axis: it depends on alpha, beta together",
        ),
        (
            f"<piecewise><piece>{cn(1.0)}{apply('lt', ci('BE'), cn(0.0))}</piece>"
            f"<otherwise>{cn(2.0)}</otherwise></piecewise>",
            "",
            "it jumps where beta passes 0",
        ),
        (
            f"<piecewise><piece>{cn(1.0)}{apply('lt', ci('BE'), cn(0.0))}</piece></piecewise>",
            "",
            "a piecewise without otherwise",
        ),
        (
            f"<piecewise><piece>{ci('AL')}{apply('lt', ci('BE'), ci('AL'))}</piece>"
            f"<otherwise>{ci('BE')}</otherwise></piecewise>",
            "",
            "it depends on alpha, beta together",
        ),
    ],
)
def test_what_is_no_sum_of_products_is_refused_with_the_variable_and_the_reason(
    tmp_path, math, functions, reason
):
    more = variable("limited", made(ci("AL"), ""), "LIM", units="deg")
    more += variable("total", made(apply("plus", ci("AL"), ci("BE")), ""), "TOT", units="deg")
    with pytest.raises(SchemaError, match=r"not an exact sum of terms") as caught:
        aerodb.exchange.import_daveml(one(tmp_path, math, ALL + more, functions))
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith("CL: OUT (liftCoefficient): ")
    assert reason in caught.value.problems[0]


def test_a_sum_that_grows_without_end_is_refused_soon(tmp_path):
    chain = variable(
        "x0",
        made(apply("plus", *(ci(name) for name in ("AL", "BE", "XMACH", "RUD", "EL", "XCG"))), ""),
    )
    chain += "".join(
        variable(f"x{i}", made(apply("times", ci(f"x{i - 1}"), ci(f"x{i - 1}")), ""))
        for i in range(1, 40)
    )
    with pytest.raises(SchemaError, match=r"it uses x39: it uses x38: .*more than 1000 products"):
        aerodb.exchange.import_daveml(one(tmp_path, ci("x39"), chain))


def test_names_units_and_reference_quantities_are_checked(tmp_path):
    path = one(tmp_path, apply("times", ci("AL"), cn(0.1)))
    with pytest.raises(UnknownName, match="unknown variable 'ALPHA'"):
        aerodb.exchange.import_daveml(path, names={"ALPHA": "alpha"})
    with pytest.raises(UnknownName, match="unknown quantity 'alfa'; near it: alpha"):
        aerodb.exchange.import_daveml(path, names={"AL": "alfa"})
    with pytest.raises(SchemaError, match="S is 20 in the file and 21 in the call"):
        aerodb.exchange.import_daveml(path, S=21.0)
    with pytest.raises(UnknownName, match="unknown coefficient 'drag'"):
        aerodb.exchange.import_daveml(path, without=("drag",))
    path.write_text(path.read_text().replace('varID="AL" units="deg"', 'varID="AL" units=""'))
    with pytest.raises(SchemaError, match="unit '', where alpha needs one such as rad"):
        aerodb.exchange.import_daveml(path)
    path.write_text(path.read_text().replace('varID="AL" units=""', 'varID="AL" units="ft"'))
    with pytest.raises(SchemaError, match="unit 'ft', where alpha needs one such as rad"):
        aerodb.exchange.import_daveml(path)


def test_a_file_without_coefficients_states_what_it_gives(tmp_path):
    with pytest.raises(
        SchemaError, match=r"no output is a coefficient: .*OUT \(other\); state which with names="
    ):
        aerodb.exchange.import_daveml(one(tmp_path, cn(1.0), name="other"))
