"""Wing models of a simulated flapping vehicle over campaigns: structure found, truth within two
standard errors.

Standard errors are those of the noise and of the coefficients of the tail together; next to them
those of the noise alone.

A campaign has two flights of 1.6 s of `examples/flapping_vehicle/vehicle.py` with inputs, launch
speed, markers and noise of their own, and a tail whose coefficients are drawn with the standard
errors of Table 2 of Grauer and others, AIAA 2010-7632.

    python benchmarks/wing_model.py [campaigns]
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import joblib
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "flapping_vehicle"))
import vehicle as truth

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.search import StepwiseThresholds, select_stepwise
from flighttest.special_tests.multibody.extraction import air_loads
from flighttest.special_tests.multibody.motion_fit import fit_tree_motion
from flighttest.special_tests.multibody.vehicle import read_flight, read_vehicle

BAND = (0.67, 25.0)  # from one over the record
ENTER = (
    8.0  # partial F: the default of 20 loses the square of the wing angle in one campaign of eight
)
ANGLE, RATE = "joint.wing_right.angle", "joint.wing_right.angle_rate"
STATES = ["1", "u", "w", "q", ANGLE, RATE, f"{ANGLE}**2", f"{RATE}**2", f"{ANGLE}*{RATE}"]
TRUE = {
    "CL": {
        "1": truth.CL["1"],
        "u": truth.CL["u"],
        "w": truth.CL["w"],
        "q": truth.CL["q"],
        RATE: truth.CL["rate"],
    },
    "CD": {
        "1": truth.CD["1"],
        RATE: truth.CD["rate"],
        f"{ANGLE}**2": truth.CD["angle**2"],
        f"{RATE}**2": truth.CD["rate**2"],
    },
}
TAIL_ERRORS = {"CL": (0.0087, 0.0643, 0.0075, 0.0483, 0.0235), "CD": (0.0029, 0.0096)}


def campaign(seed: int) -> dict[str, dict] | str:
    """Return what one campaign finds, or why it ended."""
    try:
        return _found(seed)
    except IdentificationError as error:
        return f"campaign {seed}: {error}"


def _found(seed: int) -> dict[str, dict]:
    rng = np.random.default_rng(10_000 + seed)
    text = truth.tree_file()
    for name, terms in (("CL", truth.CL_TAIL), ("CD", truth.CD_TAIL)):
        drawn = [
            (term, value + s * rng.standard_normal(), s)
            for (term, value), s in zip(terms.items(), TAIL_ERRORS[name])
        ]
        line = next(line for line in text.splitlines() if line.startswith(f"{name} = "))
        text = text.replace(
            line,
            f"{name} = {{ "
            + ", ".join(f'"{term}" = [{x:.6f}, {s}]' for term, x, s in drawn)
            + " }",
        )
    data = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "vehicle.toml").write_text(text, encoding="utf-8")
        tree = read_vehicle(Path(folder) / "vehicle.toml")
        for k in (2 * seed, 2 * seed + 1):
            path = Path(folder) / "flight.csv"
            truth.markers(truth.fly(k), k).round(7).to_csv(path, index=False)
            positions, commands = read_flight(path, tree)
            data.append(air_loads(fit_tree_motion(tree, positions), commands))
    found: dict[str, dict] = {}
    for name, true in TRUE.items():
        model = RegressionModel(name, list(true))
        fits = {
            "time": regress(model, data),
            "frequency": regress_frequency(model, data, BAND, weights="spectrum"),
        }
        for way, fit in fits.items():
            band, weights = (None, "equal") if way == "time" else (BAND, "spectrum")
            chosen = select_stepwise(
                name,
                STATES,
                data,
                band=band,
                thresholds=StepwiseThresholds(ENTER),
                gain=0.0,
                weights=weights,
            ).fit.model.terms
            e = fit.estimates.sel(term=list(true))
            wrong, s = e["estimate"].values - np.array(list(true.values())), e["stderr"].values
            z = wrong / np.hypot(s, e["stderr_systematic"].values)
            found[f"{name} {way}"] = {
                "z": z,
                "noise": wrong / s,
                "wrong": wrong,
                "chosen": set(chosen),
                "R2": fit.estimates.attrs["R2"],
            }
    return found


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    runs = joblib.Parallel(n_jobs=-1)(
        joblib.delayed(campaign)(seed) for seed in range(1, count + 1)
    )
    for text in (run for run in runs if isinstance(run, str)):
        print(text)
    runs = [run for run in runs if not isinstance(run, str)]
    for key in runs[0]:
        z = np.array([run[key]["z"] for run in runs])
        chosen = [run[key]["chosen"] for run in runs]
        whole, exact = (
            sum(set(TRUE[key[:2]]) <= one for one in chosen),
            sum(set(TRUE[key[:2]]) == one for one in chosen),
        )
        R2 = np.mean([run[key]["R2"] for run in runs])
        inside = 100.0 * np.mean(np.abs(z) < 2.0, axis=0)
        print(
            f"{key:14s} R2 {R2:.2f}, true terms in {whole}, exactly in {exact} of "
            f"{len(runs)}; within two standard errors"
        )
        print(
            "    ",
            ", ".join(
                f"{term} {share:.0f} % (rms {s:.2f})"
                for term, share, s in zip(TRUE[key[:2]], inside, np.sqrt((z**2).mean(axis=0)))
            ),
        )
        print(
            "     chosen:",
            ", ".join(
                f"{term} {count}"
                for term, count in Counter(term for one in chosen for term in one).most_common()
            ),
        )
        noise, wrong = (np.array([run[key][what] for run in runs]) for what in ("noise", "wrong"))
        print(
            f"     all {100.0 * np.mean(np.abs(z) < 2.0):.1f} %, of the noise alone "
            f"{100.0 * np.mean(np.abs(noise) < 2.0):.1f} %"
        )
        print("     rms errors", ", ".join(f"{x:.2g}" for x in np.sqrt((wrong**2).mean(axis=0))))


if __name__ == "__main__":
    main()
