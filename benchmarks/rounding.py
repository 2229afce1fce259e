"""Estimates of every verb that searches, under two kernels of the linear algebra and after changes
of 1e-12 in all channels.

    python benchmarks/rounding.py FOLDER [VERB ...] [--kernels Haswell Sandybridge]

FOLDER takes the reconstructed paths, which are made once, and the results of each variant, which
are made again if they are missing. One line per verb: number of estimates, their largest
difference and that of the standard errors, both in standard errors, between the kernels and after
the change of the channels. Other words than at first (terms, remarks, models) are counted.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

ROOT = Path(__file__).parents[1]
T37, C182 = ROOT / "data/t37", ROOT / "data/c182"
SIZE = 1e-12  # relative change of the channels
FLIGHT = T37 / "flight"
OF_T37 = f"--aircraft {T37}/aircraft.toml --names {T37}/names.toml -j 1 --rate 25"
OF_C182 = f"--aircraft {C182}/aircraft.toml --names {C182}/names.toml -j 1 --rate 25"
# Paths and databases that the verbs start from.
PREPARED = {
    "t37.nc": f"db build {T37}/aircraft.toml {T37}/datcom",
    "02.nc": f"flight reconstruct {FLIGHT}/t37_02_clean_cruise_5kft.nc --window 8 100 {OF_T37}",
    "08.nc": f"flight reconstruct {FLIGHT}/t37_08_flaps_full_gear_down_3kft.nc --window 8 40 "
    f"{OF_T37}",
    "12.nc": f"flight reconstruct {FLIGHT}/t37_12_low_pass_1p7m.nc {OF_T37}",
    "15.nc": f"flight reconstruct {FLIGHT}/t37_15_low_pass_9m.nc {OF_T37}",
    "61.nc": f"flight reconstruct {FLIGHT}/t37_61_taxi_turns_slow.nc {OF_T37}",
    "65.nc": f"flight reconstruct {FLIGHT}/t37_65_differential_braking.nc {OF_T37}",
    "slow.nc": f"flight reconstruct {C182}/flight/slow.csv --window 2 60 {OF_C182}",
    "stall.nc": f"flight reconstruct {C182}/stall/stall_accelerated.csv {OF_C182}",
}
PITCH, YAW, ROLL = "--window 9.0 21.7", "--window 86.3 97.8", "--window 63.84 72.34"
MODELS = {
    "CL = 1 + alpha + qhat + delta_e": PITCH,
    "CD = 1 + alpha + alpha**2 + delta_e": PITCH,
    "Cm = 1 + alpha + qhat + delta_e": PITCH,
    "CY = 1 + beta + phat + rhat + delta_r": f"{YAW} {ROLL}",
    "Cl = 1 + beta + phat + rhat + delta_a + delta_r": f"{YAW} {ROLL}",
    "Cn = 1 + beta + phat + rhat + delta_a + delta_r": f"{YAW} {ROLL}",
}
CM, CN = "Cm = 1 + alpha + qhat + delta_e", "Cn = 1 + beta + phat + rhat + delta_a + delta_r"
OF_02 = f"02.nc --aircraft {T37}/aircraft.toml"
FIT = f"""
title = "pitch"
aircraft = "{T37}/aircraft.toml"
database = "t37.nc"
outputs = ["V", "alpha", "q", "theta", "az"]
noise = "common"
conditions = {{ delta_f = "0 deg" }}
[[record]]
file = "02.nc"
window = [9.0, 21.7]
[parameter]
"term.CL.basic" = {{ sigma = 0.1 }}
"term.Cm.basic" = {{ sigma = 0.2 }}
"term.Cm.elevator" = {{ sigma = 0.25, low = 0.2 }}
"bias.Cm" = {{ sigma = 0.05 }}
"bias.CD" = {{ sigma = 0.02 }}
"init.alpha" = {{ own = true }}
"""


class Variant:
    """One run of the verbs, with a seed for the change of the channels or None for no change."""

    def __init__(self, seed: int | None):
        self.seed = seed

    def change(self, data: Any) -> Any:
        """Return a record or the states of a path with every float channel changed by `SIZE`."""
        if self.seed is None:
            return data
        if isinstance(data, xr.DataTree):
            return data.map_over_datasets(self.change_channels)
        return self.change_channels(data)

    def change_channels(self, data: xr.Dataset) -> xr.Dataset:
        """Return a dataset with every float channel changed by `SIZE`."""
        rng = np.random.default_rng(self.seed)
        changed = {}
        for name, x in data.data_vars.items():
            if x.dtype.kind == "f" and x.ndim:
                changed[name] = x.copy(data=x.values * (1.0 + SIZE * rng.standard_normal(x.shape)))
        return data.assign(changed)


CURRENT = [Variant(None)]  # of the verb that runs


def change_readers() -> None:
    """Make the readers of records, paths and logs return changed channels.

    The verbs take the readers from their modules, so this comes before the first verb.
    """
    from flighttest.reconstruction.dynamics import saved_paths
    from flighttest.records import record
    from flighttest.submodels.actuators import identification

    read_record, read_log = record.read, identification.read_bench_log
    read_path = saved_paths.open_path

    def open_path(*given: Any, **named: Any) -> Any:
        saved = read_path(*given, **named)
        return replace(saved, states=CURRENT[0].change(saved.states))

    record.read = lambda *given: CURRENT[0].change(read_record(*given))
    saved_paths.open_path = open_path
    identification.read_bench_log = lambda *given: CURRENT[0].change(read_log(*given))


def perform(line: str, *more: str) -> dict[str, Any]:
    """Return the JSON document of a verb; files of `PREPARED` that it needs are made first."""
    from click.testing import CliRunner

    from aeromatch.cli.command import cli

    for word in line.split():
        if word in PREPARED and not Path(word).exists() and f"-o {word}" not in line:
            prepare(word)
    done = CliRunner().invoke(cli, [*line.split(), *more, "--json"])
    if not done.stdout:
        raise RuntimeError(f"{line}: {done.output[-500:]} {done.exception!r}")
    return json.loads(done.stdout)


def prepare(name: str) -> None:
    """Make a file of `PREPARED` from records that are not changed."""
    seed, CURRENT[0].seed = CURRENT[0].seed, None
    perform(f"{PREPARED[name]} -o {name}")
    CURRENT[0].seed = seed
    print(f"{name} {time.process_time():.1f} s", flush=True)


def path_of(name: str, record: str) -> dict[str, Any]:
    """Return constants and states of a path just reconstructed, with standard errors."""
    perform(f"flight reconstruct {record} -o {name}")
    from flighttest.reconstruction.dynamics import saved_paths

    saved = saved_paths.open_path(name, described=False)
    found = {"biases": _pair(saved.biases["estimate"], saved.biases["stderr"])}
    for key, errors in saved.errors.data_vars.items():
        found[str(key)] = _pair(
            saved.states[key], np.sqrt((errors.astype(float) ** 2).sum("error"))
        )
    return found


def _pair(value: xr.DataArray, stderr: xr.DataArray) -> dict[str, Any]:
    """Return estimates and standard errors as `pairs` reads them."""
    return {"value": value.values.tolist(), "stderr": stderr.values.tolist()}


def identified(name: str, text: str, options: str) -> dict[str, Any]:
    """Return a fit of one coefficient, which is also written."""
    return perform(f"flight identify {OF_02} --cutoff 4 {options} -o {name}", "--model", text)


def tables() -> dict[str, Any]:
    """Return the nodes of the tables of the T-37 after the fits of one flight."""
    import aerodb

    files = []
    for text, windows in MODELS.items():
        files.append(f"fit_{text[:2]}.nc")
        identified(files[-1], text, windows)
    perform(f"flight tabulate {' '.join(files)} --database t37.nc --unplaced warn -o tables.nc")
    found = {}
    for leaf in aerodb.open("tables.nc").leaves:
        if "stderr" in leaf:
            found[leaf.path] = _pair(leaf["value"], leaf["stderr"])
    return found


def engine() -> dict[str, Any]:
    """Return the spools of the T-37."""
    chops = f"{FLIGHT}/t37_23_val_power_chop.nc {FLIGHT}/t37_24_val_power_slam.nc"
    return perform(f"flight engine {chops} --names {T37}/names.toml")


def servo() -> dict[str, Any]:
    """Return the constants of a servo on the bench."""
    sys.path.insert(0, str(ROOT / "examples/flapping_vehicle"))
    import actuator_bench as bench

    log = bench.log(bench.SERVO, bench.Campaign(duration=6.0), 1)
    log.to_dataframe().reset_index().to_csv("servo.csv", index=False)
    return perform("flight actuator servo.csv --held")


def fitted(*more: str) -> dict[str, Any]:
    """Return a fit of the simulation."""
    Path("fit.toml").write_text(FIT, encoding="utf-8")
    for name in ("t37.nc", "02.nc"):
        if not Path(name).exists():
            prepare(name)
    return perform("flight fit fit.toml", *more)


def linear(motion: str, window: str, *more: str) -> dict[str, Any]:
    """Return a fit of a linear motion."""
    return perform(f"flight fit-linear 02.nc --motion {motion} {window}", *more)


GUSTS = ("--disturbance", "gusts", "--angle", "inertial")
VERBS: dict[str, Callable[[], dict[str, Any]]] = {
    "reconstruct, smoother": lambda: path_of(
        "smoothed.nc",
        f"{FLIGHT}/t37_02_clean_cruise_5kft.nc --window 8 30 {OF_T37}",
    ),
    "reconstruct, batch": lambda: path_of(
        "batch.nc", f"{C182}/flight/slow.csv --method batch --window 2 30 {OF_C182}"
    ),
    "identify, time": lambda: identified("time.nc", CM, PITCH),
    "identify, frequency": lambda: identified("band.nc", CM, f"{PITCH} --band 0.1 1.8"),
    "identify, iv": lambda: identified("iv.nc", CM, f"{PITCH} --method iv"),
    "identify, tls": lambda: perform(
        f"flight identify {OF_02} --cutoff 4 {PITCH} --method tls",
        *("--noise", "alpha", "0.05 deg", "--model", CM),
    ),
    "select": lambda: perform(
        f"flight select {OF_02} --cutoff 4 {PITCH} --coefficient Cm",
        *("--variables", "alpha qhat delta_e"),
    ),
    "tabulate": tables,
    "fit-linear, short period": lambda: linear("short-period", PITCH),
    "fit-linear, lateral": lambda: linear("lateral", YAW),
    "fit-linear, gusts": lambda: linear("short-period", PITCH, *GUSTS),
    "fit-linear, process": lambda: linear("lateral", YAW, "--disturbance", "process"),
    "fit": fitted,
    "fit, process": lambda: fitted("--process-noise", "process"),
    "inertia": lambda: perform(
        f"flight inertia {OF_02} --cutoff 4 {PITCH} {YAW} {ROLL}",
        *("--model", list(MODELS)[4], "--model", CM, "--model", CN),
    ),
    "ground-effect": lambda: perform(
        f"flight ground-effect 12.nc 15.nc 08.nc --aircraft {T37}/aircraft.toml --cutoff 4"
    ),
    "engine": engine,
    "engine, propeller": lambda: perform(
        f"flight engine slow.nc --rate 5 --aircraft {C182}/aircraft.toml --polar 0.03 0.06 "
        "--polar-stderr 0.003 0.006"
    ),
    "gear": lambda: perform(
        f"flight gear 61.nc 65.nc --aircraft {T37}/apriori.toml --database t37.nc --no-flown"
    ),
    "gear, flown": lambda: perform(
        f"flight gear 61.nc --aircraft {T37}/apriori.toml --database t37.nc"
    ),
    "stall": lambda: perform(f"flight stall stall.nc --aircraft {C182}/aircraft.toml"),
    "actuator": servo,
}


def run_verbs(folder: Path, kernel: str, verbs: list[str], seeds: list[int | None]) -> None:
    """Write the results of verbs that are missing."""
    change_readers()
    os.chdir(folder)
    for verb in verbs:
        for seed in seeds:
            file = Path(f"{verb.replace(', ', '_')}.{kernel}.{seed}.json")
            if file.exists():
                continue
            CURRENT[0] = Variant(seed)
            began = time.process_time()
            try:
                done = VERBS[verb]()
            except RuntimeError as error:
                print(f"{verb}: {error}", flush=True)
                continue
            file.write_text(json.dumps(done), encoding="utf-8")
            print(f"{file} {time.process_time() - began:.1f} s", flush=True)


def pairs(item: Any, place: str = "") -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield place, estimates and standard errors in a JSON document."""
    if isinstance(item, dict):
        value = next((item[key] for key in ("estimate", "value", "factor") if key in item), None)
        if value is not None and item.get("stderr") is not None:
            yield place, np.array(value, float), np.array(item["stderr"], float)
        for key, part in item.items():
            error = item.get(f"{key}_stderr")
            if error is not None and part is not None:
                yield f"{place}/{key}", np.array(part, float), np.array(error, float)
            if key in ("estimates", "constants", "errors_of_inputs") and isinstance(part, dict):
                for name, pair in part.items():
                    if isinstance(pair, list) and len(pair) == 2:
                        yield f"{place}/{name}", np.array(pair[0], float), np.array(pair[1], float)
            yield from pairs(part, f"{place}/{key}")
    elif isinstance(item, list):
        for number, part in enumerate(item):
            yield from pairs(part, f"{place}[{number}]")


def compare(one: Any, other: Any) -> tuple[int, float, float, str]:
    """Return the number of estimates, the largest differences of estimates and of standard errors
    in standard errors, and the place of the larger; places in one document only are infinite.
    """
    first, second = ({p: (x, s) for p, x, s in pairs(item)} for item in (one, other))
    if first.keys() != second.keys():
        return len(first), np.inf, np.inf, str(sorted(first.keys() ^ second.keys())[:3])
    count, worst, worst_stderr, at = 0, 0.0, 0.0, ""
    for place, (x, s) in first.items():
        y, t = second[place]
        known = np.isfinite(s) & (s > 0.0) & np.isfinite(x)
        count += int(known.sum())
        if not known.any():
            continue
        moved = float(np.abs((y - x)[known] / s[known]).max())
        changed = float(np.abs((t - s)[known] / s[known]).max())
        if max(moved, changed) > max(worst, worst_stderr):
            at = place
        worst, worst_stderr = max(worst, moved), max(worst_stderr, changed)
    return count, worst, worst_stderr, at


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("verbs", nargs="*", default=[])
    parser.add_argument("--kernels", nargs=2, default=("Haswell", "Sandybridge"))
    parser.add_argument("--child", help="kernel of this process")
    given = parser.parse_args()
    folder, verbs = given.folder.resolve(), given.verbs or list(VERBS)
    folder.mkdir(parents=True, exist_ok=True)
    if given.child:
        seeds: list[int | None] = [None, 1] if given.child == given.kernels[0] else [None]
        run_verbs(folder, given.child, verbs, seeds)
        return
    for kernel in given.kernels:
        subprocess.run(
            [sys.executable, __file__, str(folder), *verbs, "--child", kernel],
            env={**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"},
            check=True,
        )
    report(folder, verbs, given.kernels)


def report(folder: Path, verbs: list[str], kernels: tuple[str, str]) -> None:
    """Print a line per verb."""
    for verb in verbs:
        stem = verb.replace(", ", "_")
        files = [folder / f"{stem}.{kernels[0]}.None.json"]
        files += [folder / f"{stem}.{kernels[1]}.None.json", folder / f"{stem}.{kernels[0]}.1.json"]
        done = [json.loads(f.read_text(encoding="utf-8")) if f.exists() else None for f in files]
        for label, other in zip(("kernel", "1e-12"), done[1:]):
            if done[0] is None or other is None:
                continue
            count, moved, changed, at = compare(done[0], other)
            print(f"{verb:26s}{label:8s}{count:6d} {moved:8.1e} {changed:8.1e}  {at}")


if __name__ == "__main__":
    main()
