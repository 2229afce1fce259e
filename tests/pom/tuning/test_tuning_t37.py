"""The T-37 of the demo with two terms spoilt: the verb tunes it back from the flight evidence, and
the report states so.
"""

import json
import sys
from pathlib import Path

import pytest

import aerodb
import pom
from aeromatch.cli.command import main

CASES = Path(__file__).parents[3] / "data" / "t37" / "cases"


@pytest.mark.nightly
@pytest.mark.slow
def test_spoilt_terms_are_tuned_back(whole_demo, tmp_path, monkeypatch, capsys):
    folder, _ = whole_demo
    final = aerodb.open(folder / "final.nc")
    leaves = aerodb.terms(final)
    factors = {"Cm/elevator": 0.5, "Cm/qhat": 0.3}
    spoilt = {
        name: leaves[name].assign(value=leaves[name]["value"] * factor)
        for name, factor in factors.items()
    }
    aerodb.save(aerodb.replace_terms(final, spoilt), tmp_path / "spoilt.nc")
    words = [
        "pom",
        "tune",
        f"{CASES}/29_flap_change.toml",
        "--database",
        tmp_path / "spoilt.nc",
        "--aircraft",
        folder / "final.toml",
    ]
    words += ["--evidence", folder / "final.nc", "-o", tmp_path / "tuned", "--fmu", "--json"]
    monkeypatch.setattr(sys, "argv", ["aeromatch", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    log = json.loads(capsys.readouterr().out)
    (row,) = log["rows"]
    assert (row["before"], row["after"]) == ("fail", "pass")
    assert sum(move["share"] for move in log["moves"] if move["term"] in factors) > 0.8
    assert max(move["from_evidence"] for move in log["moves"]) <= 2.0
    result = pom.replay(
        pom.read_case(f"{CASES}/29_flap_change.toml"), {"tuned": tmp_path / "tuned" / "tuned.fmu"}
    )
    assert result.worst("tuned")["worst_ratio"] == pytest.approx(row["ratio_after"], abs=1e-3)
