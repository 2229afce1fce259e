"""Which constants of a gear the reconstructed wheel loads determine, and their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.search import Unknown
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.submodels.landing_gear.explicit import (
    FRICTION,
    LOAD,
    ROLLING,
    GroundRun,
    explicit_fit,
)
from flighttest.submodels.landing_gear.reconstructed_loads import (
    CUTOFF,
    ERRORS,
    WIND_ERROR,
    wheel_loads,
)
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup, wheel_groups, wheels_of

LEG_TERMS = ("stiffness", "stiffness_square", "damping", "orifice", "damping_outwards")
_FIRST, _FURTHER = (
    3.0,
    5.0,
)  # standard errors from zero of the first damper, and of every further term


def select_leg_terms(runs: Sequence[GroundRun], group: WheelGroup) -> list[str]:
    """Return the terms of a leg, the most significant added first.

    Parameters
    ----------
    runs : sequence of GroundRun
    group : WheelGroup

    Returns
    -------
    list of str
        Of `LEG_TERMS`; a spring always.

    Notes
    -----
    Errors of lift and pitching moment are fitted along, so that a spring does not take up what grows with speed.  A
    damper of either kind counts when it is positive.
    """
    parts = [part for run in runs for part in _columns(run, group)]
    columns = {
        term: np.concatenate([part[term] for part in parts])
        for term in (*LEG_TERMS, "lift", "pitching", "load")
    }
    edges = np.cumsum([0, *(len(part["load"]) for part in parts)])
    pieces = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    steps = [run.interval for run in runs for _ in group.names]
    always = [name for name in ("lift", "pitching") if columns[name].any()]
    chosen = ["stiffness"]
    while True:
        t = {
            term: _t(columns, [*always, *chosen, term], pieces, steps)
            for term in LEG_TERMS
            if term not in chosen
        }
        damped = {"damping", "orifice"} & set(chosen)
        allowed = {term: value for term, value in t.items() if term != "damping_outwards" or damped}
        best = max(allowed, key=lambda term: allowed[term], default="")
        needed = _FIRST if best in ("damping", "orifice") and not damped else _FURTHER
        if not best or allowed[best] < needed:
            return chosen
        chosen.append(best)


def _t(columns, names: list[str], pieces, steps) -> float:
    """Standard errors from zero of the last column; of a damper only above zero."""
    if not columns[names[-1]].any():
        return 0.0
    X = np.column_stack([columns[name] for name in names])
    size = np.linalg.norm(X, axis=0)
    p, *_ = np.linalg.lstsq(X / size, columns["load"], rcond=None)
    v = columns["load"] - X / size @ p
    t = float(
        p[-1] / np.sqrt(coloured_covariance_of(X / size, v, pieces, steps).covariance[-1, -1])
    )
    return t if names[-1] in ("damping", "orifice") else abs(t)


def _columns(run: GroundRun, group: WheelGroup) -> list[dict[str, np.ndarray]]:
    """Regressors of every leg of a group; the samples in which it carries."""
    found = []
    for name in group.names:
        k = run.wheels.index(name)
        use = np.isfinite(run.measured[:, k]) & (run.measured[:, k] != 0.0)
        s, rate = run.fields["compression"][use, k], run.fields["rate"][use, k]
        change = {
            source: run.fields["change"][use, k, run.sources.index(source)]
            for source in ("lift", "pitching")
        }
        terms = (s, s**2, rate, rate * np.abs(rate), np.minimum(rate, 0.0))
        found.append({**dict(zip(LEG_TERMS, terms)), **change, "load": run.measured[use, k]})
    return found


_MARGIN = (
    1.05  # friction over the largest that was used without a skid, where the aircraft file has less
)
_REACHED = 0.8  # part of the friction that must have been used, or its value is an extrapolation
T_NEEDED = 3.0  # standard errors from zero of a constant that is kept
_STRUCTURE = (
    "brake",
    "brake_friction",
    "bend",
    "stiffness_square",
    "orifice",
    "damping_outwards",
)  # zero where the records do not need them
_NOT_NEGATIVE = ("stiffness", "damping", "orifice", "brake", "brake_friction")
_RANGES = {FRICTION: (0.02, 3.0), "bend": (0.0, 10.0), "cornering": (0.1, 100.0)}
_SIZES = {
    "stiffness_square": 1e5,
    "orifice": 1e4,
    "damping_outwards": 5e3,
    "damping": 5e3,
    "bend": 0.3,
    "brake": 3e3,
    "brake_friction": 0.3,
}


@dataclass(frozen=True)
class LoadFit:
    """Constants of a gear by regression on reconstructed wheel loads.

    Attributes
    ----------
    fit : OutputError
        Constants under the names of `explicit`, and the errors of the inputs.
    held : dict of str to float
        Constants that are not estimated.
    undetermined : dict of str to str
        Those that the records do not determine, and why.
    loads : tuple of Dataset
        Of `wheel_loads`, by record.
    """

    fit: OutputError
    held: Mapping[str, float]
    undetermined: Mapping[str, str]
    loads: tuple[xr.Dataset, ...]

    def inputs_of(self, k: int) -> dict[str, float]:
        """Return what the inputs of a record, from 0, are wrong by; the wind is that beyond its
        states.
        """
        at = self.fit.of_manoeuvre(k + 1)
        found = {name: value for name, value in at.items() if name in ERRORS}
        blown = self.loads[k].attrs
        return found | {
            name: at.get(name, 0.0) + float(blown[name]) for name in ("wind_n", "wind_e")
        }


def known_constants(aircraft: Aircraft) -> dict[str, float]:
    """Return the constants of the aircraft file under the names of `explicit`."""
    wheels = {wheel.name: wheel for wheel in wheels_of(aircraft)}
    assert aircraft.gear is not None
    found = {
        FRICTION: aircraft.gear.mu_dry,
        ROLLING: float(np.mean([wheel.rolling for wheel in wheels.values()])),
    }
    for group in wheel_groups(aircraft):
        wheel = wheels[group.names[0]]
        values = {
            name: float(getattr(wheel, name))
            for name in ("stiffness", "damping", "orifice", "brake", "brake_friction")
        }
        values |= {
            "damping_outwards": wheel.damping_ext - wheel.damping,
            "bend": (LOAD / wheel.cornering_load) ** 2,
        }
        values["cornering"] = 2.0 * wheel.cornering_stiffness / wheel.cornering_load
        found |= {group.parameter(name): value for name, value in values.items()}
    return found


def regress_gear(
    records: Sequence,
    aircraft: Aircraft,
    database: xr.DataTree | None,
    errors: Mapping[str, float],
    cutoff: float = CUTOFF,
) -> LoadFit:
    """Fit the balances of all records together; leave out, one after the other, what they do not
    determine.

    Parameters
    ----------
    records : sequence of Path or Dataset
        As for `wheel_loads`.
    aircraft, database, cutoff
        As for `wheel_loads`.
    errors : mapping of str to float
        Standard errors of the inputs, by the names of `reconstructed_loads.ERRORS`, and ``wind``,
        at most, of a record.

    Raises
    ------
    IdentificationError
        No wheel touches in a record.
    """
    held = known_constants(aircraft)
    calm = [(0.0, 0.0)] * len(records)
    loads, runs = _runs(records, aircraft, database, calm, cutoff)
    unknown = _candidates(aircraft, held, runs)
    undetermined = _unseen(runs, unknown, held)
    unknown = {name: item for name, item in unknown.items() if name not in undetermined}
    inputs = _errors_of_inputs(records, database, errors, calm)
    while True:
        fit = _fitted(runs, unknown, inputs, held)
        name, why = _weakest(fit, unknown)
        if not name and FRICTION in unknown:
            name, why, used = _unreached(fit, runs)
            held[FRICTION] = max(held[FRICTION], _MARGIN * used) if name else held[FRICTION]
        unknown = {
            key: item._replace(start=float(np.clip(_value(fit, key), item.low, item.high)))
            for key, item in unknown.items()
        }
        if not name:
            break
        if name.rpartition(".")[2] in _STRUCTURE:
            held[name] = 0.0
        else:
            undetermined[name] = why
        del unknown[name]
    if any(
        name.startswith("wind") for name in inputs
    ):  # air forces grow with the square of the wind: once more about the wind that was found
        found = [
            (_value(fit, f"wind_n@{k + 1}"), _value(fit, f"wind_e@{k + 1}"))
            for k in range(len(records))
        ]
        loads, runs = _runs(records, aircraft, database, found, cutoff)
        fit = _fitted(runs, unknown, _errors_of_inputs(records, database, errors, found), held)
    return LoadFit(
        fit,
        {name: value for name, value in held.items() if name not in unknown},
        undetermined,
        loads,
    )


def _runs(
    records: Sequence,
    aircraft: Aircraft,
    database,
    winds: Sequence[tuple[float, float]],
    cutoff: float,
):
    """Wheel loads of all records, and the records as the equations predict them."""
    loads = tuple(
        wheel_loads(record, aircraft, database, wind, cutoff)
        for record, wind in zip(records, winds)
    )
    return loads, [GroundRun(one, aircraft, cutoff) for one in loads]


def _fitted(
    runs: Sequence[GroundRun],
    unknown: Mapping[str, Unknown],
    inputs: Mapping[str, Unknown],
    held: Mapping[str, float],
) -> OutputError:
    for run in runs:
        run.fixed = {name: value for name, value in held.items() if name not in unknown}
    return explicit_fit(runs, {**unknown, **inputs})


def _value(fit: OutputError, name: str) -> float:
    return float(fit.estimates["estimate"].sel(parameter=name))


def _candidates(
    aircraft: Aircraft, known: dict[str, float], runs: Sequence[GroundRun]
) -> dict[str, Unknown]:
    """All constants that may be estimated; terms of the legs that the loads do not need become zero
    in `known`.
    """
    wheels = {wheel.name: wheel for wheel in wheels_of(aircraft)}
    names = [FRICTION, ROLLING]
    for group in wheel_groups(aircraft):
        braked = wheels[group.names[0]].brake > 0.0 or wheels[group.names[0]].brake_friction > 0.0
        terms = select_leg_terms(runs, group)
        known |= {group.parameter(term): 0.0 for term in LEG_TERMS if term not in terms}
        names += [
            group.parameter(name)
            for name in (
                *terms,
                "cornering",
                "bend",
                *(("brake", "brake_friction") if braked else ()),
            )
        ]
    found = {}
    for name in names:
        constant = name if name == FRICTION else name.rpartition(".")[2]
        low, high = _RANGES.get(constant, (-np.inf, np.inf))
        found[name] = Unknown(float(np.clip(known.get(name, 0.0), low, high)), low=low, high=high)
    return found


def _unreached(fit: OutputError, runs: Sequence[GroundRun]) -> tuple[str, str, float]:
    """The friction, where no wheel came near it, and the largest part of a load that was used."""
    used = max(run.used_friction(fit.of_manoeuvre(k + 1)) for k, run in enumerate(runs))
    found = _value(fit, FRICTION)
    if used > _REACHED * found:
        return "", "", used
    words = (
        f"no wheel came near it: at most {used:.2f} of a load was used along the runway; the "
        f"curve of the side force leads to {found:.2f}"
    )
    return FRICTION, words, used


def _errors_of_inputs(
    records: Sequence,
    database: xr.DataTree | None,
    errors: Mapping[str, float],
    winds: Sequence[tuple[float, float]],
) -> dict[str, Unknown]:
    """What the inputs may be wrong by; the wind of a record, beyond `winds`, by what its
    reconstruction leaves open.
    """
    found = {name: Unknown(0.0, errors[name]) for name in ERRORS if errors[name] > 0.0}
    if database is None or errors["wind"] == 0.0:
        return found
    for k, (record, wind) in enumerate(zip(records, winds)):
        for name, blown in zip(("wind_n", "wind_e"), wind):
            found[f"{name}@{k + 1}"] = Unknown(
                -blown, min(_wind_error(record, name), errors["wind"])
            )
    return found


def _wind_error(record, name: str) -> float:
    biases = getattr(record, "biases", None)
    if biases is None or name not in biases["parameter"].values:
        return WIND_ERROR
    return max(float(biases["stderr"].sel(parameter=name)), 1e-3)


def _unseen(
    runs: Sequence[GroundRun], unknown: Mapping[str, Unknown], known: Mapping[str, float]
) -> dict[str, str]:
    """Constants to which nothing that was measured responds by more than its scatter."""
    names = list(unknown)
    for run in runs:
        run.names, run.fixed = (
            tuple(names),
            {key: value for key, value in known.items() if key not in unknown},
        )
    values = np.array([unknown[name].start for name in names], float)
    sizes = np.array(
        [
            max(abs(value), _SIZES.get(name.rpartition(".")[2], 0.0), 1e-3)
            for name, value in zip(names, values)
        ]
    )
    scatter = np.nanmean(
        np.concatenate([run.measured - run.predict(values) for run in runs]) ** 2, axis=0
    )
    information = np.zeros(len(names))
    for run in runs:
        S = np.where(
            np.isfinite(run.measured)[:, :, None],
            run.slopes(values, 1e-3 * sizes, central=True),
            0.0,
        )
        information += (S**2 / scatter[None, :, None]).sum(axis=(0, 1))
    weak = information * sizes**2 < T_NEEDED**2
    return {
        name: "nothing that was measured responds to it" for name, use in zip(names, weak) if use
    }


def _weakest(fit: OutputError, unknown: Mapping[str, Unknown]) -> tuple[str, str]:
    """The constant that is least determined, and why it is left out; empty when all are determined."""
    worst = (T_NEEDED, "", "")
    e = fit.estimates.sel(parameter=list(unknown))
    for name, value, stderr, active in zip(
        map(str, e["parameter"].values),
        *(e[key].values for key in ("estimate", "stderr", "active")),
    ):
        signed = value if name.rpartition(".")[2] in _NOT_NEGATIVE else abs(value)
        t = 0.0 if active else signed / stderr
        if t < worst[0]:
            words = (
                f"{value:.3g} +- {stderr:.2g}, {T_NEEDED:g} standard errors from zero are needed"
            )
            worst = (t, name, f"at its bound {value:g}" if active else words)
    return worst[1:]
