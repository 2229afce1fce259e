from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.aircraft_properties.inertia import (
    _join_covariances,
    _Regressed,
    inertia_from_flight,
)

TRUE = {"Ixx": 11000.0, "Iyy": 8000.0, "Izz": 15000.0, "Ixz": 900.0}
MODELS = {
    m.coefficient: m
    for m in map(
        RegressionModel.parse,
        (
            "Cl = 1 + beta + phat + rhat + delta_a",
            "Cm = 1 + alpha + qhat + delta_e",
            "Cn = 1 + beta + phat + rhat + delta_r",
        ),
    )
}


def aircraft(**changes):
    """What the file states: wrong by ten per cent, but for the pitching moment."""
    about = dict(
        Ixx=10000.0,
        Iyy=8000.0,
        Izz=14000.0,
        Ixz=500.0,
        Ixy=0.0,
        Iyz=0.0,
        S=16.0,
        cbar=1.6,
        b=10.0,
        mass=2000.0,
        cg=(0.0, 0.0, 0.0),
    )
    return SimpleNamespace(**{**about, "engines": (), **changes})


def flown(seed=0, noise=0.02, scale=1.0, rotor=0.0):
    """Coupled multisines about all axes, moments by the rigid-body equations, coloured noise on the
    angular accelerations.
    """
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(3000)
    k = np.arange(3, 30)

    def multisine(size):
        return (
            size
            * np.cos(2 * np.pi * np.outer(t, k) / 60 + rng.uniform(0, 2 * np.pi, len(k))).sum(
                axis=1
            )
            / np.sqrt(len(k))
        )

    omega = np.stack(
        [multisine(0.8 * scale), multisine(0.35 * scale), multisine(0.35 * scale)], axis=1
    )
    names = ("alpha", "beta", "delta_e", "delta_a", "delta_r")
    x = {name: multisine(0.07) for name in names}
    V = 80.0 + multisine(4.0)
    qbar = 0.55 * V**2
    p, q, r = (omega * [10, 1.6, 10]).T / (2 * V)
    Cl = -0.08 * x["beta"] - 0.45 * p + 0.1 * r - 0.2 * x["delta_a"]
    Cm = 0.02 - 0.6 * x["alpha"] - 14 * q - 1.1 * x["delta_e"]
    Cn = 0.09 * x["beta"] - 0.03 * p - 0.12 * r - 0.08 * x["delta_r"]
    I = np.diag([TRUE["Ixx"], TRUE["Iyy"], TRUE["Izz"]])
    I[0, 2] = I[2, 0] = -TRUE["Ixz"]
    moment = np.stack([Cl * 160, Cm * 25.6, Cn * 160], axis=1) * qbar[:, None] - np.cross(
        omega, omega @ I + [rotor, 0, 0]
    )
    rate = np.linalg.solve(I, moment.T).T
    rate = rate + noise * rate.std(axis=0) * lfilter(
        [0.3], [1, -0.95], rng.normal(size=rate.shape), axis=0
    )
    columns = {
        "V": V,
        "qbar": qbar,
        **x,
        **dict(zip("pqr", omega.T)),
        **dict(zip(("p_dot", "q_dot", "r_dot"), rate.T)),
    }
    return xr.Dataset(
        {name: ("time", values) for name, values in columns.items()}, coords={"time": t}
    )


def moments(found):
    return dict(zip(map(str, found.estimates["term"].values), found.estimates["estimate"].values))


def test_exact_accelerations_give_the_exact_moments():
    found = inertia_from_flight(flown(noise=0.0), aircraft(), MODELS)
    for name, truth in TRUE.items():
        assert moments(found)[name] == pytest.approx(truth, rel=1e-8)


@pytest.mark.nightly
def test_two_standard_errors_cover_the_truth_and_the_equations_agree():
    """30 flights x 3 moments: a share of 0.95 scatters by 2 to 4 %."""
    inside, chi2 = [], []
    for seed in range(30):
        found = inertia_from_flight(flown(seed), aircraft(), MODELS)
        e = found.estimates.sel(term=["Ixx", "Izz", "Ixz"])
        inside.append(
            np.abs(e["estimate"].values - [TRUE[str(term)] for term in e["term"].values])
            < 2 * e["stderr"].values
        )
        chi2.append(found.estimates.attrs["chi2"])
    assert np.mean(inside) > 0.87
    assert np.mean(chi2) == pytest.approx(3.0, abs=1.6)


def test_the_scale_is_the_moment_that_is_known():
    found = inertia_from_flight(flown(), aircraft(Ixx=11000.0, Iyy=7000.0), MODELS, scale="Ixx")
    assert moments(found)["Ixx"] == 11000.0
    assert float(found.estimates["stderr"].sel(term="Ixx")) == 0.0
    assert moments(found)["Iyy"] == pytest.approx(8000.0, rel=0.02)
    assert "Ixx given" in found.report()


def test_the_rotor_is_taken_off_with_its_momentum():
    engine = SimpleNamespace(
        position=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0), angular_momentum=400.0, propeller=None
    )
    data = flown(noise=0.002, rotor=400.0).assign({"engine1.thrust": 0.0})
    known = aircraft(**TRUE, engines=(engine,))
    assert moments(inertia_from_flight(data, known, MODELS))["Izz"] == pytest.approx(
        15000.0, rel=2e-3
    )


def test_manoeuvres_without_coupling_state_so():
    weak = inertia_from_flight(flown(scale=0.1), aircraft(), MODELS)
    assert any("not coupled enough" in text for text in map(str, weak.remarks))
    with pytest.raises(IdentificationError, match="not coupled enough"):
        inertia_from_flight(flown(scale=0.02), aircraft(), MODELS)


def test_what_is_missing_is_named():
    with pytest.raises(
        IdentificationError, match="no model of Cm, Cn; the three moments are coupled"
    ):
        inertia_from_flight(flown(), aircraft(), {"Cl": MODELS["Cl"]})
    with pytest.raises(UnknownName, match="unknown scale 'Ixz'"):
        inertia_from_flight(flown(), aircraft(), MODELS, scale="Ixz")
    with pytest.raises(UnknownName, match="needs the angular accelerations"):
        inertia_from_flight(flown().drop_vars("p_dot"), aircraft(), MODELS)
    with pytest.raises(IdentificationError, match="equation of p_dot: pq, qr are zero throughout"):
        inertia_from_flight(flown().assign(q=lambda d: 0.0 * d["q"]), aircraft(), MODELS)


def test_the_roll_and_yaw_equations_share_their_errors():
    """The same regressors: the covariance of the coefficients is the residual moment times M."""
    M = np.array([[2.0, 0.5], [0.5, 1.0]])
    # unit residuals with a correlation of 0.6
    roll, yaw = np.array([1.0, 0.0]), np.array([0.6, 0.8])
    parts = []
    for size, residual in ((3.0, roll), (1.0, roll), (2.0, yaw)):
        parts.append(_Regressed(np.zeros(2), size**2 * M, size**2 * M, size * residual))
    joined = _join_covariances(parts, [part.covariance for part in parts])
    np.testing.assert_allclose(joined[:2, 4:], 3.0 * 2.0 * 0.6 * M)
    np.testing.assert_allclose(joined, joined.T)
    np.testing.assert_array_equal(joined[2:4, 4:], 0.0)
    assert np.linalg.eigvalsh(joined).min() > 0.0
