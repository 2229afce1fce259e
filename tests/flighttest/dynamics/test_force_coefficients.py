from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import IdentificationError, OutOfRange, ParseError, UnknownName
from flightmech.units import G0
from flighttest.reconstruction.dynamics.force_coefficients import (
    coefficients,
    select_time,
    smooth_states,
)
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

STATES = (
    "V",
    "alpha",
    "beta",
    "qbar",
    "p",
    "q",
    "r",
    "p_dot",
    "q_dot",
    "r_dot",
    "ax",
    "ay",
    "az",
    "alpha_dot",
    "beta_dot",
)


def engine(position=(0.5, -0.8, 0.1), direction=(1.0, 0.0, 0.0), angular_momentum=0.0):
    return SimpleNamespace(
        position=position,
        direction=direction,
        angular_momentum=angular_momentum,
        propeller=None,
        deck=None,
    )


def plane(engines=(), **changes):
    about = dict(
        S=16.0,
        cbar=1.6,
        b=10.0,
        mass=2000.0,
        Ixx=11e3,
        Iyy=8e3,
        Izz=15e3,
        Ixy=0.0,
        Ixz=0.0,
        Iyz=0.0,
        cg=(0.0, 0.0, 0.0),
    )
    return SimpleNamespace(**{**about, "engines": tuple(engines), **changes})


def states(n=60, seed=0, **fixed):
    rng = np.random.default_rng(seed)
    size = dict(
        V=5,
        alpha=0.05,
        beta=0.05,
        qbar=300,
        p=0.3,
        q=0.2,
        r=0.2,
        p_dot=1,
        q_dot=1,
        r_dot=1,
        ax=1,
        ay=1,
        az=3,
        alpha_dot=0.2,
        beta_dot=0.2,
    )
    mean = {"V": 90.0, "qbar": 4000.0, "az": -G0, "alpha": 0.05}
    data = xr.Dataset(
        {k: ("time", mean.get(k, 0.0) + size[k] * rng.normal(size=n)) for k in STATES},
        coords={"time": 0.02 * np.arange(n)},
    )
    return data.assign({k: ("time", np.full(n, v)) for k, v in fixed.items()})


def test_moments_of_a_symmetric_plane_are_the_scalar_equations():
    d, h = states(), 30.0
    c = coefficients(
        d.assign({"engine1.thrust": ("time", np.zeros(60))}),
        plane([engine(angular_momentum=h)], Ixz=900.0),
    )
    p, q, r = d.p, d.q, d.r
    L = 11e3 * d.p_dot - 900 * (d.r_dot + p * q) + (15e3 - 8e3) * q * r
    M = 8e3 * d.q_dot + (11e3 - 15e3) * p * r + 900 * (p**2 - r**2) + h * r
    N = 15e3 * d.r_dot - 900 * (d.p_dot - q * r) + (8e3 - 11e3) * p * q - h * q
    np.testing.assert_allclose(c.Cl, L / (d.qbar * 16 * 10), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(c.Cm, M / (d.qbar * 16 * 1.6), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(c.Cn, N / (d.qbar * 16 * 10), rtol=1e-12, atol=1e-15)


def test_a_torque_free_body_without_symmetry_has_no_moment():
    aircraft = plane(Ixy=700.0, Ixz=900.0, Iyz=-400.0)
    d = states()
    inertia = np.array([[11e3, -700, -900], [-700, 8e3, 400], [-900, 400, 15e3]])
    omega = np.stack([d.p, d.q, d.r], axis=1)
    rate = -np.cross(omega, omega @ inertia) @ np.linalg.inv(inertia)
    free = d.assign(
        p_dot=("time", rate[:, 0]), q_dot=("time", rate[:, 1]), r_dot=("time", rate[:, 2])
    )
    c = coefficients(free, aircraft)
    for name in ("Cl", "Cm", "Cn"):
        assert float(abs(c[name]).max()) < 1e-14


def test_forces_and_moments_come_back_whatever_thrust_and_cg():
    """Known aerodynamic force and moment at the reference point, canted engines, c.g. off it in all
    axes.
    """
    engines = (
        engine((0.4, -0.8, 0.1), (0.99, 0.1, -0.1)),
        engine((0.3, 0.9, 0.2), (0.98, -0.12, -0.16)),
    )
    cg = np.array([0.12, -0.05, 0.22])
    aircraft = plane(engines, cg=tuple(cg))
    d = states(**{"engine1.thrust": 3000.0, "engine2.thrust": 2500.0})
    rng = np.random.default_rng(5)
    F, M_ref = rng.normal(size=(60, 3)) * [500, 800, 9000], rng.normal(size=(60, 3)) * 1e3
    total, moment = F.copy(), M_ref + np.cross(-cg, F)
    for e, T in zip(engines, (3000.0, 2500.0)):
        total += T * np.array(e.direction)
        moment += np.cross(np.array(e.position) - cg, T * np.array(e.direction))
    inertia, omega = np.diag([11e3, 8e3, 15e3]), np.stack([d.p, d.q, d.r], axis=1)
    rate = (moment - np.cross(omega, omega @ inertia)) @ np.linalg.inv(inertia)
    names = ("ax", "ay", "az", "p_dot", "q_dot", "r_dot")
    d = d.assign({k: ("time", v) for k, v in zip(names, np.hstack([total / 2000.0, rate]).T)})
    c = coefficients(d, aircraft)
    X, Y, Z = F.T / (d.qbar.values * 16)
    np.testing.assert_allclose(c.CL, X * np.sin(d.alpha) - Z * np.cos(d.alpha), atol=1e-13)
    np.testing.assert_allclose(c.CD, -X * np.cos(d.alpha) - Z * np.sin(d.alpha), atol=1e-13)
    np.testing.assert_allclose(np.stack([c.CX, c.CY, c.CZ]), [X, Y, Z], atol=1e-13)
    np.testing.assert_allclose(
        np.stack([c.Cl, c.Cm, c.Cn]), (M_ref / [10, 1.6, 10]).T / (d.qbar.values * 16), atol=1e-13
    )


def test_lift_is_up_and_drag_aft_and_the_load_factor_follows():
    d = states(n=9, alpha=0.0, qbar=4000.0, ax=-1.0, az=-2 * G0)
    c = coefficients(d, plane())
    assert float(c.CL[0]) == pytest.approx(2000 * 2 * G0 / (4000 * 16))
    assert float(c.CD[0]) == pytest.approx(2000 / (4000 * 16))
    assert float(c.dnz[0]) == pytest.approx(1.0)


def test_recorded_mass_and_cg_win_over_the_aircraft_file():
    c = coefficients(states(mass=2200.0, x_cg_b=0.1, y_cg_b=0.0, z_cg_b=0.0), plane())
    reference = coefficients(states(), plane())
    np.testing.assert_allclose(c.CY, reference.CY * 1.1, rtol=1e-12)
    np.testing.assert_allclose(
        c.Cm, reference.Cm - 0.1 / 1.6 * reference.CZ * 1.1, atol=1e-12
    )  # lift ahead of the reference: nose up


def test_the_error_budget_is_the_change_by_one_standard_error():
    d = states(**{"engine1.thrust": 3000.0})
    aircraft = plane([engine()], cg=(0.1, 0.0, 0.2))
    c = coefficients(d, aircraft, errors={"qbar": 0.02})
    heavier = coefficients(d.assign(mass=("time", np.full(60, 2000 * 1.005))), aircraft)
    stronger = coefficients(d.assign({"engine1.thrust": d["engine1.thrust"] * 1.02}), aircraft)
    denser = coefficients(d.assign(qbar=d.qbar * 1.02), aircraft)
    for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn"):
        change = c[f"{name}_error"]
        np.testing.assert_allclose(change.sel(error="mass"), heavier[name] - c[name], atol=1e-14)
        np.testing.assert_allclose(
            change.sel(error="thrust1"), stronger[name] - c[name], atol=1e-14
        )
        np.testing.assert_allclose(
            change.sel(error="qbar"), (denser[name] - c[name]) * 1.02, atol=1e-12
        )  # 1/(1 + e) to first order
        assert c[name].attrs["error_mass"] == pytest.approx(
            float(np.sqrt((change.sel(error="mass") ** 2).mean()))
        )


def test_samples_with_a_wheel_on_the_ground_are_no_measurement():
    d = states()
    d["wow_left"] = "time", np.r_[np.zeros(50), np.ones(10)]
    c = coefficients(d, plane())
    assert np.isfinite(c.Cm.values[:50]).all()
    assert np.isnan(c.Cm.values[50:]).all()
    shock = d.copy(deep=True)
    shock["az"][50:] += 100.0
    smooth, still = coefficients(shock, plane(), cutoff=10.0), coefficients(d, plane(), cutoff=10.0)
    assert np.isnan(smooth.CZ.values[43:]).all()  # 1.5/10 s before the touch-down
    np.testing.assert_allclose(
        smooth.CZ[:42], still.CZ[:42], atol=0.01 * 100.0 * 2000 / (4000 * 16)
    )  # 1 % of the shock


def test_a_record_without_a_number_has_no_coefficient():
    nothing = coefficients(np.nan * states(), plane())
    assert np.isnan(nothing["CL"].values).all()
    assert nothing["CL_error"].shape == (0, 60)


def test_angular_accelerations_are_differentiated_when_they_are_missing():
    t = 0.02 * np.arange(200)
    d = states(n=200).drop_vars(["p_dot", "q_dot", "r_dot"])
    d = d.assign(
        p=("time", 0.3 * np.sin(2 * t)),
        q=("time", 0 * t),
        r=("time", 0 * t),
        qbar=("time", np.full(200, 4000.0)),
    )
    c = coefficients(d, plane())
    np.testing.assert_allclose(
        c.Cl * (4000 * 16 * 10), 11e3 * 0.6 * np.cos(2 * t), atol=11e3 * 0.6 * 1e-5
    )  # gain of 9 points at 0.3 Hz
    uneven = d.assign_coords(time=np.r_[t[:100], t[100:] + 0.01])
    with pytest.raises(
        IdentificationError, match=r"p_dot is missing and p steps by 0.02 ... 0.03 s"
    ):
        coefficients(uneven, plane())


def test_angular_accelerations_are_differentiated_on_both_sides_of_a_gap():
    t = 0.02 * np.arange(200)
    d = states(n=200).drop_vars(["p_dot", "q_dot", "r_dot"])
    d = d.assign({name: ("time", 0.3 * np.sin(2 * t)) for name in ("p", "q", "r")})
    d = d.assign(qbar=("time", np.full(200, 4000.0)))
    whole = coefficients(d, plane()).Cm.values
    # the gap of 0.6 s leaves a stretch of five samples behind it, which is too short
    kept = (t < 1.0) | (t > 1.6)
    short = np.r_[0:50, 80:85, 120:200]
    for chosen, missing in ((kept, 0), (short, 5)):
        found = coefficients(d.isel(time=chosen), plane()).Cm.values
        good = np.isfinite(found)
        assert (~good).sum() == missing
        np.testing.assert_allclose(found[good], whole[chosen][good], atol=2e-4)


def test_rates_of_incidence_follow_from_accelerations():
    """A point mass on a path: alpha_dot from the formula against numerical derivatives of the
    simulated angles.
    """
    from scipy.integrate import solve_ivp

    def inputs(t):
        return np.array([0.3 * np.sin(t), 0.1 * np.cos(2 * t), 0.1 * np.sin(1.5 * t)]), np.array(
            [0.5, 0.8 * np.sin(t), -G0 + 2 * np.sin(1.3 * t)]
        )

    def rates(t, y):
        u, v, w, ph, th = y
        (p, q, r), (ax, ay, az) = inputs(t)
        return [
            r * v - q * w - G0 * np.sin(th) + ax,
            p * w - r * u + G0 * np.cos(th) * np.sin(ph) + ay,
            q * u - p * v + G0 * np.cos(th) * np.cos(ph) + az,
            p + np.tan(th) * (q * np.sin(ph) + r * np.cos(ph)),
            q * np.cos(ph) - r * np.sin(ph),
        ]

    t = np.linspace(0, 4, 401)
    u, v, w, ph, th = solve_ivp(
        rates, (0, 4), [90, 3, 5, 0.1, 0.05], t_eval=t, rtol=1e-10, atol=1e-10
    ).y
    motion = np.array([np.concatenate(inputs(x)) for x in t]).T
    V = np.sqrt(u**2 + v**2 + w**2)
    columns = dict(
        zip(("p", "q", "r", "ax", "ay", "az"), motion),
        V=V,
        alpha=np.arctan2(w, u),
        beta=np.arcsin(v / V),
        phi=ph,
        theta=th,
    )
    d = reduced_rates(
        xr.Dataset({k: ("time", x) for k, x in columns.items()}, coords={"time": t}), plane()
    )
    for name in ("alpha", "beta"):
        numerical = np.gradient(columns[name], t)[2:-2]
        np.testing.assert_allclose(
            d[f"{name}_dot"][2:-2], numerical, atol=2e-5
        )  # central differences over 10 ms
    np.testing.assert_allclose(d.qhat, motion[1] * 1.6 / (2 * V), rtol=1e-14)
    np.testing.assert_allclose(d.betadothat, d.beta_dot * 10 / (2 * V), rtol=1e-14)


def test_errors_of_a_path_and_of_pick_ups_are_in_the_budget():
    """What a path states of its states replaces the flat error of dynamic pressure; pick-ups have
    theirs from the instruments.
    """
    d = states().assign(delta_e=states()["alpha"] * 0.0 - 0.03)
    alpha, ax = np.full((2, d.sizes["time"]), 0.0), np.full((2, d.sizes["time"]), 0.0)
    alpha[0], ax[1] = 1e-4, 2e-3
    left = xr.Dataset(
        {"alpha": (("error", "time"), alpha), "ax": (("error", "time"), ax)},
        {"error": ["bias.alpha_vane", "bias.ax_imu"], "time": d["time"]},
    )
    known = {"pick-ups": {"bias_sigma": {"delta_e": "0.2 deg"}, "scale_sigma": {"delta_e": 0.03}}}
    c = coefficients(SimpleNamespace(states=d, errors=left), plane(instruments=known))
    assert "qbar" not in c["error"]
    for source, name, size in (("bias.alpha_vane", "alpha", 1e-4), ("bias.ax_imu", "ax", 2e-3)):
        other = coefficients(d.assign({name: d[name] + size}), plane())
        np.testing.assert_allclose(
            c["CD_error"].sel(error=source), other["CD"] - c["CD"], atol=1e-7
        )  # kept in single precision
    np.testing.assert_allclose(c["alpha_error"].sel(error="bias.alpha_vane"), 1e-4, rtol=1e-5)
    np.testing.assert_allclose(c["delta_e_error"].sel(error="bias.delta_e"), 0.2 * np.pi / 180)
    np.testing.assert_allclose(c["delta_e_error"].sel(error="scale.delta_e"), -0.03 * 0.03)
    assert (
        "qbar"
        in coefficients(SimpleNamespace(states=d, errors=left), plane(), errors={"qbar": 0.01})[
            "error"
        ]
    )
    assert float(
        coefficients(d, plane())["delta_e_error"].sel(error="bias.delta_e")[0]
    ) == pytest.approx(0.1 * np.pi / 180)


def test_missing_states_and_unknown_errors_are_named():
    with pytest.raises(
        UnknownName, match=r"unknown state 'engine1.thrust'.*the coefficients need it"
    ):
        coefficients(states(), plane([engine()]))
    with pytest.raises(UnknownName, match="unknown source of error 'masse'; near it: mass"):
        coefficients(states(), plane(), errors={"masse": 0.1})


def test_a_window_lies_inside_the_data():
    d = states()
    assert select_time(d, 0.2, 0.4).sizes["time"] == 10
    assert select_time(d, 0.0, 1.2).sizes["time"] == 60
    with pytest.raises(
        OutOfRange, match=r"window 0.5 ... 9 s is not inside the data, 0 ... 1.18 s"
    ):
        select_time(d, 0.5, 9.0)


@pytest.mark.slow
def test_states_are_read_from_their_group(tmp_path):
    d = states()
    xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": "run"}), "/states": d}).to_netcdf(
        tmp_path / "path.nc", engine="h5netcdf"
    )
    d.to_netcdf(tmp_path / "flat.nc", engine="h5netcdf")
    xr.testing.assert_allclose(open_states(tmp_path / "path.nc"), d)
    xr.testing.assert_allclose(open_states(tmp_path / "flat.nc"), d)
    (tmp_path / "no.nc").write_text("nothing")
    with pytest.raises(ParseError, match="expected a path as"):
        open_states(tmp_path / "no.nc")


def test_smoothing_all_states_alike_removes_the_bias_that_noise_brings():
    """Roll rate and aileron nearly collinear and noisy: damping comes out 9 % low, with a common
    low-pass right within 2 %.
    """
    rng = np.random.default_rng(3)
    t = 0.02 * np.arange(6000)
    aileron = 0.05 * np.sign(np.sin(1.1 * t)) * (np.sin(0.37 * t) > 0)
    Cl_p, Cl_da, V, qbar = -0.44, -0.16, 90.0, 4000.0
    p, gain = np.zeros(6000), qbar * 16 * 10 / 11e3
    for k in range(
        5999
    ):  # explicit Euler, and p_dot of the same step: exact as a difference equation
        p[k + 1] = p[k] + 0.02 * gain * (Cl_p * p[k] * 10 / (2 * V) + Cl_da * aileron[k])
    p_dot = gain * (Cl_p * p * 10 / (2 * V) + Cl_da * aileron)
    clean = states(n=6000).assign(
        {k: ("time", np.zeros(6000)) for k in ("q", "r", "q_dot", "r_dot")}
    )
    clean = clean.assign(V=("time", np.full(6000, V)), qbar=("time", np.full(6000, qbar)))
    noisy = clean.assign(
        p=("time", p + 0.03 * rng.normal(size=6000)),
        p_dot=("time", p_dot + 0.1 * rng.normal(size=6000)),
        delta_a=("time", aileron + 0.004 * rng.normal(size=6000)),
    )
    model = RegressionModel.parse("Cl = 1 + phat + delta_a")
    raw, smooth = (
        regress(model, coefficients(noisy, plane(), cutoff=f))
        .estimates["estimate"]
        .sel(term="phat")
        for f in (None, 3.0)
    )
    assert float(raw) == pytest.approx(-0.40, abs=0.01)
    assert float(smooth) == pytest.approx(Cl_p, rel=0.02)


def test_smoothing_respects_gaps_and_switches():
    d = states(n=200)
    d["wow_nose"] = "time", np.r_[np.zeros(100), np.ones(100)]
    first, second = d.isel(time=slice(0, 100)), d.isel(time=slice(100, 200))
    second = second.assign_coords(time=second.time + 50)
    both = smooth_states(xr.concat([first, second], "time"), 5.0)
    np.testing.assert_allclose(
        both["q"],
        np.r_[smooth_states(first, 5.0)["q"], smooth_states(second, 5.0)["q"]],
        atol=1e-10,
    )
    assert float(both["q"].std()) < 0.7 * float(d["q"].std())
    np.testing.assert_array_equal(both["wow_nose"], d["wow_nose"])
    d["q"][90:110] = np.nan  # a dropout ends a stretch, it does not spread
    holes = smooth_states(d, 5.0)["q"].values
    np.testing.assert_array_equal(np.isnan(holes), np.isnan(d["q"].values))


def test_thrust_coefficient_is_a_regressor_and_moves_with_its_errors():
    engines = (engine(), engine((0.5, 0.8, 0.1)))
    d = states(**{"engine1.thrust": 3000.0, "engine2.thrust": 2000.0})
    c = coefficients(d, plane(engines))
    np.testing.assert_allclose(c.CT, 5000.0 / (d.qbar * 16.0), rtol=1e-14)
    change = c["CT_error"]
    np.testing.assert_allclose(
        change.sel(error="thrust1"), 0.02 * 3000.0 / (d.qbar * 16.0), rtol=1e-12
    )
    np.testing.assert_allclose(change.sel(error="qbar"), -0.01 * c.CT, rtol=1e-12)
    torque = c.assign(Cl=0.001 - 0.03 * c.CT)
    fit = regress(
        RegressionModel.parse("Cl = 1 + CT"),
        [torque.drop_vars([name for name in c if str(name).endswith("_error")])],
    )
    np.testing.assert_allclose(fit.estimates["estimate"], [0.001, -0.03], rtol=1e-9)
    assert "CT" not in coefficients(states(), plane())


@pytest.mark.parametrize("cutoff", [0.0, -2.0, np.nan, np.inf])
def test_a_low_pass_needs_a_frequency(cutoff):
    time = np.arange(50) / 50.0
    states = xr.Dataset(
        {"V": ("time", np.full(50, np.nan))}, {"time": time}
    )  # no sample: no filter would report it
    with pytest.raises(OutOfRange, match="it must be more than 0 Hz"):
        smooth_states(states, cutoff)
