"""Options of the estimator of the verb ``identify``, and the fit that they define."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.quantities import finite_number, option_quantity
from flighttest.cli.actions.manoeuvres import CutManoeuvres
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.errors_in_variables.instrumental_variables import regress_instrumental
from flighttest.regression.errors_in_variables.total_least_squares import regress_total


@dataclass(frozen=True)
class EstimatorOptions:
    """Options of the estimator, by the names of `flighttest.cli.identify`.

    Attributes
    ----------
    method : {"least-squares", "iv", "tls"}
        Least squares, instrumental variables or total least squares.
    band : (float, float) or None
        Band of a fit in frequency [Hz]; None for a fit in time.
    intercepts : {"common", "separate"}
        One constant, or one per manoeuvre.
    weights : str
        Weights of the samples of a fit in time.
    ridge : str
        Ridge parameter on standardised regressors, or ``auto``.
    prior : str or None
        Database whose terms are the prior.
    noises : tuple of (str, str)
        Variable and standard deviation of its noise, for total least squares.
    instrument_files : tuple of str
        Paths with the instruments, one per path of the records.
    constraints : tuple of str
        Relations among terms.
    """

    method: str
    band: tuple[float, float] | None
    intercepts: str
    weights: str
    ridge: str
    prior: str | None
    noises: tuple[tuple[str, str], ...]
    instrument_files: tuple[str, ...]
    constraints: tuple[str, ...]

    def check(self, path_count: int) -> None:
        """Raise SchemaError for options that exclude or require each other."""
        problems = []
        is_changed = self.band is not None or self.weights != "equal" or self.ridge != "0"
        if self.method != "least-squares" and is_changed:
            problems.append(
                f"--method {self.method} works in time with equal weights; leave out --band, "
                f"--weights and --ridge"
            )
        if bool(self.noises) != (self.method == "tls"):
            problems.append(
                "--noise and --method tls go together: state the noise of each noisy variable, as "
                "--noise alpha '0.3 deg'"
            )
        if self.instrument_files and self.method != "iv":
            problems.append("--instruments goes with --method iv")
        if self.constraints and self.prior:
            problems.append("--constraint works without a prior; leave out --prior")
        if problems:
            raise SchemaError("flight identify", problems)
        if self.instrument_files and len(self.instrument_files) != path_count:
            raise SchemaError(
                "flight identify",
                [
                    f"{len(self.instrument_files)} --instruments for {path_count} paths; give one "
                    f"for each"
                ],
            )

    def fit(self, model: RegressionModel, manoeuvres: CutManoeuvres, aircraft_file: str) -> Any:
        """Return the fit of a model by the chosen method."""
        data = manoeuvres.coefficients
        common: dict[str, Any] = {"intercepts": self.intercepts, "constraints": self.constraints}
        if self.method == "iv":
            instruments = self._read_instruments(manoeuvres, aircraft_file)
            return regress_instrumental(model, data, instruments=instruments, **common)
        if self.method == "tls":
            return regress_total(model, data, self._noise_in_si(), **common)
        ridge = self._ridge_parameter()
        if self.band is None:
            return regress(model, data, weights=self.weights, ridge=ridge, **common)
        if self.weights != "equal":
            raise SchemaError(
                "flight identify", ["--weights goes with a fit in time; leave out --band"]
            )
        return regress_frequency(model, data, self.band, ridge=ridge, **common)

    def _noise_in_si(self) -> dict[str, float]:
        """Return the standard deviations in SI by variable."""
        noise = {}
        for name, text in self.noises:
            noise[name] = option_quantity(f"--noise {name}", text, lookup(name).units)
        return noise

    def _read_instruments(
        self, manoeuvres: CutManoeuvres, aircraft_file: str
    ) -> list[xr.Dataset] | None:
        """Return the instruments of each manoeuvre with reduced rates; None without files."""
        if not self.instrument_files:
            return None
        aircraft = read_aircraft(aircraft_file)
        records = [reduced_rates(open_states(file), aircraft) for file in self.instrument_files]
        return [records[number] for number in manoeuvres.path_numbers]

    def _ridge_parameter(self) -> float | str:
        """Return the ridge parameter, or ``auto``."""
        if self.ridge == "auto":
            return self.ridge
        try:
            return finite_number(self.ridge)
        except ValueError:
            raise SchemaError(
                "flight identify", [f"--ridge is {self.ridge!r}; expected a number or auto"]
            ) from None
