"""The kinds of files that `fuzz_readers.py` harms: a real file of each kind, and the commands that
read it.
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data"
FLIGHT = "t37_21_val_short_period_full_flaps_gear_down.nc"
AIRCRAFT = "t37/aircraft.toml"
MAPPED = ("--names", "t37/names.toml")
# lines of a CSV recording that are kept, so that a command takes less than a second
LINES = 250


class Kind(NamedTuple):
    """A kind of file: name, way to harm it, file, commands (arguments of ``aeromatch``)."""

    name: str
    harm: str
    file: str
    verbs: tuple[tuple[str, ...], ...]


def _record_verbs(file: str, *names: str) -> tuple[tuple[str, ...], ...]:
    return (
        ("flight", "info", file),
        ("flight", "show", file, *names),
        ("flight", "convert", file, *names, "-o", "out.nc"),
        ("flight", "check", file, *names),
    )


_EXPORT = ("db", "export", "prior.nc")
# File: the files that must be there before, and the command that makes it.
PRODUCTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "sealed_prior.nc": (
        (),
        (
            *("db", "build", AIRCRAFT, "t37/datcom/t37_clean.out"),
            *("t37/datcom/t37_elevator_one_by_one.pdas.out", "-o", "sealed_prior.nc"),
        ),
    ),
    "sealed_path.nc": (
        (),
        (
            *("flight", "reconstruct", f"t37/flight/{FLIGHT}", *MAPPED, "--aircraft", AIRCRAFT),
            *("--window", "4", "12", "-o", "sealed_path.nc"),
        ),
    ),
    "sealed_fit.nc": (
        ("path.nc",),
        (
            *("flight", "identify", "path.nc", "--aircraft", AIRCRAFT, "--model"),
            *("CL = 1 + alpha + delta_e", "-o", "sealed_fit.nc"),
        ),
    ),
    "model.fmu": (("prior.nc",), ("fmu", "write", AIRCRAFT, "prior.nc", "-o", "model.fmu")),
    "report": (
        ("model.fmu",),
        (
            *("pom", "run", "t37/cases/21_short_period.toml", "--model", "m=model.fmu"),
            *("-o", "report", "--no-pdf", "-j", "1"),
        ),
    ),
    "model.xml": (
        ("prior.nc",),
        (*_EXPORT, "--aircraft", AIRCRAFT, "--to", "jsbsim", "-o", "model.xml"),
    ),
    "model.dml": (("prior.nc",), (*_EXPORT, "--to", "daveml", "-o", "model.dml")),
    "model.mat": (("prior.nc",), (*_EXPORT, "--to", "matlab", "-o", "model.mat")),
    "tables": (("prior.nc",), (*_EXPORT, "--to", "csv", "-o", "tables")),
}
# HDF5 files as others write them, without our seal
UNSEALED = {
    "record.nc": f"t37/flight/{FLIGHT}",
    "prior.nc": "sealed_prior.nc",
    "path.nc": "sealed_path.nc",
    "fit.nc": "sealed_fit.nc",
}

KINDS = (
    Kind(
        "record",
        "hdf5",
        "record.nc",
        (
            *_record_verbs("record.nc", *MAPPED),
            ("flight", "manoeuvres", "record.nc", *MAPPED),
            ("flight", "plot", "record.nc", *MAPPED, "-o", "out.svg"),
            (
                *("flight", "reconstruct", "record.nc", *MAPPED, "--aircraft", AIRCRAFT),
                *("--window", "4", "6", "-o", "out.nc"),
            ),
        ),
    ),
    Kind("csv", "text", "c182.csv", _record_verbs("c182.csv", "--names", "c182.toml")),
    *(
        Kind(name, harm, name, _record_verbs(name, "--names", names))
        for name, harm, names in (
            ("zipped", "bytes", "made.toml"),
            ("matlab", "bytes", "made.toml"),
            ("matlab73", "hdf5", "made.toml"),
            ("classic", "bytes", "made.toml"),
            ("px4", "bytes", "made.toml"),
            ("ardupilot", "bytes", "made.toml"),
            ("ch10", "bytes", "decoded.toml"),
            ("mdf", "bytes", "made.toml"),
        )
    ),
    Kind(
        "database",
        "hdf5",
        "prior.nc",
        (
            ("db", "show", "prior.nc"),
            ("db", "check", "prior.nc"),
            ("db", "history", "prior.nc"),
            ("db", "decisions", "prior.nc"),
            ("db", "compare", "prior.nc", "sealed_prior.nc"),
            ("db", "export", "prior.nc", "--to", "csv", "-o", "out"),
            ("fmu", "write", AIRCRAFT, "prior.nc", "-o", "out.fmu"),
        ),
    ),
    Kind("sealed", "bytes", "sealed_prior.nc", (("db", "show", "sealed_prior.nc"),)),
    Kind(
        "path",
        "hdf5",
        "path.nc",
        (
            (
                *("flight", "identify", "path.nc", "--aircraft", AIRCRAFT),
                *("--model", "CL = 1 + alpha", "-o", "out.nc"),
            ),
            ("flight", "plot", "path.nc", "-o", "out.svg"),
            (
                *("flight", "reconstruct", f"t37/flight/{FLIGHT}", *MAPPED, "--aircraft", AIRCRAFT),
                *("--window", "4", "5", "--biases", "path.nc", "-o", "out.nc"),
            ),
        ),
    ),
    Kind(
        "fit",
        "hdf5",
        "fit.nc",
        (
            ("flight", "tabulate", "fit.nc", "--database", "sealed_prior.nc", "-o", "out.nc"),
            ("flight", "plot", "fit.nc", "-o", "out.svg"),
            ("flight", "join", "fit.nc", "sealed_fit.nc"),
        ),
    ),
    Kind(
        "engine",
        "hdf5",
        "t37/engine.nc",
        (("fmu", "write", AIRCRAFT, "sealed_prior.nc", "-o", "out.fmu"),),
    ),
    Kind(
        "results",
        "hdf5",
        "report/results.nc",
        (
            ("pom", "report", "report", "-o", "out", "--no-pdf"),
            ("pom", "verify", "report"),
        ),
    ),
    *(
        Kind(f"report_{name}", "text", f"report/{name}.json", (("pom", "verify", "report"),))
        for name in ("manifest", "results")
    ),
    Kind(
        "listing",
        "text",
        "t37/datcom/t37_clean.out",
        (
            ("datcom", "show", "t37/datcom/t37_clean.out"),
            ("datcom", "convert", "t37/datcom/t37_clean.out", "-o", "out.nc"),
            ("db", "build", AIRCRAFT, "t37/datcom/t37_clean.out", "-o", "out.nc"),
        ),
    ),
    Kind(
        "deck",
        "text",
        "t37/datcom/t37_clean.inp",
        (
            ("datcom", "check", "t37/datcom/t37_clean.inp"),
            ("datcom", "deck", "t37/datcom/t37_clean.inp"),
            ("datcom", "split", "t37/datcom/t37_clean.inp", "-o", "out"),
        ),
    ),
    Kind(
        "aircraft",
        "text",
        AIRCRAFT,
        (
            ("fmu", "write", AIRCRAFT, "sealed_prior.nc", "-o", "out.fmu"),
            ("flight", "check", f"t37/flight/{FLIGHT}", *MAPPED, "--aircraft", AIRCRAFT),
        ),
    ),
    Kind("names", "text", "c182.toml", (("flight", "show", "c182.csv", "--names", "c182.toml"),)),
    Kind(
        "case",
        "text",
        "t37/cases/21_short_period.toml",
        (("pom", "check", "t37/cases/21_short_period.toml"),),
    ),
    Kind("jsbsim", "text", "model.xml", (("db", "import", "model.xml", "-o", "out.nc"),)),
    Kind("daveml", "text", "model.dml", (("db", "import", "model.dml", "-o", "out.nc"),)),
    Kind("tables_matlab", "bytes", "model.mat", (("db", "import", "model.mat", "-o", "out.nc"),)),
    Kind("tables_csv", "text", "", (("db", "import", "tables", "-o", "out.nc"),)),
    Kind("fmu", "bytes", "model.fmu", (("fmu", "show", "model.fmu"),)),
    Kind("plot_file", "text", "plot.for013", (("datcom", "plot", "plot.for013"),)),
    Kind(
        "avl",
        "text",
        "c182.a4.st",
        (
            ("db", "coefficients", "c182.a0.st", "c182.a4.st"),
            (
                *("db", "from-estimate", "c182_aircraft.toml", "c182.a0.st", "c182.a4.st"),
                *("--length-unit", "ft", "--CD0", "0.02", "--control", "elevator=+delta_e"),
                *("--control", "aileron=+delta_a", "--control", "rudder=-delta_r", "-o", "out.nc"),
            ),
        ),
    ),
    *(
        Kind(name, "text", file, (("db", "coefficients", file),))
        for name, file in (("vspaero_stab", "c182.stab"), ("vspaero_polar", "c182.polar"))
    ),
    *(
        Kind(
            name,
            "text",
            file,
            (
                ("db", "coefficients", "columns.csv", "--columns", "columns.toml"),
                (
                    *("db", "from-estimate", "c182_aircraft.toml", "columns.csv"),
                    *("--columns", "columns.toml", "--control", "elevator=+delta_e"),
                    *("-o", "out.nc"),
                ),
            ),
        )
        for name, file in (("columns", "columns.csv"), ("column_map", "columns.toml"))
    ),
)
NAMES = tuple(kind.name for kind in KINDS)


def make_kinds(
    folder: Path,
    names: Collection[str],
    run_command: Callable[[Sequence[str], Path], Any],
    without_seal: Callable[[bytes], bytes],
) -> list[Kind]:
    """Write the sound files of kinds into a folder and return the kinds; all if no name is
    given.
    """
    _copy_examples(folder)
    chosen = [kind for kind in KINDS if not names or kind.name in names]
    if any(kind.name in _WRITTEN for kind in chosen):
        _write_recordings(folder)
    made = []
    for kind in chosen:
        needed = {kind.file.split("/")[0]}
        needed.update(word for verb in kind.verbs for word in verb)
        for file in (*UNSEALED, *PRODUCTS):
            if file in needed:
                _provide(file, folder, run_command, without_seal)
        if kind.name == "tables_csv":
            file = max((folder / "tables").glob("*.csv"), key=lambda path: path.stat().st_size)
            kind = kind._replace(file=f"tables/{file.name}")
        if (folder / kind.file).is_file():
            made.append(kind)
        else:
            print(f"{kind.name}: not fuzzed, its file or its writer is not here", flush=True)
    return made


def _provide(
    file: str, folder: Path, run_command: Callable, without_seal: Callable[[bytes], bytes]
) -> None:
    """Make a file, and before it what it is made of."""
    if (folder / file).exists():
        return
    if file in UNSEALED:
        _provide(UNSEALED[file], folder, run_command, without_seal)
        (folder / file).write_bytes(without_seal((folder / UNSEALED[file]).read_bytes()))
        return
    before, arguments = PRODUCTS[file]
    for name in before:
        _provide(name, folder, run_command, without_seal)
    outcome = run_command(arguments, folder)
    if outcome.code not in (0, 1) or not (folder / file).exists():
        sys.exit(f"{' '.join(arguments)} did not make {file}:\n{outcome.printed[-2000:]}")


def _copy_examples(folder: Path) -> None:
    """Copy what the commands need of the shipped examples."""
    place = folder / "t37"
    shutil.copytree(DATA / "t37" / "datcom", place / "datcom")
    for name in ("aircraft.toml", "engine.nc", "names.toml", "cases/21_short_period.toml"):
        (place / name).parent.mkdir(exist_ok=True)
        shutil.copy(DATA / "t37" / name, place / name)
    (place / "flight").mkdir()
    shutil.copy(DATA / "t37" / "flight" / FLIGHT, place / "flight" / FLIGHT)
    shutil.copy(DATA / "c182" / "names.toml", folder / "c182.toml")
    _copy_estimates(folder)
    lines = (DATA / "c182" / "flight" / "check_short_period.csv").read_text().split("\n")
    (folder / "c182.csv").write_text("\n".join(lines[:LINES]) + "\n")


COLUMN_MAP = """layout = "runs"
force_axes = "stability"
moment_axes = "stability"
mach = 0.2
[reference]
S = "174 ft2"
cbar = "4.9 ft"
b = "35.8 ft"
x = "7.6 ft"
[columns]
alpha_deg = "alpha [deg]"
de_deg = "elevator [deg]"
CL = "CL"
CD = "CD"
Cm = "Cm"
"""


def _copy_estimates(folder: Path) -> None:
    """Copy or write what the estimates of other programs need, and a plot file of DATCOM."""
    shutil.copy(DATA / "c182" / "aircraft.toml", folder / "c182_aircraft.toml")
    for path in (DATA / "avl").glob("*.st"):
        shutil.copy(path, folder / path.name)
    # outputs of VSPAERO are not part of the checkout
    for path in (ROOT.parent / "shared" / "data" / "estimators" / "vspaero").glob("c182.*"):
        shutil.copyfile(path, folder / path.name)
    listings = ROOT / "tests" / "datcom_io" / "listings"
    shutil.copy(listings / "hypersonic_tail_flap.for013", folder / "plot.for013")
    rows = ["alpha_deg,de_deg,CL,CD,Cm"]
    for alpha in range(-4, 12, 4):
        for elevator in (-10, 0, 10):
            lift = 0.4 + 0.09 * alpha + 0.008 * elevator
            moment = 0.05 - 0.015 * alpha - 0.025 * elevator
            rows.append(f"{alpha},{elevator},{lift:.4f},{0.03 + 0.05 * lift**2:.5f},{moment:.4f}")
    (folder / "columns.csv").write_text("\n".join(rows) + "\n")
    (folder / "columns.toml").write_text(COLUMN_MAP)


_WRITTEN = ("zipped", "matlab", "matlab73", "classic", "px4", "ardupilot", "ch10", "mdf")


def _write_recordings(folder: Path) -> None:
    """Write a recording of every format with the writers of the tests of the readers."""
    path = ROOT / "tests" / "flighttest" / "readers" / "test_hostile.py"
    spec = importlib.util.spec_from_file_location("recordings_of_tests", path)
    tools = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tools)
    for name in ("zipped", "matlab", "classic", "px4", "ardupilot", "ch10"):
        tools.WRITERS[name](folder / name)
    (folder / "made.toml").write_text(tools.NAMES)
    (folder / "decoded.toml").write_text(tools.NAMES + tools.DECODE)
    _write_matlab73(folder / "matlab73", tools.T)
    if importlib.util.find_spec("asammdf"):
        _write_mdf(folder / "mdf", tools.T)


def _write_matlab73(path: Path, time: Any) -> None:
    """Write what MATLAB stores with ``-v7.3``: HDF5 behind 512 bytes of its own."""
    head = 512
    with h5py.File(path, "w", userblock_size=head) as file:
        for name in ("t", "q", "imu/t", "imu/q"):
            file[name] = time.reshape(1, -1)
            file[name].attrs["MATLAB_class"] = b"double"
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(head, b" "))


def _write_mdf(path: Path, time: Any) -> None:
    from asammdf import MDF, Signal  # an extra, absent in a plain environment

    with MDF(version="4.10") as file:
        file.append([Signal(time, time, name="q", unit="rad/s")])
        content = file.save(path.with_suffix(".mf4"), overwrite=True)
    Path(content).rename(path)
