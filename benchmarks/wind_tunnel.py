"""Structure and coverage of models from simulated balance records.

    python benchmarks/wind_tunnel.py [CAMPAIGNS]

Two records each of the tail of `examples/flapping_vehicle/tunnel.py`: campaigns in which stepwise
regression finds the true terms, in time and in frequency, and share of estimates of the true model
whose truth lies within two standard errors.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "flapping_vehicle"))
import tunnel

from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.candidates import monomials
from flighttest.regression.model_structure.search import select_stepwise
from flighttest.special_tests.wind_tunnel.balance import read_setup
from flighttest.special_tests.wind_tunnel.reduction import balance_coefficients, without_nuisance

BAND = (0.05, 2.0)  # [Hz]
TRUE = {"CL": tunnel.CL, "CD": tunnel.CD}


def main(campaigns: int) -> None:
    """Print shares per coefficient."""
    hits: dict[tuple[str, str], int] = {}
    apart: dict[tuple[str, str, str], list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        setup_file = Path(folder) / "balance.toml"
        setup_file.write_text(tunnel.SETUP, encoding="utf-8")
        setup = read_setup(setup_file)
        for k in range(campaigns):
            data, draws = [], np.random.default_rng(k)
            wrong = (
                np.radians(0.1) * draws.standard_normal(),
                0.05 * draws.standard_normal(),
            )  # as the setup states
            for i, speed in enumerate((8.0, 11.0)):
                path = Path(folder) / f"{i}.csv"
                tunnel.record(100 + 2 * k + i, speed, *wrong).to_csv(path, index=False)
                data.append(balance_coefficients(path, setup))
            for name, truth in TRUE.items():
                candidates, model = (
                    monomials(["alpha", "beta"], 4),
                    RegressionModel(name, list(truth)),
                )
                clean = without_nuisance(data, RegressionModel(name, candidates), setup)
                for domain, band in (("time", None), ("frequency", BAND)):
                    terms = select_stepwise(name, candidates, clean, band, gain=0.0).fit.model.terms
                    hits[name, domain] = hits.get((name, domain), 0) + (
                        set(terms) == set(model.terms)
                    )
                clean = without_nuisance(data, model, setup)
                for domain, fit in (
                    ("time", regress(model, clean)),
                    ("frequency", regress_frequency(model, clean, BAND)),
                ):
                    for term, value in truth.items():
                        e = fit.estimates.sel(term=term)
                        apart.setdefault((name, domain, term), []).append(
                            (float(e["estimate"]) - value)
                            / float(np.hypot(e["stderr"], e["stderr_systematic"]))
                        )
    for (name, domain), count in hits.items():
        print(f"{name}, {domain}: true structure in {count} of {campaigns} campaigns")
    for (name, domain, term), z in apart.items():
        print(
            f"  {name} {term:16s} {domain:10s} {np.mean(np.abs(z) < 2.0):6.1%} within two, "
            f"mean {np.mean(z):+.2f}, scatter {np.std(z):.2f}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
