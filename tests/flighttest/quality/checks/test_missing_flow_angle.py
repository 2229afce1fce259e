"""Signs of surfaces in a record without flow angles: a delay must not take up the response to the
angle that is missing.
"""

import pytest

import flightmech
import flighttest
from aeromatch.cli.actions.examples import example_folder

C182 = example_folder("c182")


@pytest.fixture(scope="module")
def record():
    return flighttest.read(C182 / "flight" / "cruise.csv", C182 / "names.toml")


def findings(record, sign):
    """Return the names of the findings on surfaces of a record without vanes whose elevator is
    multiplied by `sign`.
    """
    changed = record.copy(deep=True)
    for leaf in changed.children.values():
        if "delta_e" in leaf:
            leaf["delta_e"].values[:] *= sign
    bare = changed.map_over_datasets(
        lambda data: data.drop_vars(["alpha_vane", "beta_vane"], errors="ignore")
    )
    quality = flighttest.assess(bare, flightmech.read_aircraft(C182 / "aircraft.toml"))
    return [
        finding.name
        for finding in quality.findings
        if finding.severity != "note" and "delta_e" in finding.channels
    ]


@pytest.mark.slow
def test_right_sign_is_sound(record):
    assert findings(record, 1.0) == []


@pytest.mark.nightly
def test_reversed_elevator_is_not_passed_in_silence(record):
    assert findings(record, -1.0) in (["sign:delta_e+q"], ["undecided:delta_e+q"])
