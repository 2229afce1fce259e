"""DAVE-ML models multiplied out into terms: equal to rounding, or refused."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.vocabulary import has_opposite_sign
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.simulation.kernel import INPUT
from flightmech.units import DEGREE, FOOT

FLIGHT = Path(__file__).parents[3] / ".." / "shared" / "data" / "flight"
EXAMPLES = FLIGHT / "aero_databases" / "daveml_examples"
NESC = FLIGHT / "nesc_checkcases" / "models"
samples = pytest.mark.skipif(not NESC.exists(), reason="needs the DAVE-ML samples of ../shared")

S, CBAR, B = 20.0, 2.0, 8.0  # m2, m, m, of the model below
ROUNDING = 1e-13  # some hundred roundings of coefficients of size 1


def variable(name, inside="", varID="", **attributes):
    more = "".join(f' {key}="{text}"' for key, text in {"units": "nd", **attributes}.items())
    return f'<variableDef name="{name}" varID="{varID or name}"{more}>{inside}</variableDef>'


def apply(operator, *arguments):
    return f"<apply><{operator}/>{''.join(arguments)}</apply>"


def ci(name):
    return f"<ci>{name}</ci>"


def cn(value):
    return f"<cn>{value!r}</cn>"


def made(math, more="<isOutput/>"):
    return f"<calculation><math>{math}</math></calculation>{more}"


def table(output, values, **points):
    """Return a function; a value of `points` is the breakpoints, or those and attributes."""
    axes = ""
    for name, given in points.items():
        numbers, attributes = given if isinstance(given, tuple) else (given, "")
        axes += (
            f'<independentVarPts varID="{name}" '
            f"{attributes}>{' '.join(map(repr, numbers))}</independentVarPts>"
        )
    return (
        f'<function name="{output}">{axes}<dependentVarPts '
        f'varID="{output}">{" ".join(map(repr, values))}</dependentVarPts></function>'
    )


GEOMETRY = (
    variable("referenceWingArea", varID="SREF", units="m2", initialValue=f"{S}")
    + variable("referenceWingChord", varID="CBAR", units="m", initialValue=f"{CBAR}")
    + variable("referenceWingSpan", varID="BSPAN", units="m", initialValue=f"{B}")
)
ANGLES = (
    variable("angleOfAttack", "<isInput/>", "AL", units="deg")
    + variable("angleOfSideslip", "<isInput/>", "BE", units="deg")
    + variable("mach", "<isInput/>", "XMACH")
    + variable("rudderDeflection", "<isInput/>", "RUD", units="deg", sign="TEL")
    + variable("elevatorDeflection", "<isInput/>", "EL", units="deg", sign="TEU")
    + variable("trueAirspeed", "<isInput/>", "VT", units="ft_s", minValue="0.1")
    + variable("bodyAngularRate_Roll", "<isInput/>", "PB", units="deg_s")
    + variable("angleOfAttackRate", "<isInput/>", "ALDOT", units="rad_s")
    + variable("x_cg", "<isInput/>", "XCG", units="nd")
)


def document(tmp_path, body):
    head = (
        '<fileHeader name="lifting body"><author name="A" org="B"/><creationDate '
        'date="2020-01-01"/></fileHeader>'
    )
    variables, functions = body
    path = tmp_path / "model.dml"
    path.write_text(f"<DAVEfunc>{head}{GEOMETRY}{ANGLES}{variables}{functions}</DAVEfunc>")
    return path


def one(tmp_path, math, tables="", functions="", name="liftCoefficient"):
    """Return a file with one coefficient."""
    return document(tmp_path, (tables + variable(name, made(math), "OUT"), functions))


def states(count=2000, seed=7):
    """Return states in SI by canonical name, inside the tables and well beyond."""
    random = np.random.default_rng(seed)
    drawn = {
        "alpha": np.radians(random.uniform(-60, 60, count)),
        "beta": np.radians(random.uniform(-50, 50, count)),
        "mach": random.uniform(-0.5, 3.0, count),
        "delta_r": np.radians(random.uniform(-60, 60, count)),
        "delta_e": np.radians(random.uniform(-60, 60, count)), "V": random.uniform(20, 300, count),
        "p": random.uniform(-2, 2, count),
        "alpha_dot": random.uniform(-1, 1, count), "x_cg": random.uniform(0.1, 0.6, count),
    }  # fmt: skip
    return drawn | {
        "phat": drawn["p"] * B / (2.0 * drawn["V"]),
        "alphadothat": drawn["alpha_dot"] * CBAR / (2.0 * drawn["V"]),
    }


def in_file(state):
    return {
        "AL": state["alpha"] / DEGREE, "BE": state["beta"] / DEGREE, "XMACH": state["mach"],
        "RUD": state["delta_r"] / DEGREE,
        "EL": -state["delta_e"] / DEGREE, "VT": state["V"] / FOOT, "PB": state["p"] / DEGREE,
        "ALDOT": state["alpha_dot"],
        "XCG": state["x_cg"],
    }  # fmt: skip


def difference(path, coefficient="CL", output="OUT"):
    """Return the database of a file and its largest difference from the model, in terms of the sum
    of contributions.
    """
    db, state = aerodb.exchange.import_daveml(path), states()
    parts = aerodb.contributions(db, coefficient, state, outside="clamp")
    expected = read(path).evaluate(in_file(state))[output]
    size = np.maximum(sum(np.abs(part) for part in parts.values()), 1.0)
    return db, float(np.max(np.abs(sum(parts.values()) - expected) / size))


def values(*shape):
    return np.random.default_rng(sum(shape)).uniform(-1.0, 1.0, int(np.prod(shape))).tolist()


ALPHAS, MACHS, RUDDERS, BETAS = (
    [-10.0, 0.0, 10.0, 25.0],
    [0.3, 0.9, 2.0],
    [0.0, 15.0, 30.0],
    [0.0, 5.0, 20.0],
)


# ---- the samples


@pytest.mark.slow
@samples
def test_the_f16_equals_its_model_at_ten_thousand_states():
    path = NESC / "F16_aero.dml"
    model, db = read(path), aerodb.exchange.import_daveml(path)
    random, count = np.random.default_rng(16), 10_000
    box = {
        "alpha": (-10, 45),
        "beta": (-30, 30),
        "delta_e": (-24, 24),
        "delta_a": (-21.5, 21.5),
        "delta_r": (-30, 30),
    }  # deg, TM-2003-212145
    state = {name: np.radians(random.uniform(*ends, count)) for name, ends in box.items()}
    V, p, q, r = (random.uniform(*ends, count) for ends in ((30, 300), (-3, 3), (-1, 1), (-1, 1)))
    inputs = {"vt": V / FOOT, "p": p, "q": q, "r": r}
    inputs |= {
        key: state[name] / DEGREE
        for key, name in zip(("alpha", "beta", "el", "ail", "rdr"), box, strict=True)
    }
    b, cbar = db.attrs["b"], db.attrs["cbar"]
    assert (db.attrs["S"], cbar, b) == pytest.approx(
        (300 * FOOT**2, 11.32 * FOOT, 30 * FOOT), rel=1e-15
    )
    reduced = {"phat": p * b / (2 * V), "qhat": q * cbar / (2 * V), "rhat": r * b / (2 * V)}
    expected = model.evaluate(inputs)
    for coefficient, varID in {
        "CX": "cx",
        "CY": "cy",
        "CZ": "cz",
        "Cl": "cl",
        "Cm": "cm",
        "Cn": "cn",
    }.items():
        found = aerodb.evaluate(db, coefficient, outside="clamp", **state, **reduced)
        assert (
            np.abs(found - expected[varID]).max() < 1e-14
        )  # some ten roundings of numbers up to 4


@pytest.mark.slow
@samples
def test_the_f16_has_canonical_terms_and_its_check_cases():
    db = aerodb.exchange.import_daveml(NESC / "F16_aero.dml")
    terms = aerodb.terms(db)
    assert list(terms) == [
        "CX/basic", "CX/qhat", "CY/beta", "CY/aileron", "CY/rudder", "CY/phat", "CY/rhat",
        "CZ/basic", "CZ/beta_beta", "CZ/elevator", "CZ/qhat", "Cl/basic", "Cl/aileron", "Cl/rudder",
        "Cl/phat", "Cl/rhat",
        "Cm/basic", "Cm/qhat", "Cn/basic", "Cn/aileron", "Cn/rudder", "Cn/phat", "Cn/rhat",
    ]  # fmt: skip
    assert terms["CX/qhat"]["value"].values[:3].tolist() == [
        -0.267,
        -0.110,
        0.308,
    ]  # the digits of the file
    rolling = terms["Cl/basic"]["value"]  # looked up by |beta| in the file, with the sign of beta
    assert np.degrees(rolling["beta"].values) == pytest.approx(np.arange(-30.0, 31.0, 5.0))
    assert rolling.values == pytest.approx(-rolling.values[::-1])
    assert db.attrs["force_axes"] == "body"
    assert "NASA TM-2003-212145" in db.attrs["references"]
    assert db.attrs["history"].endswith("16 check cases with 944 values, all met")
    assert "limited to 0.1" in db.attrs["comment"]
    cases = db["checks"].to_dataset()
    for coefficient in ("CX", "CY", "CZ", "Cl", "Cm", "Cn"):
        found = aerodb.evaluate(
            db, coefficient, **{str(name): cases[name].values for name in cases.data_vars}
        )
        assert (
            np.abs(found - cases[coefficient].values) <= cases[f"{coefficient}_tolerance"].values
        ).all()


@samples
def test_the_brick_and_the_cannonball_are_constants_and_dampings():
    brick = aerodb.exchange.import_daveml(NESC / "brick_aero.dml")
    assert {name: float(leaf["value"]) for name, leaf in aerodb.terms(brick).items()} == {
        "CL/basic": 0.0, "CD/basic": 0.01, "CY/basic": 0.0, "Cl/phat": -1.0, "Cm/qhat": -1.0,
        "Cn/rhat": -1.0,
    }  # fmt: skip
    assert brick.attrs["b"] == pytest.approx(0.33333 * FOOT, rel=1e-15)
    with pytest.raises(
        SchemaError,
        match=r"(?s)the file does not state cbar; pass cbar=.*the file does not state b; pass b=",
    ):
        aerodb.exchange.import_daveml(NESC / "cannonball_aero.dml")
    ball = aerodb.exchange.import_daveml(NESC / "cannonball_aero.dml", cbar=0.1, b=0.1)
    assert float(aerodb.evaluate(ball, "CD")) == 0.1


@samples
def test_what_the_two_stage_rocket_cannot_give_is_named_with_its_reason():
    path = NESC / "twostage_aero.dml"
    with pytest.raises(
        SchemaError,
        match=r"CD: totalCoefficientOfDrag \(dragCoefficient\): it uses alphaT: the power 0.5 of "
        r"alpha, beta",
    ) as caught:
        aerodb.exchange.import_daveml(path)
    assert len(caught.value.problems) == 1
    db = aerodb.exchange.import_daveml(path, without=("CD",))
    assert set(aerodb.terms(db)) == {"CL/basic", "CY/basic", "Cl/basic", "Cm/basic", "Cn/basic"}
    assert db.attrs["absent"] == "CD/basic"
    assert float(aerodb.evaluate(db, "CL", alpha=np.radians(3.0))) == pytest.approx(
        0.365
    )  # between 0.24 at 2 and 0.49 at 4 deg


@samples
def test_the_simple_examples():
    sizes = {"S": 1.0, "cbar": 1.0, "b": 1.0}
    simple = aerodb.exchange.import_daveml(EXAMPLES / "simple_aero.dml", **sizes)
    assert float(aerodb.evaluate(simple, "CL", alpha=np.radians(10.0))) == pytest.approx(0.9)
    limited = aerodb.exchange.import_daveml(
        EXAMPLES / "twoD_table.dml", **sizes
    )  # min, max inside the breakpoints, ends that go on
    model = read(EXAMPLES / "twoD_table.dml")
    mach, alpha = (
        grid.ravel()
        for grid in np.meshgrid(np.linspace(-0.2, 1.5, 60), np.linspace(-9.0, 22.0, 70))
    )
    found = aerodb.evaluate(limited, "CL", outside="clamp", mach=mach, alpha=np.radians(alpha))
    assert found == pytest.approx(
        model.evaluate({"MACH": mach, "ALPHA": alpha})["CL"], abs=ROUNDING
    )
    symmetric = aerodb.exchange.import_daveml(
        EXAMPLES / "aero_cm.dml", names={"CLM_sym": "Cm", "ALPHA_TOT_D": "alpha [deg]"}, **sizes
    )
    assert float(
        aerodb.evaluate(symmetric, "Cm", mach=0.5, alpha=np.radians(5.0))
    ) == pytest.approx(-0.043944)
    spread = aerodb.exchange.import_daveml(
        EXAMPLES / "uncertain_1D_table.dml", names={"Cm_u": "Cm"}, **sizes
    )
    assert aerodb.terms(spread)["Cm/basic"]["stderr"].values[:2] == pytest.approx(
        [5.2 * 0.10 / 3.0, 4.3 * 0.08 / 3.0]
    )


# ---- what is taken over exactly


@pytest.mark.slow
def test_a_model_like_the_hl20(tmp_path):
    """Cubic polynomials in alpha over tables of Mach, |rudder| with the sign of the rudder, rates,
    a transfer to the c.g.
    """
    cubic = ci("CZ3")
    for name in ("CZ2", "CZ1", "CZ0"):
        cubic = apply("plus", ci(name), apply("times", ci("AL"), cubic))
    turn = f"<piece>{apply('minus', ci('CNR'))}{apply('lt', ci('RUD'), cn(0.0))}</piece><otherwise>{ci('CNR')}</otherwise>"
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
        f"<piecewise><piece>{cn(0.0)}{apply('leq', ci('AL'), cn(0.0))}</piece><otherwise>{ci('AL')}</otherwise></piecewise>",
        f"<piecewise><piece>{cn(8.0)}{apply('gt', cn(0.0), cn(1.0))}</piece><otherwise>{ci('AL')}</otherwise></piecewise>",
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
            f"<piecewise><piece>{cn(1.0)}{apply('lt', ci('BE'), cn(0.0))}</piece><otherwise>{cn(2.0)}</otherwise></piecewise>",
            "",
            "it jumps where beta passes 0",
        ),
        (
            f"<piecewise><piece>{cn(1.0)}{apply('lt', ci('BE'), cn(0.0))}</piece></piecewise>",
            "",
            "a piecewise without otherwise",
        ),
        (
            f"<piecewise><piece>{ci('AL')}{apply('lt', ci('BE'), ci('AL'))}</piece><otherwise>{ci('BE')}</otherwise></piecewise>",
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


# ---- what is sampled

LIMITED = {name: variable(name) for name in ("T", "U", "W")}
SAMPLED = [
    (apply("times", cn(0.1), apply("sin", apply("times", cn(0.05), ci("AL")))),
     table("T", values(4), AL=ALPHAS), {"alpha"}),
    # one variable limited by another, as a body flap by the elevator
    (apply("times", cn(0.02), apply("min", ci("AL"), apply("times", cn(0.5), ci("RUD")))),
     table("T", values(4), AL=ALPHAS)
     + table("U", values(3), RUD=RUDDERS), {"alpha", "delta_r"}),
    # tables of one variable multiplied, with a factor that stays exact
    (apply("times", ci("T"), ci("U"), ci("EL")), table("T", values(4), AL=ALPHAS)
     + table("U", values(4), AL=[-10.0, 5.0, 12.0, 25.0]), {"alpha"}),
    (apply("times", ci("T"), apply("divide", cn(0.1), apply("plus", ci("XMACH"), cn(1.0)))),
     table("T", values(12), AL=ALPHAS, XMACH=MACHS), {"alpha", "mach"}),
    (ci("T"), table("T", values(4), AL=(ALPHAS, 'interpolate="cubicSpline"')), {"alpha"}),
    (ci("T"), table("T", values(4), MEAN=ALPHAS) + table("U", values(4), AL=ALPHAS)
     + table("W", values(3), RUD=RUDDERS), {"alpha", "delta_r"}),
]  # fmt: skip


@pytest.mark.nightly
@pytest.mark.parametrize(("math", "functions", "over"), SAMPLED)
def test_what_no_table_gives_is_sampled_within_the_bound_and_states_it(
    tmp_path, math, functions, over
):
    more = variable(
        "mean",
        made(apply("times", cn(0.5), apply("plus", ci("AL"), ci("RUD"))), ""),
        "MEAN",
        units="deg",
    )
    sum_of_both = apply("plus", apply("times", ci("AL"), cn(0.01)), math)
    used = "".join(
        text
        for name, text in LIMITED.items()
        if f'output="{name}"' in functions or f'varID="{name}"' in functions
    )
    path = one(tmp_path, sum_of_both, used + more, functions)
    with pytest.raises(SchemaError, match="put them onto tables with sample="):
        aerodb.exchange.import_daveml(path)
    db = aerodb.exchange.import_daveml(path, sample=0.02)
    leaves = aerodb.terms(db)
    sampled = {name: leaf for name, leaf in leaves.items() if "sampled" in leaf.attrs}
    assert {str(axis) for leaf in sampled.values() for axis in leaf.dims} == over
    assert float(leaves["CL/alpha"]["value"]) == pytest.approx(
        0.01 / DEGREE, rel=1e-12
    )  # what is exact stays exact
    assert re.search(
        r"CL differs from the file by at most [\d.e-]+ at 5000 states, allowed 0.02",
        db.attrs["history"],
    )
    random, count = np.random.default_rng(5), 4000
    ends = {"alpha": (-10, 25), "mach": (0.3, 2.0), "delta_r": (0, 30), "delta_e": (-20, 20)}
    state = states(count) | {
        n: random.uniform(*e, count) * (1.0 if n == "mach" else DEGREE) for n, e in ends.items()
    }
    gap = np.abs(
        aerodb.evaluate(db, "CL", outside="clamp", **state)
        - read(path).evaluate(in_file(state))["OUT"]
    )
    assert 1e-9 < gap.max() <= 0.02


def test_the_grid_of_a_sampled_function_is_chosen_or_given(tmp_path):
    path = one(tmp_path, apply("sin", apply("times", cn(0.05), ci("AL"))))
    with pytest.raises(
        SchemaError,
        match=r"no table and no limit states how far alpha goes; give grid=\{'alpha': \(low, "
        r"high\)\}",
    ):
        aerodb.exchange.import_daveml(path, sample=1e-3)
    ranged = aerodb.terms(
        aerodb.exchange.import_daveml(path, sample=1e-3, grid={"alpha": (-0.2, 0.4)})
    )["CL/basic"]
    assert ranged["alpha"].values[[0, -1]].tolist() == [-0.2, 0.4]
    assert ranged.sizes["alpha"] > 5
    given = aerodb.terms(
        aerodb.exchange.import_daveml(path, sample=0.2, grid={"alpha": [-0.2, 0.1, 0.4]})
    )["CL/basic"]
    assert given["alpha"].values.tolist() == [-0.2, 0.1, 0.4]
    assert given["value"].values == pytest.approx(
        np.sin(0.05 * np.degrees([-0.2, 0.1, 0.4])), rel=1e-14
    )
    with pytest.raises(
        SchemaError,
        match=r"(?s)sample=0.001 is not kept; give more breakpoints with grid=.*CL differs from "
        r"OUT by 0\.0",
    ):
        aerodb.exchange.import_daveml(path, sample=1e-3, grid={"alpha": [-0.2, 0.1, 0.4]})
    with pytest.raises(ValueError, match="give sample=, the largest difference allowed"):
        aerodb.exchange.import_daveml(path, grid={"alpha": (-0.2, 0.4)})


def test_jumps_and_functions_of_too_many_variables_cannot_be_sampled(tmp_path):
    jump = f"<piecewise><piece>{cn(1.0)}{apply('lt', ci('BE'), cn(1.0))}</piece><otherwise>{cn(2.0)}</otherwise></piecewise>"
    with pytest.raises(SchemaError, match=r"cannot be sampled: it jumps near beta = 0\.01745"):
        aerodb.exchange.import_daveml(one(tmp_path, jump), sample=1e-3, grid={"beta": (-0.2, 0.3)})
    many = apply("sin", apply("plus", *(ci(name) for name in ("AL", "BE", "XMACH", "RUD", "EL"))))
    ranges = dict.fromkeys(("alpha", "beta", "mach", "delta_r", "delta_e"), (0.0, 0.1))
    with pytest.raises(
        SchemaError,
        match="it depends on alpha, beta, delta_e, delta_r, mach; a table has at most 4 axes",
    ):
        aerodb.exchange.import_daveml(one(tmp_path, many), sample=1e-3, grid=ranges)


@pytest.mark.slow
def test_surfaces_of_a_lifting_body_are_sampled_and_the_powers_of_alpha_stay_exact(tmp_path):
    """Cubics in alpha over tables of the mean of two elevons, and of a body flap that the elevon
    limits.
    """
    surfaces = ("WEL", "WER", "FLAP")
    variables = "".join(
        variable(name, "<isInput/>", name, units="deg", minValue="-30", maxValue="30")
        for name in surfaces
    )
    mean = apply("times", cn(0.5), apply("plus", ci("WEL"), ci("WER")))
    variables += variable("mean", made(mean, ""), "DE", units="deg")
    variables += variable(
        "limited",
        made(apply("min", ci("FLAP"), apply("plus", ci("WEL"), cn(20.0))), ""),
        "BF",
        units="deg",
    )
    points, functions, total = [-30.0, -15.0, 0.0, 15.0, 30.0], "", []
    for name, surface, size in (("E", "DE", 0.3), ("B", "BF", 0.05)):
        cubic = ci(f"{name}3")
        for i in range(4):
            variables += variable(f"{name}{i}")
            shape = (
                np.outer(np.tanh(np.array(points) / 25.0), 1.0 / (1.0 + np.array(MACHS)))
                * size
                * 0.03**i
            )
            functions += table(
                f"{name}{i}", shape.ravel().tolist(), **{surface: points, "XMACH": MACHS}
            )
        for i in (2, 1, 0):
            cubic = apply("plus", ci(f"{name}{i}"), apply("times", ci("AL"), cubic))
        total.append(cubic)
    path = one(tmp_path, apply("plus", *total), variables, functions)
    with pytest.warns(AeromatchWarning, match="WEL is device"):
        db = aerodb.exchange.import_daveml(path, sample=0.02, grid={"alpha": (-0.15, 0.45)})
    leaves = aerodb.terms(db)
    assert {leaf.attrs["regressors"] for leaf in leaves.values()} == {
        "",
        "alpha",
        "alpha alpha",
    }  # alpha is not a sampled axis
    random, count = np.random.default_rng(3), 3000
    state = {
        f"device.{name}.deflection": random.uniform(-30, 30, count) * DEGREE for name in surfaces
    }
    state |= {"alpha": random.uniform(-0.15, 0.45, count), "mach": random.uniform(0.3, 2.0, count)}
    given = {name: state[f"device.{name}.deflection"] / DEGREE for name in surfaces}
    expected = read(path).values(
        ["OUT"], given | {"AL": state["alpha"] / DEGREE, "XMACH": state["mach"]}
    )["OUT"]
    gap = np.abs(aerodb.evaluate(db, "CL", outside="clamp", **state) - expected).max()
    assert 1e-6 < gap <= 0.02
    assert np.abs(expected).max() > 0.4
