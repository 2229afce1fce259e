"""The engine of the T-37 identified inside the whole job, from a few cut records, in the place of
its deck file.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import flightmech
import flighttest
from aeromatch.project.project import read_project
from aeromatch.project.sections import Controls
from aeromatch.workflow import steps
from aeromatch.workflow.steps import perform_match
from flightmech.support.console import timed_step
from flighttest.records.signals.conditioning import cut
from flighttest.submodels.engine.bench import fly_deck
from flighttest.submodels.engine.records import engine_channels

DATA = Path(__file__).parents[2] / "data" / "t37"
RECORDS = (
    "t37_02_clean_cruise_5kft",
    "t37_05_clean_cruise_20kft",
    "t37_08_flaps_full_gear_down_3kft",
)
SECTION = """
[engine]
engines = [1, 2]
rate = 10.0
structure = "engine.toml"

[[engine.flights]]
records = ["t37_02_clean_cruise_5kft"]
window = [[118.0, 190.0], [192.0, 236.0]]

[[engine.flights]]
records = ["t37_05_clean_cruise_20kft"]
window = [[130.0, 246.0]]

[[engine.flights]]
records = ["t37_08_flaps_full_gear_down_3kft"]
window = [[108.0, 222.0]]
"""


@pytest.mark.slow
@pytest.mark.nightly  # the demo identifies an engine, too
@pytest.mark.filterwarnings("ignore:flaps. D.CM. comes from a loop")
@pytest.mark.filterwarnings("ignore:incompatible fits")  # CD, as in the whole job
def test_an_engine_identified_in_the_job_flies_as_the_deck_file(tmp_path, monkeypatch):
    """Power chop by the lever: the identified deck next to that of `aeromatch flight engine` from
    eighteen whole flights.
    """
    for place in DATA.iterdir():
        if place.name != "aeromatch.toml":
            (tmp_path / place.name).symlink_to(place)
    (tmp_path / "aeromatch.toml").write_text(
        (DATA / "aeromatch.toml").read_text(encoding="utf-8") + SECTION, encoding="utf-8"
    )
    whole = read_project(tmp_path / "aeromatch.toml")
    fits = [
        fit.model_copy(update={"records": tuple(r for r in fit.records if r in RECORDS)})
        for fit in whole.fit
    ]
    few = whole.with_changes(
        fit=tuple(fit for fit in fits if fit.records),
        cases=tuple(case for case in whole.cases if case.stem == "23_power_chop_lever"),
        controls=Controls(),
        gear=None,
        ground_effect=None,
    )
    made, flown_tree = [], steps.flown_tree

    def counted(*arguments, **options):
        made.append(flown_tree(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(steps, "flown_tree", counted)
    outcome = perform_match(few, tmp_path / "out", 1, timed_step)
    # Without a store, too, no result is computed twice for its two readers.
    assert len(made) == 1
    (case,) = outcome.to_dict()["cases"]
    assert case["failure"] == ""
    assert case["status"]["datcom"] != "pass"
    # the model passes; the case departs by what its record is
    assert case["status"]["final"] == "pass_with_departures"
    written = json.loads((tmp_path / "out" / "report" / "results.json").read_text(encoding="utf-8"))
    short, clean = written["results"][0]["departures"]["final"]
    assert "the record ends 12.9 s after the levers stop" in short
    assert "flown with flaps at 0 deg; the row has approach" in clean
    assert "engine" in outcome.corrected_submodels
    deck = flightmech.read_aircraft(tmp_path / "out" / "final.toml").engines[1].deck
    record = flighttest.read(DATA / "flight" / "t37_23_val_power_chop.nc", DATA / "names.toml")
    end = min(float(leaf["time"][-1]) for leaf in record.children.values())
    flown = engine_channels(cut(record, 0.0, end, rate=10.0), (1, 2), height="h_gps")
    rms = float(np.sqrt(np.mean((fly_deck(deck, flown)["thrust"] - flown["thrust"].values) ** 2)))
    assert rms < 40.0
    assert 'href="#submodels"' in outcome.report.read_text(encoding="utf-8")
