"""Records that no fit has seen, replayed by pilot force through the identified control loading of
the T-37.

    aeromatch demo -o out/t37
    python benchmarks/control_forces.py out/t37 ../shared/data/flight/t37_jsbsim/control_forces

Prints, record by record, the force that the trim of the model lacks against the recorded one (trim
force; 5 lbf or 10 % are the usual tolerance), what remains beyond dry friction, and the verdict of
the rows; then the curves of force over travel on the ground, whose measured travel passes a
low-pass of 2 Hz, because the model differentiates it twice.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import flightmech
import flighttest
import pom
from flightmech.units import POUND_FORCE
from flighttest.submodels.control_loading.motion import smooth_derivatives

ROOT = Path(__file__).parents[1]
T37 = ROOT / "data" / "t37"
CASE = """
[case]
id = "{id}"
name = "{name}"
title = "{name}"
record = "{record}"
names = "{names}"
aircraft = "{aircraft}"
window = {window}
features = ["reversible_controls"]
[drive]
surfaces = "{surfaces}"
trim = {trim}
held_by = "{held_by}"
{pilot}
[conditions]
lat = "45 deg"
{events}
"""
PILOT = """
[[drive.pilot]]
control = "F_column"
channel = "theta"
gain = "40 N/deg"
integral = "10 N/deg s"
limit = "60 N"
[[drive.pilot]]
control = "F_wheel"
channel = "phi"
gain = "0.5 N m/deg"
integral = "0.2 N m/deg s"
limit = "6 N m"
"""
CAPTURE = "[events]\ncapture = {}"
# name, record, row, window, surfaces, what holds the controls at the start, events
FLOWN = [
    (
        "52 stick release",
        "t37_52_val_stick_release_clean",
        "2.c.10",
        [5.5, 17.8],
        "force",
        "friction",
        "",
    ),
    (
        "53 column force",
        "t37_53_val_column_force_full_flaps_gear_down",
        "2.c.10",
        [6.04, 17.5],
        "force",
        "friction",
        "",
    ),
    (
        "55 pedal release",
        "t37_55_val_pedal_release_clean",
        "2.d.7",
        [4.0, 20.5],
        "force",
        "friction",
        "[events]\ninput_end = 7.2",
    ),
    (
        "56 turn, 30 deg",
        "t37_56_val_manoeuvring_stability",
        "2.c.6",
        [18.5, 26.5],
        "pilot",
        "force",
        CAPTURE.format(24.0),
    ),
    (
        "56 turn, 45 deg",
        "t37_56_val_manoeuvring_stability",
        "2.c.6",
        [40.5, 46.5],
        "pilot",
        "force",
        CAPTURE.format(45.0),
    ),
    (
        "57 trimmed speed",
        "t37_57_val_static_stability",
        "2.c.7",
        [0.5, 7.5],
        "force",
        "force",
        CAPTURE.format(6.0),
    ),
    (
        "57 slower",
        "t37_57_val_static_stability",
        "2.c.7",
        [29.5, 37.8],
        "force",
        "force",
        CAPTURE.format(36.5),
    ),
    (
        "57 faster",
        "t37_57_val_static_stability",
        "2.c.7",
        [68.5, 77.5],
        "force",
        "force",
        CAPTURE.format(75.0),
    ),
    (
        "58 before the flaps",
        "t37_58_val_trim_change_by_flaps",
        "2.c.7",
        [0.5, 6.3],
        "force",
        "force",
        CAPTURE.format(5.0),
    ),
    (
        "58 after the flaps",
        "t37_58_val_trim_change_by_flaps",
        "2.c.7",
        [21.0, 24.3],
        "force",
        "force",
        CAPTURE.format(23.0),
    ),
]
GROUND = "t37_51_val_controls_on_ground"
SWEPT = [("column", "2.a.1.a", [0.5, 52.5]), ("pedal", "2.a.3.a", [128.5, 180.5])]
CIRCUITS = {"column": "delta_e", "wheel": "delta_a", "pedal": "delta_r"}
OWN = {
    "52": "column",
    "53": "column",
    "55": "pedal",
    "56": "column",
    "57": "column",
    "58": "column",
}


def case_of(
    folder: Path,
    records: Path,
    name: str,
    record: str,
    row: str,
    window: list[float],
    surfaces: str,
    held_by: str,
    events: str,
):
    """Return the case of one stretch of a record."""
    text = CASE.format(
        id=row, name=name, record=records / f"{record}.nc", names=T37 / "names.toml",
        aircraft=T37 / "aircraft.toml", window=window,
        surfaces=surfaces, held_by=held_by, events=events,
        pilot=PILOT if surfaces == "pilot" else "",
        trim="false" if record == GROUND else "true",
    )  # fmt: skip
    file = folder / f"{name.replace(' ', '_').replace(',', '')}.toml"
    file.write_text(text)
    return pom.read_case(file)


def verdicts(result) -> str:
    """Return the rows that have a number, as text."""
    rows = [
        row
        for row in result.verdict_records()
        if row["run"] == "final" and row["verdict"] in ("pass", "fail")
    ]
    return f"{result.status('final'):17}" + "  ".join(
        f"{row['criterion']} {row['worst_ratio']:.2f}" for row in rows
    )


def band(aircraft: flightmech.Aircraft, item: str) -> float:
    """Return the dry friction of both ends of a circuit at rest. [N]"""
    one = aircraft.circuits[item]
    return (
        one.friction
        + one.stiction
        + one.hinge_friction * abs(aircraft.controls[CIRCUITS[item]].gearing)
    )


def main(model: Path, records: Path) -> None:
    """Print the tables."""
    aircraft = flightmech.read_aircraft(model / "final.toml")
    names = list(dict.fromkeys([GROUND, *(record for _, record, *_ in FLOWN)]))
    raw = [flighttest.read(records / f"{name}.nc", T37 / "names.toml") for name in names]
    paths = dict(zip(names, flighttest.reconstruct_programme(raw, aircraft), strict=True))
    models = {"final": model / "final.fmu"}
    with tempfile.TemporaryDirectory() as folder:
        print(f"{'':20} {'force of trim less recorded':>28} {'beyond friction':>16}  rows")
        for name, record, row, window, surfaces, held_by, events in FLOWN:
            item = OWN[name[:2]]
            place = Path(folder), records, name, record, row, window, surfaces
            middle = pom.replay(case_of(*place, "force", events), models, paths[record])
            result = (
                pom.replay(case_of(*place, held_by, events), models, paths[record])
                if held_by == "friction"
                else middle
            )
            lacks = float(middle.trim.loc[f"trim.F_{item}", "final"])
            beyond = max(0.0, abs(lacks) - band(aircraft, item))
            allowed = max(
                5.0 * POUND_FORCE, 0.1 * abs(float(middle.trim.loc[f"F_{item}", "flight"]))
            )
            print(
                f"{name:20} {lacks:+14.1f} N ({abs(lacks) / allowed:4.2f}) {beyond:14.1f} N  "
                f"{verdicts(result)}"
            )
        print("\nOn the ground, driven by the measured travel behind a low-pass of 2 Hz")
        states = paths[GROUND].states
        step = float(states["time"][1] - states["time"][0])
        for item, row, window in SWEPT:
            quiet = states.assign(
                {item: ("time", smooth_derivatives(states[item].values, step, 2.0)[0])}
            )
            result = pom.replay(
                case_of(Path(folder), records, item, GROUND, row, window, "cockpit", "force", ""),
                models,
                quiet,
            )
            print(f"{item:20} {verdicts(result)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
