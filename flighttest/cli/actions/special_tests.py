"""Functions that perform the commands of `flighttest.cli.special_tests`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.quantities import option_quantity
from flightmech.support.atomic_write import folder_written_atomically, written_atomically
from flightmech.support.console import (
    collect_options,
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from flighttest.records.files import save_record
from flighttest.regression.combining.pooling import pool_fits
from flighttest.regression.equation_error.fit_file import save_fit
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.candidates import monomials
from flighttest.regression.model_structure.search import StepwiseThresholds, select_stepwise
from flighttest.special_tests.marker_poses import poses
from flighttest.special_tests.motion_capture import (
    motion_record,
    read_marker_setup,
    read_markers,
    smooth_motion,
)
from flighttest.special_tests.multibody.extraction import air_loads, draw_wing_models
from flighttest.special_tests.multibody.motion_fit import fit_tree_motion
from flighttest.special_tests.multibody.vehicle import read_flight, read_vehicle
from flighttest.special_tests.wind_tunnel.balance import BalanceSetup, read_setup
from flighttest.special_tests.wind_tunnel.reduction import balance_coefficients, without_nuisance
from flighttest.special_tests.wind_tunnel.surfaces import draw_surfaces
from flighttest.special_tests.wind_tunnel.tables import write_balance_table

_MOVED = ("h", "vd", "az", "theta", "q", "q_dot")  # motions whose standard errors are listed


@dataclass(frozen=True)
class FitOptions:
    """Options of the fit of coefficients, by the names of `fit_options`.

    Attributes
    ----------
    models : tuple of str
        Models to fit.
    selected : tuple of str
        Coefficients whose terms are selected.
    candidates : str
        Candidate terms, separated by blanks; if empty, all products of `over`.
    over : str
        Variables, separated by blanks.
    order : int
        Highest order of the products.
    gain, enter : float
        As for `select_stepwise`.
    domain : {"time", "frequency"}
        Domain of the selection.
    band : (float, float) or None
        Band of the fits in frequency [Hz]; None for fits in time only.
    weights : {"equal", "spectrum"}
        As for `regress_frequency`.
    """

    models: tuple[str, ...]
    selected: tuple[str, ...]
    candidates: str
    over: str
    order: int
    gain: float
    enter: float
    domain: str
    band: tuple[float, float] | None
    weights: str

    def fit(
        self, name: str, prepare: Callable[[RegressionModel], Sequence[Any]]
    ) -> tuple[list[Any], list[Any]]:
        """Return the fits in time, and with a band those in frequency.

        `prepare` returns the data for the fit of a model.
        """
        models = [RegressionModel.parse(text) for text in self.models]
        models += self._select_models(name, prepare)
        fits, spectral = [], []
        for model in models:
            data = prepare(model)
            fits.append(regress(model, data, name=name))
            if self.band:
                spectral.append(
                    regress_frequency(model, data, self.band, name=name, weights=self.weights)
                )
        return fits, spectral

    def _select_models(
        self, name: str, prepare: Callable[[RegressionModel], Sequence[Any]]
    ) -> list[RegressionModel]:
        """Return the selected models of the coefficients without a given model."""
        settings: dict[str, Any] = {}
        if self.domain == "frequency":
            if not self.band:
                raise click.UsageError("--select-in frequency needs --band LOW HIGH [Hz]")
            settings = {"band": self.band, "weights": self.weights}
        candidates = self.candidates.split() or monomials(self.over.split(), self.order)
        models = []
        for coefficient in self.selected:
            data = prepare(RegressionModel(coefficient, candidates))
            # No hierarchy: a balance measures at rest, so that no damping term exists, and
            # published models have products without their factors.
            selection = select_stepwise(
                coefficient,
                candidates,
                data,
                thresholds=StepwiseThresholds(self.enter),
                gain=self.gain,
                hierarchy=False,
                name=name,
                **settings,
            )
            models.append(selection.fit.model)
        return models


def _average_fits(fits: Sequence[Any], spectral: Sequence[Any]) -> list[Any]:
    """Return the averages of time and frequency with weights 1/s, one table per coefficient."""
    return [pool_fits(pair, "inverse_sigma") for pair in zip(fits, spectral)]


@contextmanager
def _written_folder(folder: str | Path) -> Iterator[Path]:
    """Yield a folder whose files come together into `folder`, which keeps its other files."""
    Path(folder).parent.mkdir(parents=True, exist_ok=True)
    with folder_written_atomically(folder, lambda name: False) as new:
        yield new


def _save_fits(fits: Sequence[Any], folder: Path) -> None:
    """Write a file per coefficient."""
    for fit in fits:
        save_fit(fit, folder / f"{fit.model.coefficient}.nc")


def _rows_of_fits(fits: Sequence[Any], averages: Sequence[Any]) -> dict[str, Any]:
    """Return the fits for a JSON document."""
    estimates = {}
    for fit in fits:
        table = fit.estimates[["estimate", "stderr"]].to_dataframe()
        estimates[fit.model.coefficient] = table.to_dict("index")
    pooled = {}
    for fit, average in zip(fits, averages):
        pooled[fit.model.coefficient] = average.to_dict("index")
    return {"fits": estimates, "averages": pooled}


def _print_fits(fits: Sequence[Any], spectral: Sequence[Any], averages: Sequence[Any]) -> None:
    """Print reports, and time next to frequency."""
    for k, fit in enumerate(fits):
        click.echo(fit.report())
        click.echo()
        if spectral:
            _print_averages(fit, spectral[k], averages[k])
            click.echo()


# Headings differ by blanks, because the table aligns columns by their heading.
_AVERAGE_COLUMNS = [
    *("time", "std. error"),
    *("frequency", "std. error "),
    *("average 1/s", "std. error  "),
]


def _print_averages(fit: Any, spectral_fit: Any, averages: pd.DataFrame) -> None:
    """Print the estimates in time and in frequency, and their average, a row per term."""
    rows = []
    for term, row in averages.iterrows():
        numbers = []
        for estimates in (fit.estimates, spectral_fit.estimates):
            here = estimates.sel(term=term)
            numbers += [float(here["estimate"]), float(here["stderr"])]
        numbers += [row["value"], row["stderr"]]
        note = "contradictory" if row["contradictory"] else ""
        rows.append((str(term), *(f"{x:.4f}" for x in numbers), note))
    print_table(["term", *_AVERAGE_COLUMNS, ""], rows, right=_AVERAGE_COLUMNS)


def run_markers(
    recording: str, setup_file: str, multiples: float | None, output: str, as_json: bool
) -> None:
    """Perform the command ``markers``."""
    setup = read_marker_setup(setup_file)
    cutoff = (setup.multiples if multiples is None else multiples) * setup.flapping_frequency
    with show_progress("fit the bodies to their markers"):
        positions = read_markers(recording, setup)
        facts, motions = {}, {}
        for name, markers in setup.body.items():
            pose = poses(positions, markers, setup.noise)
            motions[name] = smooth_motion(pose, cutoff)
            facts[name] = {
                "frames": int(pose.sizes["time"]),
                "without_pose": int(pose["r"].isnull().any("axis").sum()),
                "noise": pose.attrs["noise"],
                "stderr": {key: motions[name][key].attrs["stderr"] for key in _MOVED},
            }
    save_record(motion_record(motions, Path(recording).stem), output)
    if as_json:
        print_json({"bodies": facts, "cutoff": cutoff, "file": output})
        return
    rows = []
    for name, fact in facts.items():
        errors = [f"{x:.2g}" for x in fact["stderr"].values()]
        counts = str(fact["frames"]), str(fact["without_pose"])
        rows.append((name, *counts, f"{1e3 * fact['noise']:.3g}", *errors))
    heads = [
        "body",
        "frames",
        "without pose",
        "noise [mm]",
        "h [m]",
        "vd [m/s]",
        "az [m/s2]",
        "theta [rad]",
        "q [rad/s]",
        "q_dot [rad/s2]",
    ]
    print_table(heads, rows, f"standard errors, cut-off {cutoff:g} Hz", right=heads[1:])
    click.echo(f"\nwritten: {output}")


@collect_options(options=FitOptions)
def run_balance(
    points: tuple[str, ...],
    setup_file: str,
    options: FitOptions,
    figure: str | None,
    output: str | None,
    table: str | None,
    step: str | None,
    x_ref: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``balance``."""
    has_fits = bool(options.models or options.selected)
    if not has_fits and not table:
        raise SchemaError(
            "flight balance",
            ["nothing to fit; give --model 'CL = 1 + alpha', --select CL or --table"],
        )
    if table and not (step and x_ref):
        raise click.UsageError("--table needs --step and --x-ref")
    setup = read_setup(setup_file)
    with show_progress("reduce the points"):
        data = [balance_coefficients(path, setup) for path in points]
    if table and step and x_ref:
        _write_table(data, setup, table, step=step, x_ref=x_ref)
        if not has_fits:
            if as_json:
                print_json({"table": str(table)})
            return
    with show_progress("fit the coefficients"):
        fits, spectral = options.fit(
            Path(points[0]).stem, lambda model: without_nuisance(data, model, setup)
        )
    if figure:
        draw_surfaces(fits, figure)
    if output:
        with _written_folder(output) as folder:
            _save_fits(fits, folder)
    averages = _average_fits(fits, spectral)
    if as_json:
        print_json({**_rows_of_fits(fits, averages), "folder": output})
        return
    _print_fits(fits, spectral, averages)
    if output:
        click.echo(f"written: {len(fits)} fits in {output}")


def _write_table(
    data: Sequence[xr.Dataset], setup: BalanceSetup, table: str, *, step: str, x_ref: str
) -> None:
    """Write the points at set points for a database."""
    count = write_balance_table(
        data,
        setup,
        table,
        step=option_quantity("--step", step, "rad"),
        x=option_quantity("--x-ref", x_ref, "m"),
    )
    for name, terms in setup.nuisance.items():
        text = f"{name} of the table holds the terms {', '.join(terms)}, which only a fit removes"
        print_remark(f"note: {text}")
    print_remark(f"written: {count} set points in {table}")


_STATES = ("V", "u", "w", "q")


@collect_options(options=FitOptions)
def run_multibody(
    recordings: tuple[str, ...],
    vehicle_file: str,
    options: FitOptions,
    predict: str | None,
    figure: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``multibody``."""
    vehicle = read_vehicle(vehicle_file)
    paths = dict.fromkeys(filter(None, (*recordings, predict)))
    data = {path: _read_air_loads(path, vehicle) for path in paths}
    fitted = [data[path] for path in recordings]
    with show_progress("fit the coefficients"):
        fits, spectral = options.fit(Path(recordings[0]).stem, lambda model: fitted)
    averages = _average_fits(fits, spectral)
    tests = {}
    if predict:
        tests = {fit.model.coefficient: _predict(fit, data[predict]) for fit in fits}
    if figure and fits:
        draw_wing_models(fits, data[predict or recordings[-1]], figure)
    if output:
        with _written_folder(output) as folder:
            for path, loads in data.items():
                _save_motion(loads, folder / Path(path).stem, vehicle)
            _save_fits(fits, folder)
    facts = {Path(path).stem: _record_facts(loads) for path, loads in data.items()}
    if as_json:
        print_json(
            {
                "records": facts,
                **_rows_of_fits(fits, averages),
                "predicted": tests,
                "folder": output,
            }
        )
        return
    _print_record_facts(facts, vehicle)
    click.echo()
    _print_fits(fits, spectral, averages)
    predicted = Path(predict).stem if predict else ""
    for name, test in tests.items():
        click.echo(f"predicted {predicted}: {name} R2 {test['R2']:.3f}, rms {test['rms']:.3g}")
    if output:
        click.echo(f"written: {len(data)} records and {len(fits)} fits in {output}")


def _read_air_loads(path: str, vehicle: Any) -> Any:
    """Return the air loads of a recording of markers."""
    with show_progress(f"fit the bodies to the markers of {Path(path).name}"):
        positions, commands = read_flight(path, vehicle)
        data = air_loads(fit_tree_motion(vehicle, positions), commands)
        data.attrs["record"] = Path(path).stem
    return data


def _predict(fit: Any, data: Any) -> dict[str, float]:
    """Return R2 and rms of a coefficient that a fit of other records predicts."""
    measured = data[fit.model.coefficient].values
    with warnings.catch_warnings():
        # The report of the fit states the range of its data, so the warning repeats it.
        warnings.simplefilter("ignore", AeromatchWarning)
        residual = measured - fit.predict(data)[fit.model.coefficient].values
    spread = measured - measured.mean()
    return {
        "R2": float(1.0 - (residual**2).sum() / (spread**2).sum()),
        "rms": float(np.sqrt(np.mean(residual**2))),
    }


def _save_motion(data: Any, target: Path, vehicle: Any) -> None:
    """Write the motion of the base as a record, and the air loads as CSV."""
    names = []
    for name in map(str, data.data_vars):
        if data[name].dims == ("time",) and "stderr" in data[name].attrs:
            names.append(name)
    record = motion_record({vehicle.base: data[names]}, target.name)
    save_record(record, target.with_name(f"{target.name}.nc"))
    _save_loads(data, target.with_name(f"{target.name}_loads.csv"))


def _record_facts(data: Any) -> dict[str, Any]:
    """Return the number of samples, the noise of the markers and standard errors of a record."""
    facts = {"samples": data.sizes["time"], "noise": data.attrs["noise"]}
    facts |= {name: data[name].attrs["stderr"] for name in _STATES}
    for name in ("CL", "CD"):
        facts[name] = float(np.sqrt(np.mean(data[f"{name}_stderr"].values ** 2)))
    return facts


def _print_record_facts(facts: dict[str, dict[str, Any]], vehicle: Any) -> None:
    """Print a table of `_record_facts`."""
    rows = []
    for name, row in facts.items():
        samples, *numbers = row.values()
        rows.append((name, str(samples), *(f"{x:.3g}" for x in numbers)))
    states = ("V [m/s]", "u [m/s]", "w [m/s]", "q [rad/s]")
    right = ["samples", "noise [m]", *states, "CL", "CD"]
    title = f"standard errors, cut-off {vehicle.markers.cutoff:g} Hz"
    print_table(["record", *right], rows, title, right=right)


def _save_loads(data: Any, path: Path) -> None:
    """Write air loads with their standard errors and the part of the known surfaces as CSV."""
    columns = {"time": data["time"].values}
    for pattern, part in (("{}", "load"), ("{}_stderr", "load_stderr"), ("known_{}", "known")):
        for name in data["component"].values:
            columns[pattern.format(name)] = data[part].sel(component=name).values
    with written_atomically(path) as unfinished:
        pd.DataFrame(columns).to_csv(unfinished, index=False)
