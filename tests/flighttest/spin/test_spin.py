"""Spin: rates about the flight path, published structures and numbers, models as databases, what
the kernel makes of them.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.fuel import Fuel, Tank
from flightmech.errors import (
    IdentificationError,
    ParseError,
    SchemaError,
    SimulationError,
    UnknownName,
)
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.spin import polynomial_models as structure
from flighttest.special_tests.spin.polynomial_models import (
    Polynomial,
    polynomial_database,
    read_polynomials,
)
from flighttest.special_tests.spin.rotation_rates import (
    _turn_aircraft,
    _turn_back,
    _turn_record,
    nominal_variables,
    spin_variables,
    wind_axis_rates,
)

ROOT = Path(__file__).parents[3]
DATA, PUBLISHED = ROOT / "data" / "cz150", ROOT / ".." / "shared" / "data" / "published"
DEG, FOOT = np.pi / 180.0, 0.3048
NOMINAL = {  # [Gresham] eq. (23)
    "V": 66.9 * FOOT, "alpha": 12.4 * DEG, "beta": 5.74 * DEG, "p": -385.0 * DEG, "q": 36.2 * DEG,
    "r": -97.2 * DEG,
    "delta_e": -18.5 * DEG, "delta_a": 15.5 * DEG, "delta_r": 24.6 * DEG,
}  # fmt: skip
SURFACES = ("delta_e", "delta_a", "delta_r")
START = {f"init.{name}": NOMINAL[name] for name in ("V", "alpha", "beta", "p", "q", "r")}
START |= {
    "init.phi": -24.0 * DEG,
    "init.theta": -74.0 * DEG,
    "init.h": 600.0,
    "mode.earth": 0.0,
    "mode.trim": 0.0,
}


@pytest.fixture(scope="module")
def cz150():
    return flightmech.read_aircraft(DATA / "aircraft.toml")


def without_cubed_rate(polynomials):
    model, estimates, sigma = polynomials["Cm"]
    kept = [k for k, term in enumerate(model.terms) if term != "qhat**3"]
    return {
        **polynomials,
        "Cm": Polynomial(
            RegressionModel("Cm", [model.terms[k] for k in kept]), estimates[kept], sigma[kept]
        ),
    }


def database(polynomials, aircraft):
    return polynomial_database(
        {c: (p.model, p.estimates) for c, p in polynomials.items()}, aircraft
    )


@pytest.fixture(scope="module")
def glider(cz150):
    return flightmech.compile(
        cz150, database(without_cubed_rate(read_polynomials(DATA / "glide.csv")), cz150)
    )


@pytest.fixture(scope="module")
def spinner(cz150):
    polynomials = read_polynomials(DATA / "spin.csv", nominal_variables(NOMINAL, cz150), "flown")
    return flightmech.compile(cz150, database(polynomials, cz150)), polynomials


def quiet(seconds):
    time = np.array([0.0, seconds]) if seconds < 0.1 else np.arange(0.0, seconds + 1e-9, 0.02)
    return xr.Dataset(
        {name: ("time", np.full(len(time), NOMINAL[name])) for name in SURFACES}, {"time": time}
    )


def test_rates_of_the_nominal_spin():
    """seed-numbers.md 1: eq. (2)-(5) at eq. (23), to 0.01 deg/s."""
    found = wind_axis_rates(*(NOMINAL[name] for name in ("p", "q", "r", "alpha", "beta")))
    assert np.array(found[:4]) / DEG == pytest.approx([-391.28, -4.76, 75.33, -13.60], abs=0.01)
    rest = np.linalg.norm(found[1:4])
    assert rest / DEG == pytest.approx(76.70, abs=0.01)
    assert np.degrees(np.arctan2(rest, -found.Omega)) == pytest.approx(11.09, abs=0.005)


def test_reduced_rates_of_the_nominal_spin(cz150):
    found = nominal_variables(NOMINAL, cz150)
    expected = {
        "Omegahat": -0.3557,
        "phat_osc": -0.00433,
        "qhat_osc": 0.01031,
        "rhat_osc": -0.01236,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=5e-5)
    assert found["alphadothat"] == found["betadothat"] == 0.0


def random_motion(size=200, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.normal(0.0, 3.0, size) for _ in range(3)] + [
        rng.uniform(-1.2, 1.2, size) for _ in range(2)
    ]


def test_the_rest_is_at_right_angles_to_the_flight_path_and_has_two_components():
    p, q, r, alpha, beta = random_motion()
    found = wind_axis_rates(p, q, r, alpha, beta)
    path = np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    assert (path * np.array(found[1:4])).sum(axis=0) == pytest.approx(0.0, abs=1e-14)
    assert np.array(found[1:4]) + found.Omega * path == pytest.approx(
        np.array([p, q, r]), abs=1e-14
    )
    # two components carry it all: wind y and wind z
    q_wind = found.q_osc / np.cos(beta)
    assert found.p_osc == pytest.approx(
        -q_wind * np.cos(alpha) * np.sin(beta) - found.r_wind * np.sin(alpha), abs=1e-13
    )
    assert found.r_osc == pytest.approx(
        -q_wind * np.sin(alpha) * np.sin(beta) + found.r_wind * np.cos(alpha), abs=1e-13
    )


def test_alpha_dot_is_nearly_q_osc(spinner, cz150):
    """identification.md 6.3: alpha_dot = q_osc/cos^2(beta) + force and gravity along the path."""
    y = flightmech.simulate(spinner[0], quiet(3.0), START)
    data = spin_variables(y, cz150)
    V, al, be, ph, th = (y[name].values for name in ("V", "alpha", "beta", "phi", "theta"))
    g = 9.80665
    x, z = y["ax"].values - g * np.sin(th), y["az"].values + g * np.cos(th) * np.cos(ph)
    rest = (z * np.cos(al) - x * np.sin(al)) / (V * np.cos(be))
    assert data["q_osc"].values / np.cos(be) ** 2 + rest == pytest.approx(
        y["alpha_dot"].values, abs=1e-10
    )


def test_missing_state_is_named(cz150):
    with pytest.raises(UnknownName, match="'beta'"):
        spin_variables(
            xr.Dataset({name: ("time", [1.0]) for name in ("V", "alpha", "p", "q", "r")}), cz150
        )


def test_structures_have_the_published_terms():
    """seed-numbers.md 1: eq. (24)-(29) have 6, 6, 5, 5, 7, 8 terms, eq. (30)-(35) 12, 12, 13, 13,
    13, 13.
    """
    assert [len(terms) for terms in structure.GLIDE.values()] == [6, 6, 5, 5, 7, 8]
    assert [len(terms) for terms in structure.SPIN.values()] == [12, 12, 13, 13, 13, 13]
    for shipped, name in ((structure.GLIDE, "glide.csv"), (structure.SPIN, "spin.csv")):
        polynomials = read_polynomials(DATA / name)
        assert {c: p.model.terms for c, p in polynomials.items()} == {
            c: RegressionModel(c, terms).terms for c, terms in shipped.items()
        }


def test_two_components_instead_of_three(cz150):
    from spin_campaign import two_component

    shorter = two_component(structure.SPIN)
    assert all(len(shorter[c]) == len(structure.SPIN[c]) - 1 for c in shorter)
    built = structure.models_of_structure(shorter, nominal_variables(NOMINAL, cz150))
    assert built["Cm"].reference["rhat_wind"] == pytest.approx(
        wind_axis_rates(*(NOMINAL[name] for name in ("p", "q", "r", "alpha", "beta"))).r_wind
        * cz150.b
        / (2.0 * NOMINAL["V"])
    )
    with pytest.raises(UnknownName, match="does not have the three rates"):
        two_component(structure.GLIDE)


CANONICAL = {
    "q_hat": "qhat", "p_hat": "phat", "r_hat": "rhat", "de": "delta_e", "da": "delta_a",
    "dr": "delta_r", "Omega_hat": "Omegahat",
    "posc_hat": "phat_osc", "qosc_hat": "qhat_osc", "rosc_hat": "rhat_osc",
    "alphadot_hat": "alphadothat", "betadot_hat": "betadothat",
    "Cx": "CX", "Cy": "CY", "Cz": "CZ",
}  # fmt: skip


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="needs the published tables of ../shared")
@pytest.mark.parametrize(
    ("theirs", "ours"), [("table2_nominal_glide", "glide"), ("table3_spin", "spin")]
)
def test_shipped_tables_are_the_published_ones(theirs, ours):
    def words(row):
        factors = [part.partition("^") for part in row["regressor"].split("*")]
        return "*".join(
            CANONICAL.get(name, name) + ("**" + power if power else "")
            for name, _, power in factors
        )

    with open(PUBLISHED / f"gresham_{theirs}.csv", newline="") as file:
        published = [
            (
                CANONICAL.get(row["coefficient"], row["coefficient"]),
                words(row),
                row["estimate"],
                row["sigma"],
            )
            for row in csv.DictReader(file)
        ]
    with open(DATA / f"{ours}.csv", newline="") as file:
        shipped = [
            (row["coefficient"], row["term"], row["estimate"], row["sigma"])
            for row in csv.DictReader(file)
        ]
    assert [(c, t, float(e), float(s)) for c, t, e, s in shipped] == [
        (c, t, float(e), float(s)) for c, t, e, s in published
    ]


def test_what_flies_lies_within_one_sigma_of_what_was_published():
    published, flown = (
        read_polynomials(DATA / "spin.csv"),
        read_polynomials(DATA / "spin.csv", column="flown"),
    )
    for coefficient, polynomial in published.items():
        change = np.abs(flown[coefficient].estimates - polynomial.estimates)
        assert (change <= polynomial.sigma * (1.0 + 1e-12)).all(), coefficient


@pytest.mark.parametrize(
    ("V", "expected"),
    [
        (
            50.0,
            {
                "alpha": 3.16,
                "theta": -6.46,
                "delta_e": -1.92,
                "delta_a": -0.31,
                "delta_r": 3.24,
                "phi": -1.64,
            },
        ),
        (60.0, {"alpha": 0.66, "theta": -11.36, "delta_e": 0.38}),
    ],
)
def test_glide_trims_as_computed_from_the_published_model(glider, V, expected):
    """seed-numbers.md 1 (rho 0.0023 slug/ft3).  That computation kept the void cubic pitch rate and
    another g: to 0.04 deg.
    """
    trimmed = glide_trim(glider, V)
    for name, value in expected.items():
        found = trimmed[f"applied.{name}" if name.startswith("delta_") else name]
        assert float(found) / DEG == pytest.approx(value, abs=0.04), name


def test_modes_of_the_glide(glider):
    """seed-numbers.md 1, at 50 ft/s."""
    linear = flightmech.linearize(glider, flightmech.start_of(glide_trim(glider, 50.0)))
    found = np.sort_complex(np.linalg.eigvals(linear["A"].values))
    expected = [
        -13.50,
        -5.63 - 6.56j,
        -5.63 + 6.56j,
        -1.13 - 3.51j,
        -1.13 + 3.51j,
        -0.113 - 0.728j,
        -0.113 + 0.728j,
        -0.108,
    ]
    assert np.sort_complex(found) == pytest.approx(
        np.sort_complex(np.array(expected)), rel=0.005, abs=0.001
    )


def glide_trim(sim, feet):
    return flightmech.trim(
        sim,
        {"init.V": feet * FOOT, "init.h": 345.0, "mode.earth": 0.0},
        kind="climb",
        unknowns=["alpha", "gamma", "phi", *SURFACES],
        fixed={"beta": 0.0},
    )


def test_the_kernel_flies_the_spin_model_as_written(spinner, cz150):
    """Coefficients of the kernel against the polynomials on variables formed from its own motion;
    tables of 1 deg: 4e-5.
    """
    sim, polynomials = spinner
    y = flightmech.simulate(sim, quiet(4.0), START)
    data = spin_variables(y, cz150).assign({name: y[f"applied.{name}"] for name in SURFACES})
    al = y["alpha"].values
    CX = -y["CD"].values * np.cos(al) + y["CL"].values * np.sin(al)
    CZ = -y["CD"].values * np.sin(al) - y["CL"].values * np.cos(al)
    for name, flown in {
        "CX": CX,
        "CZ": CZ,
        **{name: y[name].values for name in ("CY", "Cl", "Cm", "Cn")},
    }.items():
        model, estimates, _ = polynomials[name]
        assert flown == pytest.approx(model.design(data) @ estimates, abs=5e-5), name


def test_the_spin_settles_near_the_nominal_one(spinner):
    """data/cz150/README.md; the density grows by 2 % over this run, and the spin follows it."""
    y = flightmech.simulate(spinner[0], quiet(12.0), START).isel(time=slice(-100, None))
    for name, bound in (("alpha", 2.0), ("beta", 3.0), ("p", 40.0), ("q", 10.0), ("r", 15.0)):
        assert abs(float(y[name].mean()) - NOMINAL[name]) < bound * DEG, name
        assert float(y[name].std()) < 0.7 * DEG, name


def test_the_published_medians_do_not_spin(cz150):
    """About eq. (23) they have a real root of +14 per second: what flies must not be mistaken for
    the table.
    """
    polynomials = read_polynomials(DATA / "spin.csv", nominal_variables(NOMINAL, cz150))
    sim = flightmech.compile(cz150, database(polynomials, cz150))
    with pytest.raises(SimulationError):
        flightmech.simulate(sim, quiet(3.0), START)


def test_spin_intercepts_against_the_balance_of_forces(cz150):
    """seed-numbers.md 1: a model in deviations has the coefficients of the nominal state as its
    constants, to 0.035.
    """
    polynomials = read_polynomials(DATA / "spin.csv")
    balance = {"CX": -0.094, "CY": -0.095, "CZ": -0.841, "Cl": -0.0002, "Cm": 0.0080, "Cn": 0.0014}
    for name, value in balance.items():
        model, estimates, _ = polynomials[name]
        assert estimates[model.terms.index("1")] == pytest.approx(value, abs=0.035)


def test_a_product_in_a_database_is_the_polynomial(cz150):
    model = RegressionModel(
        "Cm", ["1", "alpha**3", "delta_e*delta_a", "alpha*beta*phat"], {"delta_e": 0.1}
    )
    others = {c: (RegressionModel(c, ["1"]), np.zeros(1)) for c in ("CX", "CY", "CZ", "Cl", "Cn")}
    values = np.array([0.01, -3.0, 0.7, 2.0])
    db = polynomial_database({**others, "Cm": (model, values)}, cz150)
    conditions = {"alpha": 0.2, "beta": -0.1, "phat": 0.3, "delta_e": 0.25, "delta_a": -0.2}
    total = sum(
        float(flightmech.terms.evaluate_term(leaf.to_dataset(), conditions))
        for leaf in db["Cm"].children.values()
    )
    assert total == pytest.approx(
        0.01 - 3.0 * 0.008 + 0.7 * 0.15 * -0.2 + 2.0 * 0.2 * -0.1 * 0.3, rel=1e-12
    )


@pytest.mark.parametrize(
    ("terms", "text"),
    [
        (["alpha**4"], "alpha\\*\\*4"),
        (["Omegahat*alpha"], "Omegahat\\*alpha"),
        (["Omegahat", "phat"], "phat next to Omegahat"),
    ],
)
def test_what_the_kernel_has_no_form_for(terms, text, cz150):
    others = {c: (RegressionModel(c, ["1"]), np.zeros(1)) for c in ("CX", "CY", "CZ", "Cl", "Cn")}
    with pytest.raises(ParseError, match=text):
        polynomial_database(
            {**others, "Cm": (RegressionModel("Cm", terms), np.ones(len(terms)))}, cz150
        )


def test_the_database_of_a_spin_is_sound(cz150):
    polynomials = read_polynomials(DATA / "spin.csv", nominal_variables(NOMINAL, cz150), "flown")
    assert aerodb.check(database(polynomials, cz150)) == []


def test_six_coefficients_are_needed(cz150):
    with pytest.raises(SchemaError, match="no model of CZ"):
        polynomial_database(
            {c: (RegressionModel(c, ["1"]), np.zeros(1)) for c in ("CX", "CY", "Cl", "Cm", "Cn")},
            cz150,
        )


def test_faulty_files_of_polynomials(tmp_path):
    file = tmp_path / "model.csv"
    file.write_text("coefficient,term,estimate\nCX,alpha,1\n")
    with pytest.raises(ParseError, match="also sigma"):
        read_polynomials(file)
    file.write_text("coefficient,term,estimate,sigma\nCX,alpha,1,0.1\nCX,beta,none,0.1\n")
    with pytest.raises(ParseError, match="line 3"):
        read_polynomials(file)


def test_a_median_needs_three_runs():
    from spin_campaign import joined

    with pytest.raises(IdentificationError, match="2 runs"):
        joined([{}, {}], {}, {})


def test_the_centre_of_gravity_turns_with_the_axes(cz150):
    """Recorded, of the tanks, and of the path: turned and back, each is its own again."""
    tank = Tank(name="left", position=(0.1, -0.4, 0.3), capacity=2.0, content=1.0)
    aircraft = replace(cz150, cg=(0.05, 0.01, 0.02), fuel=Fuel(1.0, tanks=(tank,)))
    turned = _turn_aircraft(aircraft, {})
    assert turned.cg == (-0.02, 0.01, 0.05)
    assert turned.fuel.tanks[0].position == pytest.approx((-0.3, -0.4, 0.1))
    time = np.arange(3.0)
    variables = {"x_cg_b": ("time", 0.05 + 0.0 * time), "z_cg_b": ("time", 0.02 + 0.0 * time)}
    record = xr.DataTree.from_dict({"loading": xr.Dataset(variables, {"time": time})})
    found = _turn_record(record)["loading"].to_dataset()
    assert (float(found["x_cg_b"][0]), float(found["z_cg_b"][0])) == (-0.02, 0.05)
    states = {name: ("time", 0.0 * time) for name in ("phi", "theta", "psi", "v", "w", "beta")}
    states |= {name: ("time", 20.0 + 0.0 * time) for name in ("u", "V")}
    cg = dict(zip(("x_cg_b", "y_cg_b", "z_cg_b"), turned.cg, strict=True))
    states |= {name: ("time", value + 0.0 * time) for name, value in cg.items()}
    states |= {name: ("time", 0.0 * time) for name in ("p", "q", "r")}
    back = _turn_back(xr.Dataset(states, {"time": time}), aircraft)
    assert [float(back[name][0]) for name in cg] == pytest.approx(aircraft.cg)
