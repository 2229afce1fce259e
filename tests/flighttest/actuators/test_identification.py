"""Actuators against simulated bench records: truth inside the standard errors, limits, dead time,
absolute values and ratios.

The records come from `examples/flapping_vehicle/actuator_bench.py`, which shares no code with the
identification.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "flapping_vehicle"))
import actuator_bench as bench

from flightmech.errors import IdentificationError, SchemaError, UnitError, UnknownName
from flighttest.cli.group import flight
from flighttest.submodels.actuators.identification import identify_actuator, read_bench_log
from flighttest.submodels.actuators.response import Structure, simulate_actuator

WITHIN = 4.0  # standard errors: a campaign in 16 000 is outside by chance
TRUE = {
    "natural_frequency": 40.0,
    "damping_ratio": 0.7,
    "gain": 0.0012,
    "offset": -1.8,
    "lag": 0.035,
}


@pytest.fixture(scope="module")
def servo():
    return identify_actuator(
        [bench.log(bench.SERVO, bench.Campaign(), seed) for seed in (1, 2)], held=True
    )


@pytest.fixture(scope="module")
def limited():
    return identify_actuator(
        [bench.log(bench.LIMITED, bench.Campaign(duration=6.0), seed) for seed in (1, 2)], held=True
    )


def apart(value, true, stderr):
    return abs(value - true) / stderr


@pytest.mark.slow
def test_a_servo_is_found_within_its_standard_errors_by_both_methods(servo):
    assert not servo.absolute
    assert not servo.reached
    true = {"Ca/Ma": 56.0, "Ka/Ma": 1600.0, "B/Ma": 1.92, "neutral": 1500.0, "delay": 0.018}
    assert set(servo.parameters) == set(true)
    for name, row in servo.table().iterrows():
        assert apart(row["time"], true[name], row["time_stderr"]) < WITHIN
        assert row["time_stderr"] < 0.01 * abs(true[name])
        if name != "neutral":
            assert apart(row["frequency"], true[name], row["frequency_stderr"]) < WITHIN
            assert not row["contradictory"]
    for name, value in servo.derived().items():
        assert apart(value.value, TRUE[name], value.stderr) < WITHIN
    assert servo.fit > 0.99


@pytest.mark.slow
def test_without_torque_only_ratios_are_found_and_a_known_inertia_makes_them_absolute(servo):
    assert any(remark.kind == "ratios" for remark in servo.remarks)
    found = servo.with_inertia(bench.SERVO.Ma, 0.01 * bench.SERVO.Ma)
    for name in ("Ma", "Ca", "Ka", "B"):
        assert apart(found[name].value, getattr(bench.SERVO, name), found[name].stderr) < WITHIN
        assert found[name].stderr >= 0.0099 * found[name].value
    with pytest.raises(IdentificationError, match="must be positive"):
        servo.with_inertia(0.0)


@pytest.mark.nightly
def test_limits_that_were_reached_are_found_and_the_spectra_contradict(limited):
    true = {
        "rate_limit": 5.5,
        "stop_low": -0.27,
        "stop_high": 0.30,
        "Ka/Ma": 1600.0,
        "delay": 0.018,
    }
    for name, value in true.items():
        assert apart(limited.parameters[name], value, limited.stderr[name]) < WITHIN
    assert set(limited.reached) == {"rate_limit", "stop_low", "stop_high"}
    assert limited.table().loc["Ka/Ma", "contradictory"]  # equation error knows no limit
    assert any(remark.kind == "scatter" and remark.term == "Ka/Ma" for remark in limited.remarks)


@pytest.mark.nightly
def test_a_record_of_the_command_gets_the_position_within_the_limits_found(limited, tmp_path):
    """A fixed-wing log has the command alone: the entry of its name map holds rate limit and stops,
    and the position follows the truth.
    """
    import flighttest

    entry = limited.channel("delta_e", "command")
    assert 'rate_limit = "5.' in entry
    assert 'stops = ["-0.2' in entry
    (tmp_path / "names.toml").write_text(f"[controls]\n{entry}\n", encoding="utf-8")
    without = entry.split(", rate_limit")[0] + " }"
    (tmp_path / "plain.toml").write_text(f"[controls]\n{without}\n", encoding="utf-8")
    flown = bench.log(bench.LIMITED, bench.Campaign(duration=6.0), 77)
    flown[["command"]].to_dataframe().reset_index().to_csv(tmp_path / "flight.csv", index=False)
    wrong = {}
    for names in ("names", "plain"):
        (leaf,) = flighttest.read(
            tmp_path / "flight.csv", tmp_path / f"{names}.toml"
        ).children.values()
        wrong[names] = float(
            np.sqrt(np.mean((leaf["delta_e"].values - flown["position"].values) ** 2))
            / flown["position"].std()
        )
    assert wrong["names"] < 0.1, wrong  # what a first-order lag leaves of a servo of second order
    assert wrong["plain"] > 2.0 * wrong["names"], wrong
    for text, error in (
        ('rate_limit = "-1 rad/s"', SchemaError),
        ('rate_limit = "3 m/s"', UnitError),
        ("stops = [0.3, -0.3]", SchemaError),
    ):
        (tmp_path / "bad.toml").write_text(
            f"[controls]\n{without[:-2]}, {text} }}\n", encoding="utf-8"
        )
        with pytest.raises(error):
            flighttest.read(tmp_path / "flight.csv", tmp_path / "bad.toml")
    (tmp_path / "bad.toml").write_text(
        '[controls]\ndelta_e = { column = "command", scale = "1 rad", lag = 0.1, rate_limit '
        "= 3.0 }\n",
        encoding="utf-8",
    )
    with pytest.raises(SchemaError, match="lag is negative or zero") as error:
        flighttest.read(tmp_path / "flight.csv", tmp_path / "bad.toml")
    assert error.value.problems[0].startswith("controls.delta_e: rate_limit and stops belong")


def test_limits_that_were_not_reached_are_bounded(servo):
    assert {remark.term for remark in servo.remarks if remark.kind == "limit"} == {
        "rate_limit",
        "stops",
    }


@pytest.mark.nightly
def test_with_a_torque_cell_coefficients_are_absolute():
    cell = bench.Campaign(speed=0.05, torque=1e-4, duration=6.0)
    found = identify_actuator(
        [bench.log(bench.SERVO, cell, seed) for seed in (1, 2)], held=True, limits=False
    )
    assert found.absolute
    for name in ("Ma", "Ca", "Ka", "B"):
        assert (
            apart(found.parameters[name], getattr(bench.SERVO, name), found.stderr[name]) < WITHIN
        )
    with pytest.raises(IdentificationError, match="absolute already"):
        found.with_inertia(1e-5)
    # noise of the cell moves all coefficients together: over 16 campaigns B scatters by 0.0006 of
    # itself without it, by 0.0014 with it
    quiet = replace(cell, torque=1e-6)
    still = identify_actuator(
        [bench.log(bench.SERVO, quiet, seed) for seed in (1, 2)], held=True, limits=False
    )
    assert found.stderr["B"] > 1.45 * still.stderr["B"]


@pytest.mark.slow
def test_the_gear_ratio_multiplies_the_torque():
    cell = bench.Campaign(speed=0.05, torque=1e-4, duration=6.0)
    log = bench.log(bench.SERVO, cell, 1)
    geared = log.assign(torque=log["torque"] / 5.0)
    plain, found = (
        identify_actuator(one, gear=gear, held=True, limits=False)
        for one, gear in ((log, 1.0), (geared, 5.0))
    )
    for name, value in plain.parameters.items():
        assert found.parameters[name] == pytest.approx(value, rel=1e-6)


@pytest.mark.nightly
def test_a_motor_is_found_from_its_rate():
    campaign = bench.Campaign(amplitude=0.3, position=None, speed=1.0)
    found = identify_actuator(
        [bench.log(bench.MOTOR, campaign, seed) for seed in (1, 2)], held=True, delay=False
    )
    assert apart(found.parameters["Ca/Ma"], 3.2, found.stderr["Ca/Ma"]) < WITHIN
    assert apart(found.parameters["B/Ma"], 200.0, found.stderr["B/Ma"]) < WITHIN
    with pytest.raises(IdentificationError, match="only a servo"):
        found.channel()


@pytest.mark.nightly
def test_a_jump_between_samples_is_in_the_error_of_the_dead_time(servo):
    loose = identify_actuator(list(servo.logs), limits=False)
    assert loose.stderr["delay"] > 0.004 / 12**0.5
    assert apart(loose.parameters["delay"], 0.018, loose.stderr["delay"]) < WITHIN


@pytest.mark.slow
def test_missing_readings_do_no_harm(servo):
    gappy = []
    for log in servo.logs:
        z = log["position"].values.copy()
        z[400:460] = np.nan
        gappy.append(log.assign(position=("time", z)))
    found = identify_actuator(gappy, held=True, limits=False)
    for name, value in servo.parameters.items():
        assert abs(found.parameters[name] - value) < servo.stderr[name]


@pytest.mark.nightly
def test_estimates_do_not_jump_with_the_last_digits(servo):
    moved = [log * (1.0 + 1e-12) for log in servo.logs]
    again = identify_actuator([log.assign_attrs(record="again") for log in moved], held=True)
    for name, value in servo.parameters.items():
        assert abs(again.parameters[name] - value) < 1e-3 * servo.stderr[name]


def test_the_simulation_agrees_with_the_script_it_does_not_share_code_with():
    quiet = bench.Campaign(duration=4.0, position=0.0)
    log = bench.log(bench.LIMITED, quiet, 5)
    values = {
        "Ca/Ma": 56.0,
        "Ka/Ma": 1600.0,
        "B/Ma": 1.92,
        "neutral": 1500.0,
        "delay": 0.018,
        "rate_limit": 5.5,
    }
    values |= {"stop_low": -0.27, "stop_high": 0.30, "init.position": float(log["position"][0])}
    y = simulate_actuator(
        log, Structure(rate_limit=True, stop_low=True, stop_high=True, held=True), values
    )["position"]
    assert (
        float(np.abs(y - log["position"]).max()) < 1.5e-3
    )  # steps of 2 ms at the limits: 0.1 degrees
    free = bench.log(bench.SERVO, quiet, 5)
    y = simulate_actuator(
        free, Structure(held=True), values | {"init.position": float(free["position"][0])}
    )["position"]
    assert float(np.abs(y - free["position"]).max()) < 1e-9


@pytest.mark.parametrize(
    ("drop", "words"),
    [
        (["position"], "a command alone contains no information"),
        (["command"], "no recorded command"),
    ],
)
def test_a_log_that_cannot_identify_is_refused_in_one_sentence(servo, drop, words):
    with pytest.raises(IdentificationError, match=words):
        identify_actuator(servo.logs[0].drop_vars(drop))


def test_a_motion_or_command_at_rest_is_refused(servo):
    still = servo.logs[0].assign(command=("time", np.full(servo.logs[0].sizes["time"], 1500.0)))
    with pytest.raises(IdentificationError, match="command does not move"):
        identify_actuator(still)
    with pytest.raises(IdentificationError, match="no log"):
        identify_actuator([])


@pytest.fixture(scope="module")
def csv(tmp_path_factory, servo):
    path = tmp_path_factory.mktemp("bench") / "servo.csv"
    table = servo.logs[0].to_dataframe().reset_index()
    table["angle"] = np.degrees(table["position"])
    table[["time", "command", "angle"]].to_csv(path, index=False)
    return path


def test_a_log_is_read_by_its_own_columns_and_units(csv, servo):
    log = read_bench_log(csv, {"position": "angle [deg]"})
    assert log["position"].attrs["units"] == "rad"
    xr.testing.assert_allclose(
        log[["command", "position"]].drop_attrs(),
        servo.logs[0][["command", "position"]].drop_attrs(),
    )
    with pytest.raises(UnknownName, match="near it: angle"):
        read_bench_log(csv, {"position": "angel"})


@pytest.mark.nightly
def test_the_verb_prints_an_entry_that_makes_the_position_of_the_command(csv, tmp_path, servo):
    import flighttest

    figure = tmp_path / "servo.png"
    words = [
        "actuator",
        str(csv),
        "--position",
        "angle [deg]",
        "--held",
        "--no-limits",
        "--channel",
        "delta_r",
        "--figure",
        str(figure),
    ]
    done = CliRunner().invoke(flight, words)
    assert done.exit_code == 0, done.output
    assert figure.stat().st_size > 10_000
    entry = next(line for line in done.output.splitlines() if line.startswith("delta_r = {"))
    names = tmp_path / "names.toml"
    names.write_text(f"[controls]\n{entry}\n", encoding="utf-8")
    (leaf,) = flighttest.read(csv, names).children.values()
    error = leaf["delta_r"].values - servo.logs[0]["position"].values
    # 10.3 %: a first-order lag for a servo of second order, and pulses far above the 2.1 Hz up to
    # which it holds
    assert np.sqrt(np.mean(error**2)) < 0.12 * float(servo.logs[0]["position"].std())
    as_json = CliRunner().invoke(flight, [*words[:6], "--json"])
    assert json.loads(as_json.output)["absolute"] is False


def test_the_verb_refuses_a_log_without_a_position(csv):
    done = CliRunner().invoke(flight, ["actuator", str(csv)])
    assert isinstance(done.exception, IdentificationError)
    assert "no recorded position" in str(done.exception)


@pytest.mark.slow
def test_slower_campaigns_find_the_same_servo():
    slow = replace(bench.Campaign(), rate=100.0, duration=12.0)
    found = identify_actuator(bench.log(bench.SERVO, slow, 9), held=True, limits=False)
    for name, value in found.derived().items():
        assert apart(value.value, TRUE[name], value.stderr) < WITHIN
