"""The examples run from start to end and fly as announced."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from flightmech.errors import AeromatchWarning

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.slow
def test_fly_the_t37(tmp_path, capsys):
    spec = importlib.util.spec_from_file_location("fly_the_t37", EXAMPLES / "fly_the_t37.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    with pytest.warns(AeromatchWarning, match="one condition per program run"):
        flights = example.main(tmp_path, None)
    assert {file.name for file in tmp_path.iterdir()} == {"doublet.png", "takeoff.png", "landing.png"}
    stated = capsys.readouterr().out
    assert stated.startswith("level at 180 kt: alpha ")
    assert "phugoid" in stated
    doublet, takeoff, landing = (flights[name] for name in ("doublet", "takeoff", "landing"))
    assert float(doublet["nz"].min()) < 0.8 < 1.1 < float(doublet["nz"].max())
    standing = takeoff["time"] < 8.0
    assert float(abs(takeoff["V"].where(standing)).max()) < 0.1  # the brakes hold full power; the nose dips
    airborne = int(np.argmax(takeoff["h_agl"].values > 2.0))
    assert 70.0 < float(takeoff["V_cas"][airborne]) / example.KT < 115.0
    touch = int(np.argmax(landing["wow_left"].values > 0.5))
    assert 0.2 < float(landing["vd"][touch - 1]) < 3.0
    assert float(landing["V"][-1]) < 1.0
