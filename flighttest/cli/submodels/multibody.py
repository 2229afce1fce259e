"""The verb ``aeromatch flight multibody``: air loads of a vehicle of several bodies from camera markers, and models of the wings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from flightmech.support.console import InputFile, NewFile, NewFolder, document, json_option, progress, table

from .coefficient_fits import as_rows, averages_of, candidates_of, coefficient_fits, fit_options, print_fits, save_fits

_STATES = ("V", "u", "w", "q")


@click.command("multibody")
@click.argument("recordings", nargs=-1, required=True, type=InputFile())
@click.option("--vehicle", "vehicle_file", required=True, type=InputFile(), help="TOML file: bodies, joints, actuators, known surfaces.")
@fit_options(over="u w q", order=2, weights="spectrum")
@click.option("--predict", type=InputFile(), help="Recording that is not fitted, to be predicted.")
@click.option("--figure", type=NewFile(), help="Draw data, models and residuals of the last recording: png, svg or pdf.")
@click.option("-o", "--output", type=NewFolder(), help="Folder for the records and the fits, one file each.")
@json_option
def multibody(
    recordings,
    vehicle_file,
    models,
    selected,
    candidates,
    over,
    order,
    gain,
    enter,
    band,
    domain,
    weights,
    predict,
    figure,
    output,
    as_json,
) -> None:
    """Find the motion of all bodies from the markers in RECORDINGS, take air loads from it, and fit what the wings contribute."""
    import numpy as np

    from flightmech.errors import AeromatchWarning

    from ...equation_error.model import Model
    from ...motion_capture.body_motion import motion_record
    from ...multibody.extraction import air_loads
    from ...multibody.figure import draw_wing_models
    from ...multibody.motion_fit import fit_tree_motion
    from ...multibody.recording import read_flight
    from ...multibody.vehicle import read_vehicle
    from ...records.files import save_record

    vehicle = read_vehicle(vehicle_file)
    wanted = [Model.parse(text) for text in models]
    data = {}
    for path in dict.fromkeys([*recordings, *([predict] if predict else [])]):
        with progress(f"fit the bodies to the markers of {Path(path).name}"):
            positions, commands = read_flight(path, vehicle)
            data[path] = air_loads(fit_tree_motion(vehicle, positions), commands)
            data[path].attrs["record"] = Path(path).stem
    fitted = [data[path] for path in recordings]
    with progress("fit the coefficients"):
        fits, spectral = coefficient_fits(
            wanted,
            selected,
            candidates_of(candidates, over, order),
            {"gain": gain, "enter": enter, "domain": domain},
            band,
            weights,
            Path(recordings[0]).stem,
            lambda model: fitted,
        )
    averages = averages_of(fits, spectral)
    tests = {}
    if predict:
        import warnings

        for fit in fits:
            name = fit.model.coefficient
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AeromatchWarning)  # the range left is in the report of the fit's own use
                rest = data[predict][name].values - fit.predict(data[predict])[name].values
            spread = data[predict][name].values - data[predict][name].values.mean()
            tests[name] = {"R2": float(1.0 - (rest**2).sum() / (spread**2).sum()), "rms": float(np.sqrt(np.mean(rest**2)))}
    if figure and fits:
        draw_wing_models(fits, data[predict or recordings[-1]], figure)
    if output:
        Path(output).mkdir(parents=True, exist_ok=True)
        for path, one in data.items():
            named = one[[name for name in map(str, one.data_vars) if one[name].dims == ("time",) and "stderr" in one[name].attrs]]
            save_record(motion_record({vehicle.base: named}, Path(path).stem), Path(output) / f"{Path(path).stem}.nc")
            _save_loads(one, Path(output) / f"{Path(path).stem}_loads.csv")
        save_fits(fits, output)
    facts = {
        Path(path).stem: {
            "samples": one.sizes["time"], "noise": one.attrs["noise"], **{name: one[name].attrs["stderr"] for name in _STATES},
            **{name: float(np.sqrt(np.mean(one[f"{name}_stderr"].values ** 2))) for name in ("CL", "CD")},
        }
        for path, one in data.items()
    }  # fmt: skip
    if as_json:
        document({"records": facts, **as_rows(fits, averages), "predicted": tests, "folder": output})
        return
    rows = [(name, *(f"{x:.3g}" if key != "samples" else str(x) for key, x in one.items())) for name, one in facts.items()]
    heads = ["record", "samples", "noise [m]", "V [m/s]", "u [m/s]", "w [m/s]", "q [rad/s]", "CL", "CD"]
    table(heads, rows, f"standard errors, cut-off {vehicle.markers.cutoff:g} Hz", right=heads[1:])
    click.echo()
    print_fits(fits, spectral, averages)
    for name, test in tests.items():
        click.echo(f"predicted {Path(predict).stem}: {name} R2 {test['R2']:.3f}, rms {test['rms']:.3g}")
    if output:
        click.echo(f"written: {len(data)} records and {len(fits)} fits in {output}")


def _save_loads(data: Any, path: Path) -> None:
    """Write air loads with their standard errors and the part of the known surfaces as CSV."""
    import pandas as pd

    from flightmech.support.atomic_write import written_atomically

    columns = {"time": data["time"].values}
    for pattern, part in (("{}", "load"), ("{}_stderr", "load_stderr"), ("known_{}", "known")):
        columns |= {pattern.format(name): data[part].sel(component=name).values for name in data["component"].values}
    with written_atomically(path) as unfinished:
        pd.DataFrame(columns).to_csv(unfinished, index=False)
