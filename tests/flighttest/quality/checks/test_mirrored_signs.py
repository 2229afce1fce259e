"""Signs that are wrong together: an angle with its rate, and half of the lateral channels."""

from pathlib import Path

import pytest

import flighttest
from flighttest.reconstruction.quality.checks.mistake_search import find_mistakes
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import resample_channels

DATA = Path(__file__).parents[4] / "data"
CRUISE = (DATA / "c182" / "flight" / "cruise.csv", DATA / "c182" / "names.toml")
ROLL = (DATA / "t37" / "flight" / "t37_22_val_roll_response_clean.nc", DATA / "t37" / "names.toml")
PHUGOID = (DATA / "t37" / "flight" / "t37_26_val_phugoid.nc", DATA / "t37" / "names.toml")


def mistakes_of(files, reverse):
    """Return the channels of each mistake, and of its alternatives, in a record with wrong
    signs.
    """
    record = flighttest.read(*files)
    signals = resample_channels(record, faults_of(record))
    signals = signals.with_values({name: -signals[name] for name in reverse})
    explanations, _, checks = find_mistakes(signals)
    assert all(check.consistent for check in checks.values())
    found = []
    for explanation in explanations:
        assert explanation.repair.kind == "sign"
        others = [repair.channels for repair in explanation.instead]
        found.append((explanation.repair.channels, others))
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("pair", [("phi", "p"), ("theta", "q"), ("psi", "r")])
def test_an_angle_and_its_rate_are_one_mistake(pair):
    """Before, the search blamed ay_imu, alpha_vane, vn or ve for some of these."""
    assert mistakes_of(CRUISE, pair) == [(pair, [])]


@pytest.mark.slow
def test_one_sign_is_still_one_sign():
    assert mistakes_of(ROLL, ["p"]) == [(("p",), [])]


@pytest.mark.nightly
def test_a_record_that_does_not_turn_gives_the_other_explanations_too():
    """A phugoid has no turn: heading, east velocity, or heading with its rate, are equal in it."""
    (found,) = mistakes_of(PHUGOID, ["vn", "ve"])
    channels, others = found
    assert {channels, *others} == {("psi", "r"), ("psi",), ("ve",)}


@pytest.mark.nightly
def test_half_of_a_mirrored_flight_may_be_the_other_half():
    """One source with four wrong signs is likelier than three sources with one each."""
    lateral, others = ("phi", "p", "psi", "r"), ("ve", "ay_imu", "beta_vane")
    assert mistakes_of(ROLL, lateral) == [(lateral, [others])]


@pytest.mark.nightly
@pytest.mark.parametrize(
    "channels",
    [
        ("q", "r", "ay_imu", "az_imu"),
        ("theta", "q", "psi", "r", "ay_imu", "az_imu"),
        ("p", "r", "ax_imu", "az_imu"),
    ],
)
def test_other_body_axes_are_one_mistake(channels):
    """Before, the search blamed ve, phi, p and beta_vane for the signs of axes to the left."""
    assert mistakes_of(ROLL, channels) == [(channels, [])]
