"""The page of a large report: size, making time, first plot.

    python benchmarks/report_page.py                  100 cases, 3 models, 7 channels, 30 s at 50 Hz
    python benchmarks/report_page.py --cases 12 -o page

Responses are those of linear airplanes with the noise that a reconstructed flight keeps; verdicts
are judged as in a replay.  The first plot is timed in Debian's ``chromium`` when it and the package
``playwright`` are there, from the start of the navigation to the first drawn panel of a case.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.linalg import expm

from flightmech.support.console import print_table
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.judging.measures.modal import mode_table
from pom.replaying.result_assembly import assemble_result
from pom.report.case.page import CommonHeading, case_keys, packed_page
from pom.report.page import PAGE, html_files
from pom.result import PomResult
from pom.tolerances import rows as tolerances

RATE, START, SAMPLES, V = 50.0, 100.0, 1501, 85.0
EDGES = (2.0, 2.2, 4.0, 4.2, 6.0, 6.2)  # of the input, from the start [s]
# what the reconstruction leaves on a flight channel, and the record on an input of one radian: one
# standard deviation [SI]
NOISE = {
    "theta": 1e-4,
    "q": 4e-4,
    "nz": 2e-3,
    "alpha": 3e-4,
    "p": 6e-4,
    "phi": 2e-4,
    "r": 4e-4,
    "beta": 4e-4,
    "V_cas": 0.03,
    "h": 0.1,
}
INPUT_NOISE = 0.01
BASE = {"theta": 0.06, "nz": 1.0, "alpha": 0.06, "V_cas": V, "h": 3000.0}
# stiffness and damping of each model over those of the flight
MODELS = {"datcom": (0.80, 0.75), "corrected": (0.97, 0.95), "final": (1.01, 0.99)}
KINDS = {
    "2.c.10": ("Short period", "delta_e"),
    "2.d.2": ("Roll response", "delta_a"),
    "2.d.6": ("Rudder response", "delta_r"),
    "2.d.7": ("Dutch roll", "delta_r"),
}


def response(A: np.ndarray, B: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return x of x' = A x + B u, sampled like u, linear between its samples. [SI]"""
    n = len(A)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[n, n + 1] = A / RATE, B / RATE, 1.0
    step = expm(block)
    x = np.zeros((len(u), n))
    for k in range(len(u) - 1):
        x[k + 1] = step[:n, :n] @ x[k] + step[:n, n] * u[k] + step[:n, n + 1] * (u[k + 1] - u[k])
    return x


@cache
def pulse(kind: str) -> np.ndarray:
    """Return an input of one radian for two seconds, in the Dutch roll two more the other way."""
    back = -1.0 if kind == "2.d.7" else 0.0
    return np.interp(np.arange(SAMPLES) / RATE, EDGES, [0.0, 1.0, 1.0, back, back, 0.0])


@cache
def motion(kind: str, run: str) -> dict[str, np.ndarray]:
    """Return what a longitudinal and a lateral airplane answer to the pulse, the models to the
    pulse as recorded. [SI / rad]
    """
    stiffness, damping = MODELS.get(run, (1.0, 1.0))
    u = pulse(kind) + (
        0.0 if run == "flight" else np.random.default_rng(0).normal(0.0, INPUT_NOISE, SAMPLES)
    )
    Z, M, Mq = -1.1 * stiffness, -5.0 * stiffness, -1.9 * damping
    alpha, q, theta = response(
        np.array([[Z, 1.0, 0.0], [M, Mq, 0.0], [0.0, 1.0, 0.0]]), np.array([-0.05, -9.0, 0.0]), u
    ).T
    Y, N, Nr, L, Lp = -0.15, 4.2 * stiffness, -0.35 * damping, -6.0 * stiffness, -2.4 * damping
    A = np.array(
        [[Y, -1.0, 0.0, 9.81 / V], [N, Nr, -0.05, 0.0], [L, 0.4, Lp, 0.0], [0.0, 0.0, 1.0, 0.0]]
    )
    beta, r, p, phi = response(
        A, np.array([0.0, 0.1, -7.0, 0.0] if kind == "2.d.2" else [0.02, -3.5, 0.6, 0.0]), u
    ).T
    path = np.cumsum(theta - alpha) / RATE
    if kind == "2.c.10":
        return {
            "theta": theta,
            "q": q,
            "nz": -V * Z * alpha / 9.81,
            "alpha": alpha,
            "V_cas": -9.81 * path,
            "h": V * path,
            "phi": 0.0 * u,
        }
    return {
        "p": p,
        "phi": phi,
        "beta": beta,
        "r": r,
        "V_cas": 0.5 * phi,
        "h": 2.0 * phi,
        "theta": 0.02 * phi,
    }


def result(number: int) -> PomResult:
    """Return one judged case."""
    kind = list(KINDS)[number % len(KINDS)]
    title, control = KINDS[kind]
    rng = np.random.default_rng(number)
    t, size = START + np.arange(SAMPLES) / RATE, np.radians(rng.uniform(1.5, 4.0))
    runs = {
        run: {name: BASE.get(name, 0.0) + size * x for name, x in motion(kind, run).items()}
        for run in ("flight", *MODELS)
    }
    flight = {
        name: values + rng.normal(0.0, NOISE[name], t.size)
        for name, values in runs.pop("flight").items()
    }
    rows, window, end = (
        tolerances.rows_of_test(kind),
        (float(t[0]), float(t[-1])),
        START + EDGES[-1],
    )
    judged = (end, window[1]) if kind == "2.d.7" else window
    case = PomCase(
        f"case_{number:03d}", f"{title}, condition {number}", kind, tolerances.STANDARD,
        tolerances.EDITION, f"cases/{number:03d}.toml",
        f"flight/run_{number:03d}.nc", window, description=f"{title}, {np.degrees(size):.1f} deg.",
        events={"input_end": end},
        show=tuple(flight),
        criteria=tuple(
            tolerances.make_criterion(row, name, judged)
            for row, name in zip(rows, tolerances.names_of(rows), strict=True)
        ),
    )  # fmt: skip
    inputs = dict.fromkeys(
        ("delta_e", "delta_a", "delta_r", "delta_f", "gear"), np.zeros(t.size)
    ) | {control: size * pulse(kind)}
    job = ReplayJob(
        t,
        inputs,
        {"init.theta": float(flight["theta"][0]), "mass.mass": 2800.0, "mass.Iyy": 4500.0},
        (),
        (),
    )
    states = xr.Dataset(
        {name: ("time", values) for name, values in (flight | inputs).items()}, {"time": t}
    )
    return assemble_result(case, states, job, runs, {})


def first_plot(page: Path, tries: int) -> list[float]:
    """Return times from the start of the navigation to the first drawn panel of a case in the
    middle. [s]
    """
    from playwright.sync_api import sync_playwright

    times = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        for _ in range(tries):
            tab = browser.new_page(viewport={"width": 1400, "height": 1000})
            tab.goto("about:blank")
            begin = time.perf_counter()
            tab.goto(f"{page.as_uri()}#case-case_007", wait_until="commit")
            tab.wait_for_selector(".panel canvas")
            tab.evaluate(
                "() => new Promise(drawn => requestAnimationFrame(() => "
                "requestAnimationFrame(drawn)))"
            )
            times.append(time.perf_counter() - begin)
            tab.close()
        browser.close()
    return times


def main() -> None:
    """Read the command line, make the page, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument(
        "-o", "--output", type=Path, help="folder for report.html; without it a temporary one"
    )
    options = parser.parse_args()
    begin = time.perf_counter()
    results = [result(number) for number in range(options.cases)]
    judged = time.perf_counter()
    modes = [mode_table(one) for one in results]
    fitted = time.perf_counter()
    title = "Page of a large report"
    heading, named = (
        CommonHeading(len(results), {}, False),
        zip(case_keys(results), results, modes, strict=True),
    )
    cases = [
        packed_page(i, key, one, heading, None, table)
        for i, (key, one, table) in enumerate(named, 1)
    ]
    files = html_files(results, cases, title, "", {}, {}, {}, {})
    made = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        page = (options.output or Path(folder)) / PAGE
        for name, text in files.items():
            (page.parent / name).parent.mkdir(parents=True, exist_ok=True)
            (page.parent / name).write_text(text, encoding="utf-8")
        rows = [
            [
                "cases x models x samples",
                f"{len(results)} x {len(MODELS)} x {results[0].signals.sizes['time']}",
            ],
            [
                "size of the page, of all",
                f"{page.stat().st_size / 1e6:.2f} MB, {sum(map(len, files.values())) / 1e6:.2f} MB",
            ],
            ["responses and verdicts", f"{judged - begin:.1f} s"],
            ["modes", f"{fitted - judged:.1f} s"],
            ["page made in", f"{made - fitted:.1f} s"],
        ]
        if shutil.which("chromium"):
            times = first_plot(page.resolve(), 5)
            rows.append(
                [
                    "first plot, median (worst) of 5",
                    f"{statistics.median(times):.2f} s ({max(times):.2f} s)",
                ]
            )
    print_table(["", ""], rows)


if __name__ == "__main__":
    main()
