"""DAVE-ML samples of NASA multiplied out into terms: equal to rounding, or refused by name."""

import numpy as np
import pytest
from daveml_files import (
    EXAMPLES,
    NESC,
    ROUNDING,
    samples,
)

import aerodb
from aerodb.exchange.daveml.document.reading import read
from flightmech.errors import SchemaError
from flightmech.units import DEGREE, FOOT


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
