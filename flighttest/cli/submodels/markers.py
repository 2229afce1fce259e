"""The verb ``aeromatch flight markers``: camera markers to a flight record."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress, table


@click.command("markers")
@click.argument("recording", type=InputFile())
@click.option("--setup", "setup_file", required=True, type=InputFile(), help="TOML file: markers of each body, axes, flapping frequency.")
@click.option("--multiples", type=float, help="Cut-off over the flapping frequency. Default: that of the setup.")
@click.option("-o", "--output", required=True, type=NewFile(), help="Flight record, netCDF, one leaf for each body.")
@json_option
def markers(recording, setup_file, multiples, output, as_json) -> None:
    """Find pose, rates and accelerations of bodies from the marker positions in RECORDING."""
    from ...motion_capture.body_motion import motion, motion_record
    from ...motion_capture.marker_files import read_marker_setup, read_markers
    from ...motion_capture.pose import poses
    from ...records.files import save_record

    setup = read_marker_setup(setup_file)
    cutoff = (setup.multiples if multiples is None else multiples) * setup.flapping_frequency
    with progress("fit the bodies to their markers"):
        positions = read_markers(recording, setup)
        found = {name: poses(positions, places, setup.noise) for name, places in setup.body.items()}
        moved = {name: motion(pose, cutoff) for name, pose in found.items()}
    save_record(motion_record(moved, Path(recording).stem), output)
    facts = {
        name: {
            "frames": int(pose.sizes["time"]), "without_pose": int(pose["r"].isnull().any("axis").sum()), "noise": pose.attrs["noise"],
            "stderr": {key: moved[name][key].attrs["stderr"] for key in ("h", "vd", "az", "theta", "q", "q_dot")},
        }
        for name, pose in found.items()
    }  # fmt: skip
    if as_json:
        document({"bodies": facts, "cutoff": cutoff, "file": output})
        return
    rows = [
        (name, str(one["frames"]), str(one["without_pose"]), f"{1e3 * one['noise']:.3g}", *(f"{x:.2g}" for x in one["stderr"].values()))
        for name, one in facts.items()
    ]
    heads = ["body", "frames", "without pose", "noise [mm]", "h [m]", "vd [m/s]", "az [m/s2]", "theta [rad]", "q [rad/s]", "q_dot [rad/s2]"]
    table(heads, rows, f"standard errors, cut-off {cutoff:g} Hz", right=heads[1:])
    click.echo(f"\nwritten: {output}")
