"""Airspeeds as measured channels, place of the pitot tube, constant temperature, vertical wind;
records with faults.
"""

import numpy as np
import pytest
import xarray as xr
from inertial_reference import BOOM, DEGREE, aircraft, fly
from scipy.signal import lfilter

import flighttest
from flightmech.errors import OutOfRange, SchemaError
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.problem.readings import linearise_sensor, states_and_rates

SPAN = 24.0  # s


def rms(path, truth, name):
    known = truth[name].interp(time=path.states["time"])
    return float(np.sqrt(np.mean((path.states[name] - known) ** 2)))


def normalised(path, error):
    """Return the deviations of the constants from the truth over their standard errors."""
    found = path.biases
    names = [name for name in found["parameter"].values if name in error]
    estimate, stderr = (found[key].sel(parameter=names).values for key in ("estimate", "stderr"))
    return dict(zip(names, (estimate - [error[name] for name in names]) / stderr))


def constant(path, name):
    row = path.biases.sel(parameter=name)
    return float(row["estimate"]), float(row["stderr"])


def without(record, leaf, *names):
    return record.assign({leaf: xr.DataTree(record[leaf].to_dataset().drop_vars(names))})


def assembled(record, plane, rate=50.0):
    return assemble_problem(record, plane, [(0.0, SPAN)], rate=rate)


@pytest.mark.nightly
@pytest.mark.parametrize("speed", ["V", "V_cas", "mach"])
def test_airspeed_is_a_channel_with_noise_factor_and_bias(speed):
    record, error, truth = fly(3, SPAN, speed)
    path = flighttest.reconstruct(record, aircraft(speed))
    # four standard errors of a path whose constants are known to 0.003 deg and 0.005 m/s
    assert rms(path, truth, "V") < 0.02
    assert max(rms(path, truth, "alpha"), rms(path, truth, "beta")) < 0.006 * DEGREE
    z = normalised(path, error)
    assert {f"factor.{speed}", f"bias.{speed}"} < z.keys()
    assert max(map(abs, z.values())) < 3.5  # 15 deviations: one in 140 records has a larger one
    assert path.states.attrs["gusts"] == "none"
    assert "p_static" not in path.fit.index


@pytest.mark.slow
def test_pressures_go_before_airspeeds():
    record, _, _ = fly(3, SPAN, "q_c")
    clock = record["pitot"].to_dataset()
    more = record.assign(
        {"pitot": xr.DataTree(clock.assign(V=("time", np.full(clock.sizes["time"], 90.0))))}
    )
    path = flighttest.reconstruct(more, aircraft("q_c", adc={"noise": {"V": 0.05}}))
    assert "V" not in path.fit.index
    assert {"q_c", "p_static"} <= set(path.fit.index)
    assert path.states.attrs["unused"] == ""  # V shows the same as q_c


@pytest.mark.nightly
def test_place_of_the_pitot_is_part_of_the_output():
    record, error, _ = fly(1, 60.0)
    at, away = (
        normalised(flighttest.reconstruct(record, aircraft(placed=known)), error)
        for known in (True, False)
    )
    # 0.4 m off the centre line a roll and a turn show 0.1 m/s, twice the noise of a reading
    assert max(abs(at["wind_n"]), abs(at["wind_e"])) < 3.0
    assert max(abs(away["wind_n"]), abs(away["wind_e"])) > 4.0


@pytest.mark.slow
def test_vanes_at_places_of_their_own():
    record, error, truth = fly(3, SPAN)
    plane = aircraft()
    table = plane.instruments.pop("vanes")
    for name, far in (("alpha_vane", 0.0), ("beta_vane", 1.5)):
        parts = {key: {name: table[key][name]} for key in ("noise", "bias_sigma", "factor")}
        plane.instruments[name] = {
            **parts,
            "position": list(BOOM + [far, 0.0, 0.0]),
            "lag": table["lag"],
        }
    assert assembled(record, plane).problem.vane_arms.tolist() == [
        list(BOOM),
        list(BOOM + [1.5, 0.0, 0.0]),
    ]
    moved = np.cross([0.0, 0.0, 1.0], [1.5, 0.0, 0.0])[1]  # a yaw rate adds r x to v at the vane
    vanes, shift = (
        record["vanes"].to_dataset(),
        moved * record["irs"]["r"].values / truth["V"].values,
    )
    record = record.assign(
        {
            "vanes": xr.DataTree(
                vanes.assign(beta_vane=vanes["beta_vane"] + error["factor.beta_vane"] * shift)
            )
        }
    )
    assert rms(flighttest.reconstruct(record, plane), truth, "beta") < 0.01 * DEGREE


@pytest.mark.nightly
@pytest.mark.parametrize("speed", ["V", "V_cas", "mach", "q_c"])
def test_derivatives_of_the_air_data_follow_central_differences(speed):
    record, error, _ = fly(2, SPAN, speed)
    plane = aircraft(
        speed,
        pitot={"delay": [0.05, 0.02]},
        irs={"scale_sigma": {"p": 1e-3, "r": 1e-3}},
        thermometer={"noise": {"temperature": 0.02}},
    )
    plane.instruments["thermometer"]["bias_sigma"] = {"temperature": 0.5}
    setup = assembled(record, plane, rate=25.0)
    problem, names = setup.problem, setup.problem.constants.names
    sensor = next(s for s in problem.sensors if speed in s.names)
    c = np.array([error.get(name, value) for name, value in zip(names, setup.c)])
    c[names.index("delay.pitot")] = 0.047
    _, _, _, J, columns, Jc = linearise_sensor(
        problem, sensor, states_and_rates(problem, setup.x, c), c
    )
    for j, place in enumerate(columns):
        h = 1e-2 * np.sqrt(problem.constants.covariance[place, place])
        sides = [c + sign * h * np.eye(len(c))[place] for sign in (1.0, -1.0)]
        ends = [
            linearise_sensor(problem, sensor, states_and_rates(problem, setup.x, side), side)[0]
            for side in sides
        ]
        np.testing.assert_allclose(
            Jc[..., j],
            (ends[0] - ends[1]) / (2.0 * h),
            rtol=1e-4,
            atol=1e-4 * np.abs(Jc[..., j]).max() + 1e-12,
        )
    for i in range(problem.states):
        h = 1e-4
        sides = [setup.x + sign * h * np.eye(problem.states)[i] for sign in (1.0, -1.0)]
        ends = [
            linearise_sensor(problem, sensor, states_and_rates(problem, side, c), c)[0]
            for side in sides
        ]
        np.testing.assert_allclose(
            J[..., i], (ends[0] - ends[1]) / (2.0 * h), rtol=1e-4, atol=1e-6 * np.abs(J).max()
        )
    assert {"bias.p", "bias.r", "scale.r", "delay.pitot", "wind_e"} <= {names[i] for i in columns}


@pytest.mark.nightly
def test_vertical_wind_has_the_prior_that_the_record_states():
    record, error, _ = fly(3, SPAN, given={"wind_d": 10.0})
    plane = aircraft()
    narrow = flighttest.reconstruct(record, plane)
    record.attrs["wind_down_sigma"] = 5.0
    wide = flighttest.reconstruct(record, plane)
    assert abs(normalised(wide, error)["wind_d"]) < 3.0
    assert constant(wide, "wind_d")[0] == pytest.approx(10.0, abs=0.05)
    assert "wind_d contradicts its prior" in narrow.report()
    assert "wind_down_sigma" in narrow.report()
    assert "contradicts" not in wide.report()


@pytest.mark.slow
def test_constant_outside_temperature():
    record, _, truth = fly(3, SPAN, "mach")
    record = without(record, "pitot", "temperature")
    with pytest.raises(
        SchemaError,
        match=r"no channel temperature; record it, or state a constant one: \[record\] "
        r'temperature = "12 degC"',
    ):
        flighttest.reconstruct(record, aircraft("mach"))
    record.attrs["temperature"] = 275.15
    path = flighttest.reconstruct(record, aircraft("mach"))
    assert float(path.states["temperature"].mean()) == pytest.approx(275.15)
    # 150 m of height are 1 K and 0.2 % of the speed of sound; the factor takes its mean
    assert rms(path, truth, "V") < 0.2


def test_facts_of_a_name_map(tmp_path):
    (tmp_path / "names.toml").write_text(
        '[record]\ntemperature = "-8 degC"\nwind_down_sigma = "3 m/s"\n[adc]\nV = { column = '
        '"tas", unit = "kt" }\n'
    )
    (tmp_path / "flight.csv").write_text(
        "time,tas\n" + "".join(f"{0.1 * i},{150 + i % 3}\n" for i in range(50))
    )
    record = flighttest.read(tmp_path / "flight.csv", tmp_path / "names.toml")
    assert record.attrs["temperature"] == pytest.approx(265.15)
    assert record.attrs["wind_down_sigma"] == 3.0


@pytest.mark.nightly
def test_rate_of_the_earth_in_the_gyros():
    record, error, truth = fly(3, SPAN, facts={"latitude": 0.8})
    known = normalised(flighttest.reconstruct(record, aircraft(irs={"earth_rate": True})), error)
    assert max(map(abs, known.values())) < 3.5
    # 7e-5 rad/s turn with the heading and are not bias then
    assert abs(normalised(flighttest.reconstruct(record, aircraft()), error)["bias.q"]) > 20.0
    batch = flighttest.reconstruct_batch([record], aircraft(irs={"earth_rate": True}), rate=50.0)
    assert rms(batch.paths[0], truth, "beta") < 0.01 * DEGREE
    del record.attrs["latitude"]
    with pytest.raises(SchemaError, match="no latitude, but the gyros show the rate of the Earth"):
        flighttest.reconstruct(record, aircraft(irs={"earth_rate": True}))


# --- what a specification or a record may not be


def test_several_airspeeds_are_one_reading():
    record, _, _ = fly(3, SPAN, "V")
    pitot = record["pitot"].to_dataset()
    record = record.assign({"pitot": xr.DataTree(pitot.assign(mach=pitot["V"] / 330.0))})
    with pytest.raises(SchemaError, match="noise of V and mach: one pitot tube shows all of them"):
        flighttest.reconstruct(record, aircraft("V", adc={"noise": {"mach": 0.001}}))


def test_a_latitude_in_degrees_in_the_attributes_of_a_record():
    record, _, _ = fly(3, SPAN, "V")
    record.attrs["latitude"] = 48.0
    with pytest.raises(OutOfRange, match="latitude 48 rad is 2750"):
        flighttest.reconstruct(record, aircraft("V"))


def test_airspeed_without_noise():
    record, _, _ = fly(3, SPAN)
    plane = aircraft()
    del plane.instruments["pitot"]
    with pytest.raises(SchemaError, match="V recorded, but no instrument gives its noise"):
        flighttest.reconstruct(record, plane)


def test_factor_of_a_pressure():
    with pytest.raises(SchemaError, match="not for q_c; give q_c a static_error"):
        flighttest.reconstruct(
            fly(3, SPAN, "q_c")[0], aircraft("q_c", pitot={"factor": {"q_c": [1.0, 0.02]}})
        )


def test_factor_without_noise_and_earth_rate_with_the_gyros():
    plane = aircraft(navigation={"factor": {"mach": [1.0, 0.02]}, "earth_rate": True})
    with pytest.raises(SchemaError) as caught:
        flighttest.reconstruct(fly(3, SPAN)[0], plane)
    assert "navigation: factor of mach without its noise" in str(caught.value)
    assert (
        "navigation: earth_rate belongs to the instrument that gives the noise of p, q and r"
        in str(caught.value)
    )


def test_no_static_pressure_and_no_height():
    record = without(fly(3, SPAN)[0], "navigation", "h_gps")
    with pytest.raises(SchemaError, match="no channel p_static; give p_static, h_baro or h_gps"):
        flighttest.reconstruct(record, aircraft())


# --- airspeed only, spikes, gaps, no excitation


@pytest.mark.slow
def test_airspeed_and_height_alone():
    """No vanes, no ground velocity, no compass: the path through the air remains, alpha by theta
    less the climb.
    """
    record, _, truth = fly(5, SPAN, given={"factor.V": 1.0, "bias.V": 0.0, "wind_d": 0.0})
    pitot = record["pitot"].to_dataset()
    noise = np.random.default_rng(1).normal(0.0, 0.5, pitot.sizes["time"])
    record = record.drop_nodes(["vanes", "navigation"])
    record = without(record, "irs", "psi").assign(
        {"pitot": xr.DataTree(pitot.assign(h_baro=("time", truth["h"].values + noise)))}
    )
    plane = aircraft(pitot={"bias_sigma": {}, "factor": {}}, baro={"noise": {"p_static": 6.0}})
    path = flighttest.reconstruct(record, plane)
    assert "wind_n" not in path.biases["parameter"]
    assert rms(path, truth, "V") < 0.03
    assert rms(path, truth, "alpha") < 0.2 * DEGREE  # prior of the vertical wind over V is 0.12 deg
    assert (
        np.corrcoef(path.states["alpha"], truth["alpha"].interp(time=path.states["time"]))[0, 1]
        > 0.99
    )


@pytest.mark.nightly
def test_spikes_are_left_out_and_reported():
    record, error, truth = fly(4, SPAN)
    clean = flighttest.reconstruct(record, aircraft())
    wild = record.copy(deep=True)
    for leaf, name, size in (
        ("pitot", "V", 30.0),
        ("vanes", "alpha_vane", -0.4),
        ("navigation", "vn", 25.0),
        ("irs", "phi", 0.7),
    ):
        wild[leaf][name].values[[700, 1503]] += size
    path = flighttest.reconstruct(wild, aircraft())
    assert "V: 2 samples are spikes, first at 7 s; left out" in path.report()
    assert path.states.attrs["spikes"].count("left out") == 4
    assert path.states.attrs["gusts"] == "none"
    # 8 readings fewer of 30 000
    change = np.array(list(normalised(path, error).values())) - list(
        normalised(clean, error).values()
    )
    assert np.abs(change).max() < 0.5
    assert rms(path, truth, "alpha") < 0.006 * DEGREE
    assert clean.states.attrs["spikes"] == ""


def test_spike_of_a_gyro_is_named():
    record = fly(4, SPAN)[0].copy(deep=True)
    record["irs"]["q"].values[1000] += 0.5
    setup = assembled(record, aircraft())
    assert setup.spikes == (
        "q: 1 samples are spikes, first at 10 s; the path goes through them; choose windows "
        "without them",
    )


@pytest.mark.slow
def test_gaps_of_the_receiver_and_of_the_pitot():
    record, error, truth = fly(4, SPAN)
    gappy = {name: record[name].to_dataset() for name in ("navigation", "pitot")}
    times = {"navigation": (8.0, 13.0), "pitot": (15.0, 18.0)}
    parts = {
        name: data.isel(time=(data["time"] < times[name][0]) | (data["time"] > times[name][1]))
        for name, data in gappy.items()
    }
    path = flighttest.reconstruct(
        record.assign({name: xr.DataTree(data) for name, data in parts.items()}), aircraft()
    )
    assert rms(path, truth, "V") < 0.03
    assert max(rms(path, truth, "alpha"), rms(path, truth, "beta")) < 0.01 * DEGREE
    assert max(map(abs, normalised(path, error).values())) < 3.5
    assert int(path.fit["readings"]["vn"]) == 1900  # 24 s less 5


def test_readings_that_are_missing_are_named():
    record = fly(4, SPAN)[0].copy(deep=True)
    record["pitot"]["V"].values[1200:1205] = np.nan
    with pytest.raises(SchemaError, match=r"pitot/V: 5 NaN samples, first at 12 s"):
        flighttest.reconstruct(record, aircraft())


def test_window_too_short():
    with pytest.raises(
        OutOfRange, match="a window holds 6 samples at 50 Hz; at least 10 are needed"
    ):
        flighttest.reconstruct(fly(4, SPAN)[0], aircraft(), windows=[(3.0, 3.1)])


@pytest.mark.nightly
def test_unexcited_record_reports_what_rests_on_its_prior():
    record, error, _ = fly(6, SPAN, given={"excitation": 0.003})
    path = flighttest.reconstruct(record, aircraft())
    words = path.report()
    for name in ("factor.alpha_vane", "factor.beta_vane", "bias.V", "wind_d"):
        assert f"{name} rests on its prior" in words
    assert "contradicts its prior" not in words
    # a lag equation with a freedom of a tenth of the noise of the vanes took the factors for 2.2,
    # 6.6 standard errors off
    assert max(map(abs, normalised(path, error).values())) < 3.5
    assert (
        "factor.alpha_vane rests on its prior"
        not in flighttest.reconstruct(fly(6, SPAN)[0], aircraft()).report()
    )


# --- the near-perfect inertial reference


@pytest.mark.nightly
@pytest.mark.slow
def test_near_perfect_inertial_reference():
    """Five records of 60 s at 100 Hz; then more for the coverage."""
    z = []
    for seed in range(20):
        record, error, truth = fly(seed)
        path = flighttest.reconstruct(record, aircraft(), rate=100.0)
        assert path.states.attrs["gusts"] == "none"
        assert max(rms(path, truth, "alpha"), rms(path, truth, "beta")) < 0.012 * DEGREE
        assert rms(path, truth, "V") < 0.03
        z.append(list(normalised(path, error).values()))
    z = np.array(z)
    assert z.shape == (20, 15)
    assert (np.abs(z[:5]) < 2.0).mean() >= 0.8
    # 300 deviations, correlated within a flight: 95.4 % of normal ones, scatter of the count 1.2 to
    # 2 %
    assert (np.abs(z) < 2.0).mean() > 0.90
    assert np.abs(z.mean(axis=0)).max() < 3.5 / np.sqrt(20.0)  # no constant is biased


@pytest.mark.nightly
@pytest.mark.parametrize("speed", ["V", "V_cas", "mach"])
def test_gusts_with_an_airspeed_channel(speed):
    record, error, truth = fly(3, 40.0, speed)
    rng, clock = np.random.default_rng(9), truth["time"].values
    keep = np.exp(-0.01 / 1.5)
    gust = lfilter(
        [1.0], [1.0, -keep], rng.normal(0.0, 0.8 * np.sqrt(1.0 - keep**2), (2, len(clock)))
    )
    slope = {"V": 1.0, "mach": 1.0 / 332.5, "V_cas": 0.905}[speed]
    for leaf, name, add in (
        ("pitot", speed, gust[0] * slope),
        ("vanes", "alpha_vane", gust[1] / truth["V"].values),
    ):
        data = record[leaf].to_dataset()
        record = record.assign(
            {leaf: xr.DataTree(data.assign({name: data[name] + error[f"factor.{name}"] * add}))}
        )
    path = flighttest.reconstruct(record, aircraft(speed))
    along, _, down = map(float, path.states.attrs["gusts"].split())
    assert 0.3 < along < 1.2  # the two horizontal components share the level: 0.8/sqrt(2)
    assert 0.5 < down < 1.2
    assert bool(path.biases["held"].sel(parameter="factor.alpha_vane"))
    assert not bool(path.biases["held"].sel(parameter=f"factor.{speed}"))
