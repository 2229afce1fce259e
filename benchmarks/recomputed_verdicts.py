"""Verdicts of a report, computed again without the program that judged them.

    aeromatch demo -o out/t37
    python benchmarks/recomputed_verdicts.py out/t37/report
    python benchmarks/recomputed_verdicts.py out/c182/report data/c182/cases

Of aeromatch only the outputs are read: the time histories ``csv/CASE.csv``, the case files, the
tolerance table and, for the comparison, ``results.json``.  Bands, windows, modes, elapsed times and
steady values are computed by numpy here, with formulae of their own.  Printed: a line per judged
row and model with both verdicts and both ratios; the exit code is 1 if a verdict differs.
"""

from __future__ import annotations

import csv
import json
import sys
import tomllib
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
CASES = ROOT / "data" / "t37" / "cases"
TABLE = ROOT / "pom" / "tolerances" / "tolerances.csv"
UNITS = {
    "kt": 1852.0 / 3600.0,
    "ft": 0.3048,
    "deg": np.pi / 180.0,
    "deg/s": np.pi / 180.0,
    "lbf": 4.4482216152605,
    "g": 1.0,
    "s": 1.0,
    "-": 1.0,
    "%": 0.01,
}
CHANNELS = {
    "airspeed": "V_cas",
    "pitch_angle": "theta",
    "angle_of_attack": "alpha",
    "height": "h_agl",
    "altitude": "h",
    "pitch_rate": "q",
    "roll_rate": "p",
    "yaw_rate": "r",
    "normal_acceleration": "nz",
    "bank_angle": "phi",
    "wheel_force": "F_rim",
    "column_force": "F_column",
    "r": "r",
}
MODES = {"2.c.9": "V_cas", "2.d.7": "r"}
STANDSTILL = 0.5  # [m/s]
LEAST_MOTION = 0.1  # of the motion of the flight; a model that moves less has no mode


def read_histories(path):
    """Return the columns of a case by (channel, run)."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    numbers = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows[1:]])
    columns = {}
    for k, heading in enumerate(rows[0]):
        words = heading.split()
        columns[(words[0], words[1])] = numbers[:, k]
    return numbers[:, 0], columns


def read_table():
    with TABLE.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def limits_of(row):
    """Return the limits of a printed row: (kind, size)."""
    limits = []
    for prefix in ("", "alt_"):
        kind = row[f"{prefix}quantity"]
        if kind in ("percent", "absolute"):
            # the shipped limits are symmetric
            size = float(row[f"{prefix}upper"]) * UNITS[row["unit" if not prefix else "alt_unit"]]
            limits.append((kind, size))
    return limits


def width_of(limits, rule, value):
    """Return the half width about a flight value, or about every sample of one."""
    widths = []
    for kind, size in limits:
        widths.append(size * np.abs(value) if kind == "percent" else size + 0.0 * np.abs(value))
    return np.minimum.reduce(widths) if rule == "lesser_of" else np.maximum.reduce(widths)


def time_of(bound, events, default):
    """Return the instant of a bound such as ``release+20s``."""
    name, _, more = bound.partition("+")
    if not name:
        return default
    return events.get(name, default) + (float(more.rstrip("s")) if more else 0.0)


def fit_mode(time, values):
    """Return decay [1/s], frequency [rad/s] and phase of a damped sine on a line, by least squares.

    Decay and frequency are found by a grid that shrinks about its best node; the rest is linear.
    """
    t = time - time[0]

    def solve(sigma, omega):
        envelope = np.exp(sigma * t)
        X = np.column_stack(
            [envelope * np.cos(omega * t), envelope * np.sin(omega * t), np.ones_like(t), t]
        )
        theta, *_ = np.linalg.lstsq(X, values, rcond=None)
        return float(np.sum((values - X @ theta) ** 2)), theta

    # the first guess: the largest line of the spectrum
    window = np.hanning(t.size) * (values - np.polyval(np.polyfit(t, values, 1), t))
    spectrum = np.abs(np.fft.rfft(window, 8 * t.size))
    step = 2.0 * np.pi / (8 * t.size * (t[1] - t[0]))
    omega = step * max(int(np.argmax(spectrum)), 1)
    sigma, wide_sigma, wide_omega = -0.1 * omega, 0.3 * omega, 0.4 * omega
    for _ in range(40):
        nodes = []
        for a in np.linspace(sigma - wide_sigma, sigma + wide_sigma, 7):
            nodes += [(a, b) for b in np.linspace(omega - wide_omega, omega + wide_omega, 7)]
        nodes = [node for node in nodes if node[1] > 0.0]
        sigma, omega = min(nodes, key=lambda node: solve(*node)[0])
        wide_sigma, wide_omega = 0.6 * wide_sigma, 0.6 * wide_omega
    _, theta = solve(sigma, omega)
    return sigma, omega, float(np.arctan2(-theta[1], theta[0]))


def mode_value(measure, time, values, other):
    """Return a measure of a mode; `other` is the channel of the second peak of a lag."""
    sigma, omega, phase = fit_mode(time, values)
    if measure == "period":
        return 2.0 * np.pi / omega
    if measure == "t_half":
        return np.log(2.0) / abs(sigma)
    if measure == "damping_ratio":
        return -sigma / np.hypot(sigma, omega)
    # from a peak of the bank angle to the next one of the sideslip, of either sign
    _, _, second = fit_mode(time, other)
    half = np.pi / omega
    lag = ((second - phase) / omega) % half
    return min(lag, half - lag)


def has_motion(time, flown, model):
    """Return whether a model moves about its drift as much as a share of the flight."""
    sizes = []
    for values in (flown, model):
        line = np.polyval(np.polyfit(time - time[0], values, 1), time - time[0])
        sizes.append(np.std(values - line))
    return sizes[1] > LEAST_MOTION * sizes[0]


def run_of(time, columns, run, start):
    """Return time and distance over the ground from the start to the standstill."""
    speed = np.hypot(columns[("vn", run)], columns[("ve", run)])
    rolling = np.flatnonzero((time > start + 5.0) & (speed < STANDSTILL))
    stop = time[rolling[0]] if rolling.size else time[-1]
    inside = (time >= start) & (time <= stop)
    t, v = time[inside], speed[inside]
    return stop - start, float(np.sum(0.5 * (v[1:] + v[:-1]) * np.diff(t)))


def judge(case, row, time, columns, run):
    """Return the verdict of a row and the ratio of its difference to the half width."""
    events, window = case.get("events", {}), case["case"]["window"]
    parameter, measure, limits = row["parameter"], row["measure"], limits_of(row)
    start = max(time_of(row["applies_from"], events, window[0]), window[0])
    stop = min(time_of(row["applies_to"], events, window[1]), window[1])
    start, stop = row.get("window", (start, stop))
    inside = (time >= start - 1e-9) & (time <= stop + 1e-9)
    if measure == "steady" and parameter == "turn_rate":
        # five seconds about the capture, of which the rate must be steady
        about = (time >= events["capture"] - 2.5) & (time <= events["capture"] + 2.5)
        rate = columns[("psi_dot", "flight")][about]
        third = width_of(limits, row["rule"], np.abs(rate.mean())) / 3.0
        return ("invalid" if np.ptp(time[about]) < 5.0 or rate.std() > third else "pass"), np.nan
    if measure in ("period", "t_half", "damping_ratio", "peak_lag"):
        values = []
        name = "phi" if measure == "peak_lag" else MODES[case["case"]["id"]]
        if not has_motion(time[inside], *(columns[(name, who)][inside] for who in ("flight", run))):
            return "fail", np.nan
        for who in ("flight", run):
            other = columns.get(("beta", who))
            other = other[inside] if other is not None else None
            values.append(mode_value(measure, time[inside], columns[(name, who)][inside], other))
        flown, model = values
    elif measure == "elapsed":
        place = 0 if parameter == "time" else 1
        flown, model = (run_of(time, columns, who, start)[place] for who in ("flight", run))
    elif case["case"]["id"] == "2.d.4":
        # in 20 s: the bank angle at the end
        flown, model = (columns[("phi", who)][inside][-1] for who in ("flight", run))
    elif measure == "steady":
        about = inside & (np.abs(time - events["capture"]) <= 2.5)
        name = CHANNELS[parameter]
        flown, model = (columns[(name, who)][about].mean() for who in ("flight", run))
    else:
        name = CHANNELS[parameter]
        flown, model = columns[(name, "flight")][inside], columns[(name, run)][inside]
        width = width_of(limits, row["rule"], flown)
        ratio = float(np.max(np.abs(model - flown) / width))
        return ("pass" if ratio <= 1.0 else "fail"), ratio
    ratio = float(abs(model - flown) / width_of(limits, row["rule"], flown))
    return ("pass" if ratio <= 1.0 else "fail"), ratio


def own_row(name, table):
    """Return a band of a case file as a row of the table."""
    limits = {"quantity": "", "alt_quantity": "", "rule": "greater_of", "measure": "trace"}
    value, unit = table["abs"].split()
    limits |= {"quantity": "absolute", "upper": value, "unit": unit}
    if "percent" in table:
        limits |= {"alt_quantity": "percent", "alt_upper": table["percent"], "alt_unit": "%"}
    return {**limits, "parameter": name, "applies_from": "", "applies_to": "", **table}


def main() -> int:
    report = Path(sys.argv[1])
    stored = json.loads((report / "results.json").read_text(encoding="utf-8"))["results"]
    cases = {}
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else CASES
    for path in sorted(folder.glob("*.toml")):
        case = tomllib.loads(path.read_text(encoding="utf-8"))
        cases[case["case"]["name"]] = case
    printed = read_table()
    differing, counted, left, largest = 0, 0, 0, 0.0
    for item in stored:
        case = cases[item["case"]["name"]]
        head = case["case"]
        time, columns = read_histories(report / "csv" / f"{head['name']}.csv")
        for verdict in item["verdict"]:
            if verdict["verdict"] not in ("pass", "fail", "invalid"):
                continue
            name = verdict["criterion"]
            rows = [
                row
                for row in printed
                if (row["standard"], row["edition"], row["test_id"])
                == (head["standard"], head["edition"], head["id"])
                and row["parameter"] == name
                and row["measure"] != "trend"
            ]
            row = dict(rows[0]) if rows else None
            if name in case.get("tolerance", {}):
                row = own_row(name, case["tolerance"][name])
            found, ratio = judge(case, row, time, columns, verdict["run"])
            if verdict["verdict"] == "invalid" and verdict["worst_ratio"] is not None:
                # the run, not the row, has no judgement: its trim or its flight failed
                left += 1
                continue
            counted += 1
            differs = found != verdict["verdict"]
            differing += differs
            before = verdict["worst_ratio"]
            if before is not None and np.isfinite(ratio):
                largest = max(largest, abs(ratio - before) / max(1.0, before))
            mark = "DIFFERS" if differs else "same"
            shown = "  -  " if before is None else f"{before:.3f}"
            print(
                f"{mark:8}{head['id']:7}{head['name']:26}{name:26}{verdict['run']:10}"
                f"{verdict['verdict']:8}{found:8}{shown:>8}{ratio:8.3f}"
            )
    print(f"{left} rows of runs without a judgement left out")
    print(f"{counted} rows, {differing} differ; ratios differ by at most {largest:.3f}")
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
