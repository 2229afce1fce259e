"""Control loading of the T-37 identified from programmes of other seeds: shares within two
standard errors of the truth.

    python benchmarks/t37_controls.py FOLDER --seeds 201 202 [--items column wheel pedal] [--flown]

Each seed draws the constants of the circuit within a quarter of a guess, the errors of the
instruments, and the noise. The circuits are identified with those of the aircraft file as priors of
a quarter of their values. Friction builds up over a travel.

FOLDER takes the reconstructions of the shipped runs 41 to 46, which give air and hand
(`t37_circuits.py`). With ``--flown``, FOLDER/SEED holds the recordings of a programme flown by
JSBSim, and FOLDER/SEED.json its truth:

    python ../shared/tools/t37_control_forces.py --out FOLDER/SEED --errors FOLDER/SEED.json
        --seed SEED --only 41,42,43,44,45,46
"""

from __future__ import annotations

import argparse
import json
import math
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from t37_circuits import Programme, draw_programme

import flightmech
import flighttest
from aeromatch.cli.command import cli
from flightmech.units import G0
from flighttest.cli.actions.submodels.controls import ControlMotions
from flighttest.reconstruction.dynamics.saved_paths import open_path
from flighttest.records.sensors.instruments import pick_up_errors
from flighttest.submodels.control_loading.loading import loading_of

ROOT = Path(__file__).parents[1]
T37 = ROOT / "data/t37"
# Hinge moment, constants of the force (none: those of the control), arm of the ailerons [m]: those
# of data/t37/aeromatch.toml.
MODELS = {
    "column": (
        "Ch_e = 1 + alpha + delta_e + delta_e**3 + delta_t",
        ("offset", "bob_weight", "friction", "damping", "mass"),
        0.0,
    ),
    "wheel": ("Ch_a = 1 + alpha + delta_a + delta_a**3", (), 3.6),
    "pedal": ("Ch_r = 1 + beta + delta_r + delta_r**3", (), 0.0),
}
# Names in the truth of the constants of a result.
CONSTANTS = {
    "preload": "preload",
    "nose_spring": "nose_wheel",
    "friction": "R",
    "damping": "W",
    "mass": "m",
    "cable_stiffness": "K",
    "cable_damping": "D",
    "inertia": "J",
    "hinge_damping": "w",
    "hinge_friction": "r",
}
TERMS = {
    "1": "Ch_0",
    "alpha": "Ch_alpha",
    "beta": "Ch_alpha",
    "delta_t": "Ch_tab",
}
# Both ends: constant of the surface, and power of the gearing that reduces it to the hand.
SUMS = {"friction": ("hinge_friction", 1), "damping": ("hinge_damping", 2), "mass": ("inertia", 2)}


def perform(*words: str) -> str:
    """Return what a verb prints on stdout."""
    done = CliRunner().invoke(cli, list(words))
    if done.exit_code not in (0, 1) or not done.stdout:
        raise RuntimeError(f"{' '.join(words)}: {done.output[-800:]} {done.exception!r}")
    return done.stdout


def reconstruct(records: Path, paths: Path) -> list[str]:
    """Return the reconstructed paths of runs 41 to 46; missing ones are made."""
    paths.mkdir(exist_ok=True, parents=True)
    files = []
    for record in sorted(records.glob("t37_4[1-6]*.nc")):
        file = paths / record.name
        files.append(str(file))
        if not file.exists():
            begin = time.process_time()
            names = ["--aircraft", f"{T37}/aircraft.toml", "--names", f"{T37}/names.toml"]
            perform("flight", "reconstruct", str(record), *names, "-j", "1", "-o", str(file))
            print(f"{record.name}: {time.process_time() - begin:.0f} s", flush=True)
    return files


def identify(item: str, programme: Programme) -> flighttest.IdentifiedLoading:
    """Return the control loading of one control."""
    aircraft = flightmech.read_aircraft(T37 / "aircraft.toml")
    model, constants, arm = MODELS[item]
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        return flighttest.identify_control_loading(
            loading_of(aircraft, item, model, constants, arm),
            programme.driven,
            programme.free,
            errors=pick_up_errors(aircraft.instruments),
            drawings=aircraft.circuits[item],
        )


def flown_programme(folder: Path, seed: str, item: str) -> Programme:
    """Return the programme of one control that JSBSim flew."""
    truth = json.loads((folder / f"{seed}.json").read_text(encoding="utf-8"))
    paths = reconstruct(folder / seed, folder / seed / "paths")
    names = (f"force_{item}", f"release_{item}")
    motions = ControlMotions(tuple(paths), (), str(folder / seed), names).read()
    return Programme(*motions, truth["control_system"][item])


def true_values(circuit: dict[str, Any], names: list[str]) -> dict[str, float]:
    """Return the true constants and terms of these names, and sums of both ends."""
    G = circuit["G"]
    bob = circuit["bob"] - G * circuit["unbalance"]
    known = {"bob_weight": bob, "offset": bob * G0}
    values = {}
    for name in names:
        term = name.partition(": ")[2]
        if name in known:
            values[name] = known[name]
        elif name in CONSTANTS:
            values[name] = circuit[CONSTANTS[name]]
        elif term in TERMS:
            values[name] = circuit[TERMS[term]]
        else:
            values[name] = circuit["Ch_cubic" if term.endswith("**3") else "Ch_delta"]
    for name, (aft, power) in SUMS.items():
        values[f"{name}, both ends"] = values[name] + abs(G) ** power * values[aft]
    return values


def standard_errors_off(
    found: flighttest.IdentifiedLoading, true: dict[str, float]
) -> dict[str, tuple[float, float]]:
    """Return error over standard error, and relative error, of every constant."""
    result = {}
    for name, value in true.items():
        short, _, both = name.partition(", ")
        estimate, stderr = found.total(short) if both else found.value(name)
        relative = (estimate - value) / abs(value) if value else math.nan
        result[name] = ((estimate - value) / stderr, relative)
    return result


def main() -> None:
    """Print the shares of every constant."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", nargs="+", required=True)
    parser.add_argument("--items", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--flown", action="store_true")
    given = parser.parse_args()
    by_name: dict[str, list[tuple[float, float]]] = {}
    flights = {}
    if not given.flown:
        for path in reconstruct(T37 / "flight", given.folder / "paths"):
            saved = open_path(path, described=False)
            flights[path] = saved.states.assign_attrs(manoeuvres=saved.states.attrs["manoeuvres"])
    for seed in given.seeds:
        for item in given.items:
            begin = time.process_time()
            if given.flown:
                programme = flown_programme(given.folder, seed, item)
            else:
                programme = draw_programme(flights, item, int(seed))
            found = identify(item, programme)
            # The rigging is an error of the pick-ups.
            names = [str(x) for x in found.estimates["term"].values if x != "rigging"]
            true = true_values(programme.circuit, names)
            errors = standard_errors_off(found, true)
            for name, pair in errors.items():
                by_name.setdefault(f"{item} {name}", []).append(pair)
            far = {name: f"{z:.1f}" for name, (z, _) in errors.items() if abs(z) >= 2.0}
            share = 1.0 - len(far) / len(errors)
            print(
                f"{seed} {item}: {share:.0%} of {len(errors)} within two; beyond: {far}; "
                f"{time.process_time() - begin:.0f} s of processor time\n    {state_end(found)}",
                flush=True,
            )
    report(by_name)


def state_end(found: flighttest.IdentifiedLoading) -> str:
    """Return how the search ended."""
    response = found.response
    if response is None:
        return "regressions: " + "; ".join(remark.text for remark in found.remarks)
    end = response.convergence
    widths = {name: f"{value:.2g}" for name, (value, _) in response.widths.items()}
    kind = f"converged {end.converged}"
    if math.isfinite(response.stationary_within):
        kind = f"stationary within {response.stationary_within:.2g} standard errors"
    return (
        f"{kind} in {end.iterations}, {response.maxima} maxima, widened "
        f"{response.widened:.3f}, {response.widened_by_maxima:.3f}; models "
        f"{response.friction_models}; widths {widths}; unfinished {response.unfinished}"
    )


def report(by_name: dict[str, list[tuple[float, float]]]) -> None:
    """Print the shares of every constant, of each control, and of all."""
    print(f"{'':28}{'rms error':>10}{'within two':>12}{'rms z':>8}")
    for name, pairs in by_name.items():
        z, relative = np.array(pairs).T
        print(f"{name:28}{rms(relative):10.1%}{share_of(z):>12}{rms(z):8.2f}")
    for start in ("column ", "wheel ", "pedal ", ""):
        chosen = [
            np.array(pairs)[:, 0] for name, pairs in by_name.items() if name.startswith(start)
        ]
        if chosen:
            z = np.concatenate(chosen)
            share = np.mean(np.abs(z) < 2.0)
            print(f"{start or 'all':28}{'':10}{share_of(z):>12}{rms(z):8.2f} {share:.1%}")


def rms(x: np.ndarray) -> float:
    """Return the root of the mean square."""
    return math.sqrt(float(np.mean(x**2)))


def share_of(z: np.ndarray) -> str:
    """Return the number within two standard errors, and the number of all."""
    return f"{np.sum(np.abs(z) < 2.0)} of {len(z)}"


if __name__ == "__main__":
    main()
