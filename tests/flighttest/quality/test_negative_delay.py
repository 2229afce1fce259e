"""An instrument that is earlier than the motion it measures."""

from dataclasses import replace
from pathlib import Path

import flightmech
from flighttest.reconstruction.quality.instruments.instrument_sizes import (
    instrument_size_findings,
)
from flighttest.records.sensors.instruments import instruments_of

C182 = Path(__file__).parents[3] / "data" / "c182" / "aircraft.toml"


def test_a_negative_delay_has_a_remark():
    aircraft = flightmech.read_aircraft(C182)

    def remarks(delay):
        receiver = {**aircraft.instruments["satellite"], "delay": delay}
        instruments = {**aircraft.instruments, "satellite": receiver}
        changed = replace(aircraft, instruments=instruments)
        return instrument_size_findings(instruments_of(changed, {}))

    assert remarks([0.15, 0.05]) == []
    assert remarks([-0.05, 0.05]) == []
    (remark,) = remarks([-0.15, 0.05])
    assert "delay is -0.15 +- 0.05 s; an instrument is late" in remark.text
