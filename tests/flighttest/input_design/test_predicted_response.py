"""Predicted response, amplitude inside limits, expected standard errors; on the published glide of
the CZ150.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import AeromatchWarning, IdentificationError, OutOfRange, UnknownName
from flighttest.flight_programme.input_design.input_accuracy import (
    coefficient_noise,
    cramer_rao,
    expected_errors,
)
from flighttest.flight_programme.input_design.input_shapes import PATTERNS, multistep
from flighttest.flight_programme.input_design.multisines import InputAxis, multisine
from flighttest.flight_programme.input_design.predicted_response import (
    amplitude_within,
    each_within,
    model_inputs,
    predict_response,
    scale_signal,
    trimmed_start,
)
from flighttest.records.signals.differentiation import derivative_noise
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.spin.polynomial_models import polynomial_database, read_polynomials

DATA = Path(__file__).parents[3] / "data" / "cz150"
DEG, V = np.pi / 180.0, 50.0 * 0.3048
GLIDE = ["alpha", "gamma", "phi", "delta_e", "delta_a", "delta_r"]
CM = RegressionModel("Cm", ["1", "alpha", "qhat", "delta_e", "alpha**2"])


@pytest.fixture(scope="module")
def cz150():
    return flightmech.read_aircraft(DATA / "aircraft.toml")


@pytest.fixture(scope="module")
def glider(cz150):
    fitted = {c: (p.model, p.estimates) for c, p in read_polynomials(DATA / "glide.csv").items()}
    model, estimates = fitted["Cm"]
    kept = [k for k, term in enumerate(model.terms) if term != "qhat**3"]
    fitted["Cm"] = RegressionModel("Cm", [model.terms[k] for k in kept]), estimates[kept]
    return flightmech.compile(cz150, polynomial_database(fitted, cz150))


@pytest.fixture(scope="module")
def start(glider):
    steady = flightmech.trim(
        glider,
        {"init.V": V, "init.h": 345.0, "mode.earth": 0.0},
        kind="climb",
        unknowns=GLIDE,
        fixed={"beta": 0.0},
    )
    return flightmech.start_of(steady)


@pytest.fixture(scope="module")
def signal():
    return multisine(
        {name: InputAxis(15.0 * DEG, (0.2, 2.0)) for name in ("delta_a", "delta_e", "delta_r")},
        15.0,
    )


def test_inputs_are_trim_plus_deflection(glider, signal, start):
    found = model_inputs(glider, signal, start, 0.5)
    assert found["delta_e"].values == pytest.approx(
        start["delta_e"] + 0.5 * signal["delta_e"].values, abs=1e-15
    )
    assert found["delta_r"].values[0] == start["delta_r"]


def test_left_and_right_surfaces(glider, start):
    time = np.array([0.0, 1.0])
    split = {"delta_a_left": 0.02, "delta_a_right": 0.06, "delta_f_left": 0.1, "delta_f_right": 0.2}
    both = xr.Dataset(
        {name: ("time", np.full(2, value)) for name, value in split.items()}, {"time": time}
    )
    found = model_inputs(glider, both, {**start, "delta_a": 0.0, "delta_f": 0.0})
    assert found["delta_a"].values == pytest.approx(0.02)
    assert found["delta_f"].values == pytest.approx(0.15)


def test_an_axis_that_the_model_lacks(glider, start):
    lever = xr.Dataset({"throttle": ("time", np.zeros(2))}, {"time": [0.0, 1.0]})
    with pytest.raises(UnknownName, match="the model has no input for it"):
        model_inputs(glider, lever, start)


def test_without_deflection_the_flight_goes_on_unchanged(glider, signal, start):
    response = predict_response(glider, signal, start, 0.0)
    # alpha-trim holds the attitude while the air grows denser: 0.2 % over 17 s of descent
    assert np.ptp(response["alpha"].values) < 0.1 * DEG
    assert np.ptp(response["phi"].values) < 0.5 * DEG


LIMITS = {"alpha": (-4.0 * DEG, 9.0 * DEG), "nz": (0.3, 1.7), "phi": (-45.0 * DEG, 45.0 * DEG)}


def broken(response, limits):
    return any(
        (response[name].values < low).any() or (response[name].values > high).any()
        for name, (low, high) in limits.items()
    )


def test_the_amplitude_is_the_largest_that_the_limits_allow(glider, signal, start):
    found = amplitude_within(glider, signal, start, LIMITS)
    assert 0.05 < found.scale < 0.999
    assert not broken(found.response, LIMITS)
    assert broken(predict_response(glider, signal, start, found.scale + 0.002), LIMITS)
    assert found.binding.split()[0] in LIMITS
    assert "outside" in found.binding
    assert (found.extremes["lowest"] >= found.extremes["low"]).all()
    assert (found.extremes["highest"] <= found.extremes["high"]).all()


def test_margin_uses_a_part_of_the_way_from_trim(glider, signal, start):
    whole, part = (
        amplitude_within(glider, signal, start, LIMITS, margin=margin) for margin in (1.0, 0.5)
    )
    assert part.scale < 0.7 * whole.scale
    trim = part.extremes["trim"]
    assert (part.extremes["highest"] - trim <= 0.5 * (part.extremes["high"] - trim) + 1e-9).all()


def test_a_small_input_reaches_no_limit(glider, signal, start):
    found = amplitude_within(glider, signal, start, LIMITS, largest=0.01)
    assert (found.scale, found.binding) == (0.01, "")


def test_axes_alone_may_be_larger_than_together(glider, signal, start):
    alone = each_within(glider, signal, start, LIMITS)
    together = amplitude_within(glider, signal, start, LIMITS)
    assert set(alone) == {"delta_a", "delta_e", "delta_r"}
    assert max(alone.values()) > together.scale
    one = scale_signal(signal, {"delta_e": alone["delta_e"], "delta_a": 0.0, "delta_r": 0.0})
    assert not broken(predict_response(glider, one, start), LIMITS)
    assert one["power"].sel(axis="delta_e").sum() == pytest.approx(
        float(signal["power"].sel(axis="delta_e").sum()) * alone["delta_e"] ** 2
    )


def test_refused_limits(glider, signal, start):
    with pytest.raises(
        OutOfRange, match=r"outside its limits already: alpha 3\.\d+ outside 5 ... 9 deg"
    ):
        amplitude_within(glider, signal, start, {"alpha": (5.0 * DEG, 9.0 * DEG)})
    with pytest.raises(UnknownName, match="limits are set on outputs"):
        amplitude_within(glider, signal, start, {"alfa": (0.0, 1.0)})
    with pytest.raises(OutOfRange, match="even a thousandth"):
        amplitude_within(
            glider,
            signal,
            start,
            {"alpha": (3.1 * DEG, 3.2 * DEG), "phi": (-10.0, 10.0)},
            largest=200.0,
        )


def test_no_steady_flight(glider):
    with (
        pytest.warns(AeromatchWarning, match="V 4 m/s .* is below the stall"),
        pytest.raises(IdentificationError, match="no steady flight to start the test input from"),
    ):
        trimmed_start(glider, {"init.h": 345.0}, "climb", {"V": 4.0, "beta": 0.0}, GLIDE)


@pytest.mark.parametrize("memory", [0.0, 0.4])
def test_expected_errors_are_the_scatter_of_fits(glider, signal, start, cz150, memory):
    """300 draws of the disturbance: their scatter is known to 4 %, taken three times."""
    response = predict_response(glider, signal, start, 0.2)
    expected = expected_errors(CM, response, cz150, {"Cm": 0.004}, memory).estimates
    data = response.assign(
        {
            "qhat": response["q"] * cz150.cbar / (2.0 * response["V"]),
            "delta_e": response["applied.delta_e"],
        }
    )
    X = CM.design(data)
    rng, step = np.random.default_rng(1), 0.02
    white = rng.normal(0.0, 1.0, (300, len(X)))
    if memory:
        keep = np.exp(-step / memory)
        for i in range(1, len(X)):
            white[:, i] = keep * white[:, i - 1] + np.sqrt(1.0 - keep**2) * white[:, i]
    fits = np.linalg.lstsq(X, 0.004 * white.T, rcond=None)[0]
    assert fits.std(axis=1) == pytest.approx(expected["stderr"].values, rel=0.12)
    ratio = expected["stderr"].values / expected["stderr_white"].values
    assert ratio == pytest.approx(np.ones(5), rel=1e-12) if memory == 0.0 else ratio.min() > 1.5


def test_a_priori_values_are_those_of_the_model(glider, signal, start, cz150):
    model = RegressionModel("Cm", ["1", "alpha", "qhat", "delta_e", "alpha**2", "alpha**3"])
    found = expected_errors(model, predict_response(glider, signal, start, 0.2), cz150).estimates[
        "estimate"
    ]
    published = read_polynomials(DATA / "glide.csv")["Cm"]
    for term in model.terms:
        assert float(found.sel(term=term)) == pytest.approx(
            published.estimates[published.model.terms.index(term)], rel=1e-6
        ), term


@pytest.mark.slow
def test_twice_the_input_halves_the_errors(glider, start, cz150):
    step = multistep("delta_e", 1.0 * DEG, 0.4, PATTERNS["3-2-1-1"], free=3.0)
    model = RegressionModel("Cm", ["1", "alpha", "qhat", "delta_e"])
    small, large = (
        expected_errors(model, predict_response(glider, step, start, scale), cz150)
        for scale in (0.2, 0.4)
    )
    slopes = slice(1, None)
    assert small.estimates["stderr"].values[slopes] == pytest.approx(
        2.0 * large.estimates["stderr"].values[slopes], rel=0.02
    )
    assert large.determinant < small.determinant
    assert "Cm = 1 + alpha + qhat + delta_e" in large.report()


def test_noise_of_the_coefficients_by_hand(glider, signal, start, cz150):
    response = predict_response(glider, signal, start, 0.0)
    qS = float(response["qbar"].mean()) * cz150.S
    found = coefficient_noise(cz150, response)
    assert found["CZ"] == pytest.approx(4.9036 * 0.10 / qS, rel=1e-4)
    assert found["Cm"] == pytest.approx(
        cz150.Iyy * 0.15 * DEG * derivative_noise(0.02) / (qS * cz150.cbar), rel=1e-9
    )


def test_an_input_that_moves_nothing_lateral_is_refused_by_name(glider, start, cz150):
    step = multistep("delta_e", 1.0 * DEG, 0.4)
    response = predict_response(glider, step, start)
    with pytest.raises(IdentificationError, match="with this test input"):
        expected_errors(RegressionModel("Cn", ["1", "delta_r", "delta_a", "beta"]), response, cz150)
    with pytest.raises(UnknownName, match="give its noise"):
        expected_errors(CM, response, cz150, {"CL": 0.01})


OUTPUTS = {"alpha": 0.2 * DEG, "q": 0.15 * DEG, "az": 0.1}


def test_cramer_rao_bound_against_a_linear_fit_of_noise(glider, signal, start):
    """Outputs with white noise, fitted through an independent Jacobian: 300 draws, scatter known to
    4 %.
    """
    names = ["term.Cm.qhat", "term.Cm.delta_e", "bias.Cm"]
    found = cramer_rao(glider, signal, start, names[:2], OUTPUTS, names[2:], scale=0.2).estimates
    base = {"term.Cm.qhat": 1.0, "term.Cm.delta_e": 1.0, "bias.Cm": 0.0}
    inputs = model_inputs(glider, signal, start, 0.2)

    def weighted(change):
        y = flightmech.simulate(
            glider, inputs, {**start, "mode.trim": 0.0, **base, **change}, outputs=list(OUTPUTS)
        )
        return np.concatenate([y[name].values / sigma for name, sigma in OUTPUTS.items()])

    S = np.stack(
        [
            (weighted({name: base[name] + 1e-4}) - weighted({name: base[name]})) / 1e-4
            for name in names
        ],
        axis=1,
    )
    noise = np.random.default_rng(2).normal(0.0, 1.0, (len(S), 300))
    scatter = np.linalg.lstsq(S, noise, rcond=None)[0].std(axis=1)
    assert found["stderr"].values == pytest.approx(scatter[:2], rel=0.12)
    assert found["estimate"].values == pytest.approx([1.0, 1.0])


def test_what_else_is_freed_costs_accuracy(glider, signal, start):
    alone = cramer_rao(glider, signal, start, ["term.Cm.alpha"], OUTPUTS, scale=0.2).estimates
    together = cramer_rao(
        glider,
        signal,
        start,
        ["term.Cm.alpha"],
        OUTPUTS,
        ["bias.Cm", "init.alpha", "init.q"],
        scale=0.2,
    ).estimates
    slow = cramer_rao(
        glider, signal, start, ["term.Cm.alpha"], OUTPUTS, scale=0.2, memory=0.3
    ).estimates
    assert float(together["stderr"][0]) > 1.1 * float(alone["stderr"][0])
    assert float(slow["stderr"][0]) > 1.5 * float(alone["stderr"][0])


def test_parameters_that_no_output_feels(glider, start):
    step = multistep("delta_e", 1.0 * DEG, 0.4)
    with pytest.raises(UnknownName, match=r"term\.Cm\.nosuch"):
        cramer_rao(glider, step, start, ["term.Cm.nosuch"], OUTPUTS)
    with pytest.raises(IdentificationError, match="output error: with this test input"):
        cramer_rao(glider, step, start, ["term.Cm.alpha", "table.Cm.alpha"], OUTPUTS)
