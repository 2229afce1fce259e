"""Records of a draft that give the thrust of the engines, and drives that a case can use."""

import numpy as np
import pytest
import xarray as xr

from aeromatch.cli.actions.examples import example_folder
from aeromatch.drafting.power import RecordedPower, describe_power, recorded_power

GOVERNED = (example_folder("c182") / "aircraft.toml").read_text(encoding="utf-8")
BARE = "[[engine]]\nposition = [0.0, 0.0, 0.0]\n"
JET = BARE + "thrust = { throttle = [0.0, 1.0], value = [100.0, 2000.0] }\n"
FIXED = BARE + (
    "[engine.propeller]\ndiameter = 1.9\ninertia = 2.3\nrpm_high = 280.0\n"
    "tables.CT_prop = { J = [0.0, 0.6, 1.2], value = [0.1, 0.05, -0.02] }\n"
    "tables.CP_prop = { J = [0.0, 0.6, 1.2], value = [0.06, 0.045, -0.01] }\n"
    'tables.shaft_power = "80 kW"\n'
)
# A value of each channel of engine 1. [SI]
VALUES = {"rpm": 240.0, "manifold_pressure": 80e3, "torque": 300.0, "throttle": 0.7, "thrust": 1e3}


def record(*names):
    leaf = {}
    for name in names:
        leaf[f"engine1.{name}"] = ("time", np.full(3, VALUES[name]))
    return xr.DataTree.from_dict({"engine": xr.Dataset(leaf)})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aircraft", "names", "has_thrust", "is_driven"),
    [
        (BARE, ("rpm", "manifold_pressure", "throttle"), False, False),
        (BARE, ("thrust",), True, True),
        (JET, ("throttle",), False, True),
        (GOVERNED, ("rpm", "manifold_pressure"), True, True),
        (GOVERNED, ("rpm", "torque"), True, True),
        (GOVERNED, ("rpm", "throttle"), False, True),
        (GOVERNED, ("rpm",), False, False),
        (GOVERNED, ("manifold_pressure",), False, True),
        (FIXED, ("rpm", "throttle"), True, True),
        # A file with faults elsewhere, and one with a fault in the engine.
        ('mass = "?"\n' + BARE, ("rpm",), False, False),
        (BARE.replace("0.0", '"?"'), ("rpm",), True, True),
    ],
)
def test_what_a_record_gives_depends_on_the_engine(
    tmp_path, aircraft, names, has_thrust, is_driven
):
    file = tmp_path / "aircraft.toml"
    file.write_text(aircraft, encoding="utf-8")
    power = recorded_power(file, {"a": record(*names)})
    assert power.no_thrust == (() if has_thrust else ("a",))
    assert power.undriven == (() if is_driven else ("a",))


def test_a_channel_without_samples_is_not_recorded(tmp_path):
    (tmp_path / "aircraft.toml").write_text(BARE)
    leaf = xr.Dataset({"engine1.thrust": ("time", [np.nan, np.nan])})
    power = recorded_power(
        tmp_path / "aircraft.toml", {"a": xr.DataTree.from_dict({"engine": leaf})}
    )
    assert power.no_thrust == ("a",)


def test_the_remark_states_the_role_of_each_record():
    drives = frozenset({"throttle"})
    both = describe_power(RecordedPower(drives, ("a", "b", "c"), ("a", "b")))
    assert "a, b neither identify nor prove: give each [[engine]]" in both[0]
    assert "so c identifies nothing" in both[1]
    assert "a jet whose N1 is recorded: give each [[engine]] an [engine.deck]" in both[0]
    assert "or map engine1.thrust to the column of N1" in both[0]
    assert describe_power(RecordedPower(drives)) == []
    assert describe_power(RecordedPower()) == []
    (glider,) = describe_power(RecordedPower(frozenset()))
    assert glider.startswith("aircraft.toml has no [[engine]]")
