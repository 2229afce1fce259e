"""From the T-37's files to a fit by the commands alone: database, path, output error, and the
regression next to it.
"""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from aeromatch.cli.command import cli

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning"),
]
T37 = Path(__file__).parents[3] / "data" / "t37"
WINDOWS = ((9.0, 21.7), (39.4, 49.3))  # 3-2-1-1 and doublet of the elevator
FIT = """
title = "T-37, clean cruise, elevator inputs of run 02"
aircraft = "{aircraft}"
database = "datcom.nc"
outputs = ["V", "alpha", "q", "theta", "az"]
{records}
[parameter]
"term.CL.basic" = {{ sigma = 0.1 }}
"bias.CL" = {{ sigma = 0.1 }}
"bias.CD" = {{ sigma = 0.02 }}
"term.CL.elevator" = {{ sigma = 0.25 }}
"term.Cm.basic" = {{ sigma = 0.3 }}
"bias.Cm" = {{ sigma = 0.05 }}
"term.Cm.qhat" = {{ sigma = 1.0 }}
"term.Cm.elevator" = {{ sigma = 0.25 }}
"init.alpha" = {{ own = true }}
"init.q" = {{ own = true }}
"init.theta" = {{ own = true }}
"init.V" = {{ own = true }}
"""


def call(*words):
    done = CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.mark.nightly
def test_output_error_against_the_regression(tmp_path):
    """docs/evidence/identification.md has the table; the database is DATCOM's, Cm_q -17.6 and
    Cm_delta_e -1.52.
    """
    aircraft, datcom = T37 / "aircraft.toml", T37 / "datcom"
    elevator, flaps = datcom / "t37_elevator_one_by_one.pdas.out", datcom / "t37_flaps.out"
    options = (
        "--clean",
        datcom / "t37_clean.out",
        "--flaps",
        flaps,
        "--elevator",
        elevator,
        "--aileron",
        datcom / "t37_aileron.out",
    )
    call("db", "build", aircraft, *options, "-o", tmp_path / "datcom.nc")
    record = T37 / "flight" / "t37_02_clean_cruise_5kft.nc"
    windows = [word for window in WINDOWS for word in ("--window", *window)]
    path = tmp_path / "02.nc"
    call(
        "flight",
        "reconstruct",
        record,
        "--names",
        T37 / "names.toml",
        "--aircraft",
        aircraft,
        *windows,
        "-o",
        path,
    )
    records = "".join(f'\n[[record]]\nfile = "02.nc"\nwindow = [{a}, {b}]\n' for a, b in WINDOWS)
    (tmp_path / "fit.toml").write_text(FIT.format(aircraft=aircraft.as_posix(), records=records))
    found = json.loads(call("flight", "fit", tmp_path / "fit.toml", "--json"))
    assert found["converged"] == 1
    assert min(found["explained"]["q"]) > 0.99
    scale = {name: row["estimate"] for name, row in found["parameters"].items()}
    fit = json.loads(
        call(
            "flight",
            "identify",
            path,
            "--aircraft",
            aircraft,
            *windows,
            "--cutoff",
            4,
            "--model",
            "Cm = 1 + alpha + qhat + delta_e",
            "--json",
        )
    )
    regression = {name: row["estimate"] for name, row in fit["terms"].items()}
    # the regression's one pitch-rate term holds DATCOM's Cm_alphadot of -10.0 as well
    assert -17.6 * scale["term.Cm.qhat"] - 10.0 == pytest.approx(regression["qhat"], rel=0.05)
    assert -1.52 * scale["term.Cm.elevator"] == pytest.approx(regression["delta_e"], rel=0.05)
    assert 5.43 * scale["term.CL.basic"] == pytest.approx(4.77, abs=0.15)
