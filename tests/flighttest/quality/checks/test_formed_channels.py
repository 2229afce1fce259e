"""Records with calibrated and no true airspeed: every relation is formed, mistakes of its sources
are named, the rest is listed.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flighttest
from flightmech.air import atmosphere, true_airspeed
from flighttest.reconstruction.quality.checks.formed_channels import form_channel, source_channels
from flighttest.reconstruction.quality.checks.relations import RELATIONS, not_checked
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.page import render_quality_page

C182 = Path(__file__).parents[4] / "data" / "c182"


def assessed(folder, *changes):
    """Return the assessment of the tutorial's record with lines of its name map replaced."""
    text = (C182 / "names.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "names.toml").write_text(text)
    return flighttest.assess(flighttest.read(C182 / "flight" / "cruise.csv", folder / "names.toml"))


def errors(quality):
    return [finding.name for finding in quality.findings if finding.severity == "error"]


@pytest.mark.slow
def test_sound_record_states_what_is_not_checked(tmp_path):
    quality = assessed(tmp_path)
    assert quality.verdict.startswith("sound")
    assert {"along", "turn", "pull", "heave", "vane", "slip", "track_n", "track_e"} <= set(
        quality.comparisons
    )
    unseen = quality.not_checked.set_index("relation")
    assert unseen.loc["airspeed", "missing"] == ("V",)
    assert unseen.loc["altitude", "reason"] == "not recorded: p_static"
    listed = set(unseen.index) | set(quality.comparisons)
    assert listed >= {relation.name for relation in RELATIONS}
    assert "h_baro_level" in listed
    assert "not checked:" in quality.report()
    assert {row["relation"] for row in quality.as_dict()["not_checked"]} == set(unseen.index)
    assert "Not checked" in render_quality_page(quality)


MISTAKES = {
    "CAS in m/s": (
        'V_cas = "CAS"',
        'V_cas = { column = "CAS", unit = "m/s" }',
        "unit:V_cas",
        'V_cas = { column = "CAS", unit = "kt" }',
    ),
    "alpha reversed": (
        'alpha_vane = "AOA"',
        'alpha_vane = { column = "AOA", sign = -1 }',
        "sign:alpha_vane",
        'alpha_vane = "AOA"',
    ),
    "height in m": (
        'h_baro = "Press Alt"',
        'h_baro = { column = "Press Alt", unit = "m" }',
        "unit:h_baro",
        'unit = "ft"',
    ),
    "OAT in K": (
        'temperature = "OAT"',
        'temperature = { column = "OAT", unit = "K" }',
        "unit:temperature",
        'unit = "degC"',
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    "case",
    [
        case if k < 2 else pytest.param(case, marks=pytest.mark.slow)
        for k, case in enumerate(MISTAKES)
    ],
)
def test_mistake_of_a_source_is_named(case, tmp_path):
    old, new, name, line = MISTAKES[case]
    quality = assessed(tmp_path, (old, new))
    assert errors(quality) == [name]
    assert line in quality.findings[0].remedy


def test_speed_is_that_of_the_air_data_computer():
    """V from V_cas, height and temperature against the function for single values; the standard
    atmosphere where no thermometer is.
    """
    V_cas, h_baro, temperature = (
        np.array([60.0, 120.0]),
        np.array([1000.0, 8000.0]),
        np.array([290.0, 250.0]),
    )
    recorded = {"V_cas": V_cas, "h_baro": h_baro, "temperature": temperature}
    p_static = np.array([89874.6, 35599.8])  # standard atmosphere, geopotential height
    np.testing.assert_allclose(
        form_channel("V", recorded), true_airspeed(V_cas, p_static, temperature), rtol=1e-5
    )
    assert source_channels("V", recorded) == ("V_cas", "h_baro", "temperature")
    without = {name: x for name, x in recorded.items() if name != "temperature"}
    np.testing.assert_allclose(
        form_channel("V", without),
        true_airspeed(V_cas, p_static, atmosphere(h_baro).temperature),
        rtol=1e-3,
    )
    assert source_channels("V", {"V_cas": V_cas}) == ()
    assert form_channel("V", {"V_cas": V_cas}) is None


def test_formed_speed_follows_its_sources():
    time = np.arange(0.0, 60.0, 0.05)
    values = {"V_cas": 80.0 + np.sin(time), "h_baro": 1000.0 + time, "q": np.sin(time)}
    good = {name: np.ones(len(time), bool) for name in values}
    good["h_baro"][:10] = False
    signals = ResampledChannels(time, values, good, np.ones(len(time), bool), 0.05)
    before = signals.completed(("V",))
    assert not before.good["V"][:10].any()
    assert (
        signals.with_values({"q": 2.0 * values["q"]}).completed(("V",))["V"] is before["V"]
    )  # not computed again
    twice = signals.with_values({"V_cas": 2.0 * values["V_cas"]}).completed(("V",))["V"]
    assert np.all(twice > 1.9 * before["V"])
    assert "V" not in signals
    short = replace(
        signals,
        values={**values, "hdot": np.cos(time)},
        good={**good, "hdot": np.zeros(len(time), bool)},
    )
    row = not_checked(short).set_index("relation").loc["climb_rate"]
    assert "0.0 s of flight" in row["reason"]
