"""Exchanged surfaces, constant errors, lost samples and a wrong place of the accelerometers,
planted into a multisine of the T-37.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.control_response import EQUATIONS, control_responses
from flighttest.reconstruction.quality.checks.kinematic_consistency import kinematic_table
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import at_cg, resample_channels
from flighttest.reconstruction.quality.navigation.lever_arm import (
    _NEEDS,
    _fit_lever_arm,
    lever_arm_findings,
)
from flighttest.reconstruction.quality.recording.exchanged_surfaces import (
    SurfaceShares,
    _moves_other_axis,
    answers_not_checked,
    exchanged_findings,
)
from flighttest.reconstruction.quality.recording.lost_samples import (
    lost_not_checked,
    lost_samples,
)
from flighttest.reconstruction.quality.recording.offsets import (
    _slip_findings,
    gyro_offsets,
    offset_findings,
    slip_not_checked,
    without_constant_errors,
)
from flighttest.records.sensors.instruments import instruments_of

T37 = Path(__file__).parents[4] / "data" / "t37"
NO_FAULTS = pd.DataFrame(columns=["leaf", "channel", "kind", "start", "stop", "samples", "note"])


@pytest.fixture(scope="module")
def record():
    return flighttest.read(T37 / "flight" / "t37_10_multisine_clean_5kft.nc", T37 / "names.toml")


@pytest.fixture(scope="module")
def signals(record):
    return resample_channels(record, faults_of(record))


@pytest.fixture(scope="module")
def position(record):
    aircraft = flightmech.read_aircraft(T37 / "aircraft.toml")
    stated = instruments_of(aircraft, record.attrs).of("ax_imu").position
    return np.asarray(stated, float) - np.asarray(aircraft.cg, float)


def exchanged(signals, one, other):
    return signals.with_values({one: signals[other], other: signals[one]})


def test_surfaces_in_their_columns(signals, record):
    assert exchanged_findings(signals, record) == []
    assert answers_not_checked(control_responses(signals), signals) == []


@pytest.mark.parametrize(
    "pair", [("delta_e", "delta_a"), ("delta_e", "delta_r"), ("delta_a", "delta_r")]
)
def test_exchanged_surfaces_are_named(signals, record, pair):
    (finding,) = exchanged_findings(exchanged(signals, *pair), record)
    assert (finding.severity, finding.name) == ("error", f"axis:{'+'.join(pair)}")


def test_a_surface_that_moves_another_axis_only(signals, record):
    still = np.zeros_like(signals.time)
    one_sided = signals.with_values({"delta_e": signals["delta_a"], "delta_a": still})
    (finding,) = exchanged_findings(one_sided, record)
    assert (finding.severity, finding.channels[:2]) == ("warning", ("delta_e", "delta_a"))
    assert "pitch does not answer" in finding.text


def test_surface_at_rest_is_not_checked(signals):
    still = signals.with_values({"delta_r": np.zeros_like(signals.time)})
    rows = answers_not_checked(control_responses(still), still)
    assert [row[0] for row in rows] == ["answer_delta_r"]


@pytest.mark.parametrize("gyro", ["p", "q", "r"])
def test_constant_error_of_a_gyro(signals, gyro):
    assert gyro_offsets(signals) == {}
    biased = signals.with_values({gyro: signals[gyro] + 1.0 * DEGREE})
    offsets = gyro_offsets(biased)
    assert list(offsets) == [gyro]
    assert offsets[gyro][0] == pytest.approx(1.0 * DEGREE, abs=0.06 * DEGREE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channel", "error", "named"),
    [
        ("ay_imu", 1.5, "ay_imu"),
        ("theta", 3.0 * DEGREE, "theta"),
        ("alpha_vane", 4.0 * DEGREE, "alpha_vane"),
        ("beta_vane", 4.0 * DEGREE, "beta_vane"),
        ("phi", 3.0 * DEGREE, "ay_imu"),
        ("ax_imu", 0.6, "ax_imu"),
        ("az_imu", -0.8, "az_imu"),
    ],
)
def test_constant_error_of_a_channel(signals, record, position, channel, error, named):
    places = {"ax_imu": position}
    right = at_cg(signals, places)
    assert offset_findings(kinematic_table(right), right, record) == []
    wrong = at_cg(signals.with_values({channel: signals[channel] + error}), places)
    (finding,) = offset_findings(kinematic_table(wrong), wrong, record)
    assert finding.channels[0] == named
    assert channel in finding.channels
    # a tilted mounting shows the same error
    assert ("accelerometers are mounted" in finding.text) == (named in ("ax_imu", "ay_imu"))


def test_small_error_of_the_side_force_does_not_blame_the_vane(signals, record):
    """An error of ay below the limit moves the sideslip without force by more than 2.5 deg."""
    slow = signals.with_values({"ay_imu": 0.3 * signals["ay_imu"] + 0.3})
    assert _slip_findings(slow, record, 0.0)
    assert _slip_findings(slow, record, 0.3) == []


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_zero_of_the_vane_without_ground_velocity(signals, record, share):
    """Vane and side force are both named, also where little side force comes with sideslip."""
    alone = signals.without(("vn", "ve", "vd"))
    changes = {"ay_imu": share * alone["ay_imu"], "beta_vane": alone["beta_vane"]}
    right = alone.with_values(changes)
    assert offset_findings(kinematic_table(right), right, record) == []
    wrong = alone.with_values({**changes, "beta_vane": alone["beta_vane"] + 4.0 * DEGREE})
    (finding,) = offset_findings(kinematic_table(wrong), wrong, record)
    assert (finding.severity, finding.channels) == ("warning", ("beta_vane", "ay_imu"))
    assert finding.evidence["offset"] == pytest.approx(4.0 * DEGREE, abs=0.5 * DEGREE)
    assert "deg too high throughout" in finding.text
    assert ", or ay_imu" in finding.text
    assert "beta_vane = {" in finding.remedy
    assert "; or ay_imu = {" in finding.remedy


def test_error_of_the_side_force_hides_the_zero_of_the_vane(signals, record, position):
    places = {"ax_imu": position}
    right = at_cg(signals, places)
    assert slip_not_checked(kinematic_table(right), right) == []
    both = {
        "ay_imu": signals["ay_imu"] + 0.6,
        "beta_vane": signals["beta_vane"] + 6.0 * DEGREE,
    }
    wrong = at_cg(signals.with_values(both), places)
    table = kinematic_table(wrong)
    (finding,) = offset_findings(table, wrong, record)
    assert finding.channels == ("ay_imu", "phi")
    ((name, _, _, reason),) = slip_not_checked(table, wrong)
    assert name == "zero_of_beta_vane"
    assert "ay_imu reads 0.63 m/s2 too high" in reason
    assert "deg of the vane: no constant error of the vane is reported" in reason


def test_slope_shows_a_constant_error_or_a_scale_of_the_vertical_force(signals, record, position):
    def only_finding(az, **others):
        changes = {**others, "az_imu": az}
        wrong = at_cg(signals.with_values(changes), {"ax_imu": position})
        (finding,) = offset_findings(kinematic_table(wrong), wrong, record)
        return finding, without_constant_errors(wrong, [finding])["az_imu"]

    right = at_cg(signals, {"ax_imu": position})["az_imu"]
    scaled, corrected = only_finding(1.05 * signals["az_imu"])
    assert "az_imu reads 1.044 times the true value: its slope" in scaled.text
    assert "too low" not in scaled.text
    assert scaled.remedy.count("az_imu = {") == 1
    assert np.abs(corrected - right).max() < 0.1
    constant, corrected = only_finding(signals["az_imu"] + 1.0)
    assert "az_imu reads 1.06 m/s2 too high throughout: its slope" in constant.text
    assert "times the true value" not in constant.text
    assert constant.remedy.count("az_imu = {") == 1
    assert np.abs(corrected - right).max() < 0.1


@pytest.mark.parametrize(
    ("slope", "stderr", "reason"),
    [
        (1.0, 0.04, "which agrees with both"),
        (1.3, 0.04, "which agrees with neither alone"),
        (1.0, 0.06, "in 1 g a constant error and an error of scale are the same"),
        (None, None, "no ground velocity shows which of them"),
    ],
)
def test_vertical_force_whose_slope_shows_no_cause(
    signals, record, position, slope, stderr, reason
):
    wrong = at_cg(signals.with_values({"az_imu": signals["az_imu"] + 1.0}), {"ax_imu": position})
    table = kinematic_table(wrong).assign(slope=slope, slope_stderr=stderr)
    if slope is None:
        table = table[table["relation"] != "force_z"]
    (finding,) = offset_findings(table, wrong, record)
    assert "m/s2 too high throughout, or 0.8" in finding.text
    assert finding.remedy.count("az_imu = {") == 2
    assert finding.text.endswith(reason)


def test_surface_whose_axis_the_others_explain(signals):
    """A rudder that coordinates turns goes with the pitch rate."""
    shares = {
        "q": SurfaceShares({"delta_r": 0.3, "delta_e": 0.0}, {"delta_r": 20.0}, 0.93),
        "r": SurfaceShares({"delta_r": 0.0, "delta_e": 0.0}, {"delta_r": 0.0}, 0.5),
    }
    rudder, elevator = (next(e for e in EQUATIONS if e.rate == rate) for rate in "rq")
    assert _moves_other_axis(shares, rudder, elevator, signals)
    explained = {**shares, "r": SurfaceShares({"delta_r": 0.0}, {"delta_r": 0.0}, 0.99)}
    assert not _moves_other_axis(explained, rudder, elevator, signals)
    little = signals.with_values(
        {"delta_r": signals["delta_r"] * 1.14 * DEGREE / np.ptp(signals["delta_r"])}
    )
    assert not _moves_other_axis(shares, rudder, elevator, little)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_place_of_the_accelerometers(signals, position, axis):
    places = {"ax_imu": position}
    right = at_cg(signals, places)
    findings, ((_, _, _, reason),) = lever_arm_findings(right, places)
    assert findings == []
    limits = [float(limit) for limit in re.findall(r"[xyz] ([\d.]+) m", reason)]
    assert limits == pytest.approx([2.3, 1.3, 1.9])
    # an error of the stated size is reported in both directions
    for shift in (-limits[axis] * np.eye(3)[axis], limits[axis] * np.eye(3)[axis]):
        moved = at_cg(signals, {"ax_imu": position + shift})
        assert lever_arm_findings(moved, {"ax_imu": position + shift})[0]
    wrong = position + 2.0 * np.eye(3)[axis]
    moved = at_cg(signals, {"ax_imu": wrong})
    (finding,), ((_, _, _, reason),) = lever_arm_findings(moved, {"ax_imu": wrong})
    error = np.array(finding.evidence["position"]) - position
    assert np.all(np.abs(error) < 0.2)
    assert f"stated {wrong[axis]:.2f} m" in finding.text
    # the other axes remain as uncertain as before
    uncertain = re.findall(r"([xyz]) [\d.]+ m", reason)
    assert uncertain == [name for i, name in enumerate("xyz") if i != axis]


@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_late_ground_velocity_does_not_move_the_accelerometers(signals, position, delay):
    """In body axes the 0.15 s of this receiver are -0.56 m in x and 0.28 m in z."""
    late = {}
    for name in ("vn", "ve", "vd"):
        late[name] = np.interp(signals.time - delay, signals.time, signals[name])
    right = at_cg(signals.with_values(late), {"ax_imu": position})
    shift, stderr = _fit_lever_arm(right, right.mask(_NEEDS))
    assert np.all(np.abs(shift) < 0.15)
    assert np.all(np.abs(shift) < 2.0 * stderr)


def test_rates_at_rest_show_no_place(signals, position):
    still = signals.with_values(dict.fromkeys("pqr", np.zeros_like(signals.time)))
    findings, ((name, _, _, reason),) = lever_arm_findings(still, {"ax_imu": position})
    assert (findings, name) == ([], "imu_position")
    assert "does not show x and y and z to 0.5 m" in reason


def without(record, start, seconds):
    """Return a record that lost samples and counts its time on."""
    leaves = {"/": xr.Dataset(attrs=record.attrs)}
    for leaf, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values
        kept = np.flatnonzero((time < start) | (time >= start + seconds))
        leaves[f"/{leaf}"] = data.isel(time=kept).assign_coords(time=time[: len(kept)])
    return xr.DataTree.from_dict(leaves)


@pytest.mark.parametrize("seconds", [0.2, 1.0, 5.0])
def test_lost_samples_are_placed(record, seconds):
    assert lost_samples(record, NO_FAULTS)[0] == []
    findings, flags = lost_samples(without(record, 20.0, seconds), NO_FAULTS)
    assert findings
    assert all(finding.start == pytest.approx(20.0, abs=0.2) for finding in findings)
    assert {(finding.severity, finding.kind) for finding in findings} == {("error", "lost")}
    assert set(flags["kind"]) == {"lost"}


@pytest.mark.parametrize("less", [0, 1])
def test_channels_at_half_the_rate_can_show_lost_samples(record, less):
    """Half of their samples repeat the one before, give or take one by the length of the record."""
    parts = {"/": xr.Dataset(attrs=record.attrs)}
    for leaf, node in record.children.items():
        data = node.to_dataset()
        data = data.isel(time=slice(0, data.sizes["time"] - less))
        held = data.isel(time=np.arange(data.sizes["time"]) // 2 * 2)
        parts[f"/{leaf}"] = held.assign_coords(time=data["time"].values)
    ((_, _, _, reason),) = lost_not_checked(xr.DataTree.from_dict(parts))
    assert "cannot jump" not in reason


@pytest.mark.parametrize(
    ("leaves", "every", "start"), [(("gps",), 1, 15.0), (("air_data", "vanes"), 2, 12.5)]
)
def test_a_recorder_on_a_clock_of_its_own_loses_samples_alone(record, leaves, every, start):
    """The attitude of another clock does not jump at the loss; this does not show a correction."""
    parts = {"/": xr.Dataset(attrs=record.attrs)}
    short = without(record, start, 3.0)
    for leaf, node in record.children.items():
        source = short[leaf] if leaf in leaves else node
        data = source.to_dataset()
        parts[f"/{leaf}"] = data.isel(time=slice(None, None, every)) if leaf in leaves else data
    findings, flags = lost_samples(xr.DataTree.from_dict(parts), NO_FAULTS)
    assert [(finding.severity, finding.kind) for finding in findings] == [("error", "lost")]
    assert findings[0].start == pytest.approx(start, abs=0.3)
    assert "or their unit was corrected" in findings[0].text
    assert set(flags["kind"]) == {"lost"}


def with_channels(record, leaf, change):
    """Return a record with channels of a leaf changed: change(data) returns arrays by name."""
    leaves = {"/": xr.Dataset(attrs=record.attrs)}
    for name, node in record.children.items():
        data = node.to_dataset().copy()
        if name == leaf:
            for channel, values in change(data).items():
                data[channel] = ("time", values)
        leaves[f"/{name}"] = data
    return xr.DataTree.from_dict(leaves)


def after(data, instant):
    return (data["time"].values >= instant).astype(float)


def test_attitude_that_repeats_its_samples_loses_none(record):
    """An attitude of 5 Hz in a table of 50 Hz jumps at each new value."""

    def hold(data):
        latest = np.arange(data.sizes["time"]) // 10 * 10
        return {name: data[name].values[latest] for name in ("phi", "theta", "psi")}

    held = with_channels(record, "imu", hold)
    assert lost_samples(held, NO_FAULTS)[0] == []
    assert "phi, theta, psi cannot jump" in lost_not_checked(held)[0][3]
    assert "cannot jump" not in lost_not_checked(record)[0][3]


def test_a_correction_is_not_a_loss(record):
    """Lost samples move attitude and trajectory; a correction moves one of them."""

    def correct(data):
        shift = after(data, 20.0) * DEGREE
        return {"phi": data["phi"].values + shift, "theta": data["theta"].values + 0.5 * shift}

    (finding,), flags = lost_samples(with_channels(record, "imu", correct), NO_FAULTS)
    assert (finding.severity, finding.name) == ("warning", "correction:phi+theta")
    assert finding.text.endswith("height and speed do not: a correction of the navigation unit")
    assert set(flags["kind"]) == {"correction"}

    def locate(data):
        satellite = record["gps"].to_dataset()
        speed = {}
        for name, shift in (("vn", 1.0), ("ve", -1.0)):
            speed[name] = np.interp(data["time"], satellite["time"], satellite[name])
            speed[name] += shift * after(data, 20.0)
        return speed

    (finding,), _ = lost_samples(with_channels(record, "air_data", locate), NO_FAULTS)
    assert (finding.severity, finding.name) == ("warning", "correction:vn+ve")
    assert "vn, ve jump at t = 19.98 s, and the attitude does not" in finding.text
