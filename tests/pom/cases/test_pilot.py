"""The math pilot: his loops against closed forms, and what a case may demand of him."""

import numpy as np
import pytest

from flightmech.errors import SchemaError
from pom.cases.case import PomCase, driven_quantities, read_case
from pom.cases.pilot import Pilot, PilotLoop, shortest_error
from pom.replaying.run_remarks import pilot_activity_rows

STEP = 0.01
TIME = np.arange(0.0, 10.0 + STEP / 2, STEP)


def fly(loops, targets, derivative, start):
    """Fly x' = derivative(x, u) with the control held over each step, exactly as the child process
    of an FMU does.
    """
    pilot = Pilot(loops, TIME, targets)
    x = np.full(TIME.size, start)
    for k in range(TIME.size - 1):
        u = pilot.controls(k, {"phi": x[k]})
        x[k + 1] = x[k] + STEP * derivative(x[k], u["delta_a"])
    pilot.controls(TIME.size - 1, {"phi": x[-1]})
    return pilot, x


def test_a_gain_on_an_integrator_decays_with_its_own_rate():
    """phi' = -2 u, u = -gain e, e = target - phi: e decays with exp(-2 gain t), 10 ms steps within
    their first order.
    """
    pilot, phi = fly(
        [PilotLoop("delta_a", "phi", gain=-0.5, limit=1.0)],
        {"phi": np.zeros(TIME.size)},
        lambda x, u: -2.0 * u,
        0.2,
    )
    assert phi[100] == pytest.approx(0.2 * (1.0 - STEP) ** 100, rel=1e-12)
    assert pilot.moved["delta_a"][0] == pytest.approx(0.1)


def test_the_integral_takes_out_a_steady_disturbance_and_the_gain_does_not():
    target = {"phi": np.zeros(TIME.size)}
    _, alone = fly(
        [PilotLoop("delta_a", "phi", gain=-1.0, limit=1.0)],
        target,
        lambda x, u: -2.0 * u + 0.1,
        0.0,
    )
    _, both = fly(
        [PilotLoop("delta_a", "phi", gain=-1.0, integral=-1.0, limit=1.0)],
        target,
        lambda x, u: -2.0 * u + 0.1,
        0.0,
    )
    assert alone[-1] == pytest.approx(0.05, rel=1e-3)  # 0.1 / (2 * 1)
    assert abs(both[-1]) < 1e-3


def test_loops_on_one_control_add_up():
    pilot = Pilot(
        [PilotLoop("wheel", "phi", 2.0, 9.0), PilotLoop("wheel", "p", 3.0, 9.0)],
        TIME,
        {"phi": np.ones(TIME.size), "p": np.zeros(TIME.size)},
    )
    assert pilot.controls(0, {"phi": 0.5, "p": -0.1}) == {
        "wheel": pytest.approx(2.0 * 0.5 + 3.0 * 0.1)
    }
    assert pilot.channels == ["phi", "p"]


def test_at_the_limit_the_integral_stands_still():
    """Ten seconds at the limit leave nothing behind: the correction leaves the limit as soon as the
    error has turned.
    """
    far = np.where(TIME < 5.0, 1.0, 0.0)
    pilot, phi = fly(
        [PilotLoop("delta_a", "phi", gain=-0.1, integral=-1.0, limit=0.02)],
        {"phi": far},
        lambda x, u: -2.0 * u,
        0.0,
    )
    moved = pilot.moved["delta_a"]
    assert moved.min() == -0.02
    turned = int(np.flatnonzero(far - phi < 0.0)[0])
    assert turned == 500  # the target steps back there
    assert moved[turned] > -0.02


def test_the_error_of_a_heading_goes_the_short_way_round():
    assert shortest_error("psi", np.radians(359.0)) == pytest.approx(np.radians(-1.0))
    assert shortest_error("theta", np.radians(359.0)) == np.radians(359.0)
    assert np.isnan(shortest_error("psi", np.nan))


def test_activity_holds_size_share_at_the_limit_and_what_was_held():
    """Half a degree per degree of 0.3 and then of 0.1 rad, cut at 0.1 rad: at the limit in the
    first two of ten seconds.
    """
    loops = [PilotLoop("delta_a", "phi", -0.5, 0.1), PilotLoop("delta_a", "p", -1.0, 1.0)]
    flown = {"phi": np.where(TIME < 2.0, -0.3, 0.1), "p": np.zeros(TIME.size)}
    moved = {"delta_a": np.where(TIME < 2.0, -0.1, 0.05)}
    moved["delta_a"][-1] = np.nan  # the run ended there
    (row,) = pilot_activity_rows(
        "final", loops, TIME, moved, dict.fromkeys(flown, np.zeros(TIME.size)), flown
    )
    assert (row["run"], row["control"], row["largest"], row["at"]) == (
        "final",
        "delta_a",
        -0.1,
        0.0,
    )
    assert row["at_limit"] == pytest.approx(200 / 1000)
    assert row["rms"] == pytest.approx(np.sqrt(0.2 * 0.01 + 0.8 * 0.0025))
    assert row["held"].startswith("phi 9.24 deg rms, p 0 ")  # root of 0.2 * 0.3^2 + 0.8 * 0.1^2 rad
    assert (
        row["gains"] == "-0.5 deg/deg x phi, at most 5.73 deg; -1 deg/(deg/s) x p, at most 57.3 deg"
    )


PILOT = '[[drive.pilot]]\ncontrol = "{}"\nchannel = "{}"\ngain = "{}"\nlimit = "{}"\n'


def with_pilot(path, *loops, surfaces="pilot", engine="thrust"):
    text = path.read_text().replace(
        'engine = "thrust"', f'engine = "{engine}"\nsurfaces = "{surfaces}"'
    )
    path.write_text(text + "".join(PILOT.format(*loop) for loop in loops))
    return path


def test_gains_carry_units_and_the_case_survives_its_dictionary(write_case):
    case = read_case(
        with_pilot(
            write_case(),
            ("wheel", "phi", "0.5 deg/deg", "20 deg"),
            ("wheel", "p", "0.2 deg s/deg", "5 deg"),
        )
    )
    assert case.drive.pilot[0] == PilotLoop(
        "wheel", "phi", pytest.approx(0.5), pytest.approx(np.radians(20.0))
    )
    assert case.drive.pilot[1].gain == pytest.approx(0.2)
    assert case.drive.level == "cockpit"
    assert PomCase.from_dict(case.to_dict()) == case


def test_what_the_pilot_moves_is_no_longer_driven(write_case):
    """The control becomes the compared quantity (closed-loop practice); the others stay inputs."""
    case = read_case(with_pilot(write_case(), ("delta_a", "phi", "-0.3 deg/deg", "5 deg")))
    assert "delta_a" not in driven_quantities(case)
    assert {"delta_e", "delta_r", "engine1.thrust"} <= driven_quantities(case)


@pytest.mark.parametrize("channel", ["theta", "q", "nz", "az"])
def test_a_judged_channel_and_its_kin_are_forbidden(write_case, channel):
    gain = {"theta": "0.3 deg/deg", "q": "0.3 deg s/deg", "nz": "3 deg", "az": "0.3 deg s2/m"}[
        channel
    ]
    with pytest.raises(
        SchemaError,
        match=f"holds {channel}, on which .* is judged; a math pilot may not fly what is judged",
    ):
        read_case(with_pilot(write_case(), ("delta_e", channel, gain, "5 deg")))


@pytest.mark.parametrize(
    ("loop", "more", "text"),
    [
        (("delta_x", "phi", "1", "1"), {}, "unknown control 'delta_x'; near it: delta_"),
        (("delta_a", "phy", "1", "1"), {}, "unknown quantity 'phy'; near it: p"),
        (
            ("delta_a", "phi", "1 m/deg", "1 deg"),
            {},
            "drive.pilot.0.gain: unit 'm/deg' cannot be converted to 'rad/rad'",
        ),
        (("delta_a", "phi", "1 deg/deg", "0 deg"), {}, "limit: 0 is not positive"),
        (
            ("delta_a", "phi", "1 deg/deg", "1 deg"),
            {"surfaces": "recorded"},
            'loops and surfaces = "pilot" go together',
        ),
        (
            ("throttle", "V_cas", "2 %/kt", "30 %"),
            {},
            'a loop moves the throttle, but drive.engine is "thrust"',
        ),
    ],
)
def test_wrong_loops_are_refused(write_case, loop, more, text):
    with pytest.raises(SchemaError) as caught:
        read_case(with_pilot(write_case(), loop, **more))
    assert text in str(caught.value)


def test_one_level_of_drive_only(write_case):
    loops = ("delta_a", "phi", "1 deg/deg", "1 deg"), ("pedal", "psi", "1 cm/deg", "1 cm")
    with pytest.raises(SchemaError, match=r"controls of 2 levels \(cockpit, recorded\)"):
        read_case(with_pilot(write_case(), *loops))
