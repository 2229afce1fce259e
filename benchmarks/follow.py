"""Estimates during flight: coverage second by second on simulated flights with known truth, and the
time that one second of data takes.

Flights of 30 s as of `regression_coverage.py`, in samples as a recorder sends them. Coverage is the
share of estimates within two standard errors, over all seeds and terms, at several times of flight.
Candidates: a product of which the truth has none. Time is that of the processor, and on the clock
from the last sample of a second to its estimate, for a flight of one hour.

With --changes: early estimates against the last one of the same flight, for the right model, for an
aeroplane with a curvature in alpha that the model lacks (slope changed by a tenth at the rms of
alpha), the same with alpha**2 as a candidate, for alpha with scale 1.02 and bias 0.01 rad, and for
a vane 4 m ahead that is taken as the angle at the centre of gravity.

python benchmarks/follow.py [--seeds 200] [--hour] [--changes]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from noisy_regressors import noisy_flight
from regression_coverage import TERMS, flown

import flighttest

AT = (12.0, 16.0, 20.0, 25.0, 29.0)  # times of flight [s]
BAND = (0.1, 1.8)
_CANDIDATES = {"CL": "alpha**2", "Cm": "alpha*qhat", "Cn": "beta*rhat", "CY": "beta*rhat"}


def follow(seed: int, coefficient: str, flight: tuple) -> dict[float, np.ndarray]:
    """Return errors over standard errors, (terms,), at the times `AT`; last row: false terms."""
    aircraft, clean = flight
    data = noisy_flight(seed, clean, 0.0)
    model = flighttest.RegressionModel(coefficient, list(TERMS[coefficient]))
    follower = flighttest.in_flight.FlightFollower(
        model, aircraft, band=BAND, candidates=[_CANDIDATES[coefficient]]
    )
    channels = follower.choose_channels([str(name) for name in data.data_vars])
    values = np.column_stack([data[name].values for name in channels])
    truth = TERMS[coefficient]
    found = {}
    for estimate in follower.add(data["time"].values, values):
        if estimate.waiting or not min(abs(estimate.time - t) for t in AT) < 0.1:
            continue
        z = []
        for term, value, stderr in zip(estimate.terms, estimate.values, estimate.stderr):
            if term in truth:
                z.append((value - truth[term]) / stderr)
        is_extra = len(estimate.terms) - len(z)
        found[round(estimate.time)] = np.array([*z, float(is_extra)])
    return found


def measure_time(seconds: int, flight: tuple) -> None:
    """Print the time of one second of data, over a flight of repeated manoeuvres."""
    aircraft, clean = flight
    data = noisy_flight(0, clean, 0.0)
    model = flighttest.RegressionModel("Cm", list(TERMS["Cm"]))
    follower = flighttest.in_flight.FlightFollower(
        model, aircraft, candidates=["alpha**2", "alpha*qhat", "alpha*delta_e", "beta"]
    )
    channels = follower.choose_channels([str(name) for name in data.data_vars])
    values = np.column_stack([data[name].values for name in channels])
    rate, clocks, processor = 50, [], time.process_time()
    for second in range(seconds):
        rows = (np.arange(rate) + rate * second) % len(values)
        stamps = (np.arange(rate) + rate * second) / rate
        start = time.perf_counter()
        list(follower.add(stamps, values[rows]))
        clocks.append(1e3 * (time.perf_counter() - start))
    spent = 1e3 * (time.process_time() - processor) / seconds
    for name, part in (("first 100 s", clocks[:100]), ("last 100 s", clocks[-100:])):
        print(
            f"{seconds} s, {name}: on the clock median {np.median(part):.1f} ms, 95 % "
            f"{np.quantile(part, 0.95):.1f} ms"
        )
    print(f"processor {spent:.1f} ms per second of data", flush=True)


def compare_with_last(
    data, aircraft, coefficient: str, candidates: tuple[str, ...] = ()
) -> np.ndarray:
    """Return differences of estimates from the last one over their standard errors, (time, terms).

    Estimates with other candidates than the last one are left out.
    """
    terms = list(TERMS[coefficient])
    follower = flighttest.in_flight.FlightFollower(
        flighttest.RegressionModel(coefficient, terms), aircraft, band=BAND, candidates=candidates
    )
    channels = follower.choose_channels([str(name) for name in data.data_vars])
    values = np.column_stack([data[name].values for name in channels])
    found = list(follower.add(data["time"].values, values, final=True))
    last = found[-1]
    rows = []
    for estimate in found[:-1]:
        if not estimate.waiting and estimate.terms == last.terms:
            rows.append((estimate.values - last.values) / estimate.stderr)
    return np.array(rows)[:, : len(terms) - 1]


def changed_flights(data, aircraft, coefficient: str) -> dict[str, tuple]:
    """Return flights with a change of the aeroplane or of its angle of attack, and candidates."""
    alpha = data["alpha"]
    departure = alpha - alpha.mean()
    curvature = 0.1 * TERMS[coefficient]["alpha"] / float(departure.std())
    force = 0.5 * curvature * departure**2 * data["qbar"] * aircraft.S
    curved = data.copy()
    if coefficient == "Cm":
        curved["q_dot"] = data["q_dot"] + force * aircraft.cbar / aircraft.Iyy
    else:
        curved["az"] = data["az"] - force / aircraft.mass
    vane = np.arctan(np.tan(alpha) - 4.0 * data["q"] / data["V"])
    return {
        "right model": (data, ()),
        "missing curvature": (curved, ()),
        "curvature as a candidate": (curved, ("alpha**2",)),
        "alpha with bias and scale": (data.assign(alpha=1.02 * alpha + 0.01), ()),
        "vane 4 m ahead": (data.assign(alpha=vane), ()),
    }


def measure_changes(seeds: int, flight: tuple) -> None:
    """Print how far early estimates are from the last one."""
    aircraft, clean = flight
    for coefficient in ("CL", "Cm"):
        results: dict[str, list[np.ndarray]] = {}
        for seed in range(seeds):
            data = noisy_flight(seed, clean, 0.0)
            for name, (changed, more) in changed_flights(data, aircraft, coefficient).items():
                found = compare_with_last(changed, aircraft, coefficient, more)
                results.setdefault(name, []).append(found)
        for name, parts in results.items():
            z = np.concatenate(parts)
            each = " ".join(f"{100 * share:3.0f}" for share in (np.abs(z) < 2.0).mean(axis=0))
            print(
                f"{coefficient}, {name}: within two of the last "
                f"{100 * (np.abs(z) < 2.0).mean():.0f} % ({each}), rms "
                f"{np.sqrt((z**2).mean()):.2f}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--hour", action="store_true", help="time of a flight of one hour")
    parser.add_argument("--changes", action="store_true", help="early against last estimates")
    given = parser.parse_args()
    flight = flown()
    if given.changes:
        measure_changes(given.seeds, flight)
        return
    measure_time(3600 if given.hour else 300, flight)
    for coefficient in ("CL", "Cm", "Cn"):
        results = [follow(seed, coefficient, flight) for seed in range(given.seeds)]
        for at in AT:
            rows = [found[at] for found in results if at in found]
            z = np.array([row[:-1] for row in rows])
            each = " ".join(f"{100 * share:3.0f}" for share in (np.abs(z) < 2.0).mean(axis=0))
            extra = np.mean([row[-1] for row in rows])
            print(
                f"{coefficient} after {at:4.0f} s: covered {100 * (np.abs(z) < 2.0).mean():5.1f} % "
                f"({each}), {len(rows)} flights, a wrong candidate in {100 * extra:.1f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
