"""Draw the figures of the pages on input design and spin.

Use: ``python docs/scripts/figures/make_input_figures.py``.
Needs matplotlib.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import flightmech
from flighttest.flight_programme.input_design.input_signals import CHANNEL_SETS, axes_of, measures
from flighttest.flight_programme.input_design.multisines import InputAxis, multisine

ROOT = Path(__file__).parents[3]
IMAGES = Path(__file__).parents[2] / "images"
sys.path.insert(0, str(ROOT / "benchmarks"))
COLOURS = ("#0b5fa5", "#c8571b", "#2e7d4f", "#7a4fa3", "#a31f34", "#6b6b6b", "#b58900")


def seven_axes() -> Path:
    """The seven-axis multisine of 30 s, in time and by lines."""
    signal = multisine(
        {
            name: InputAxis(np.radians(4.0), (0.1, 2.0), [(1.0, 1.1)])
            for name in CHANNEL_SETS["full"]
        },
        30.0,
    )
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11.0, 5.0), width_ratios=(3, 2), layout="constrained"
    )
    names, numbers = axes_of(signal), measures(signal)
    for row, (name, colour) in enumerate(zip(names, COLOURS)):
        left.plot(
            signal["time"], np.degrees(signal[name]) - 10.0 * row, color=colour, linewidth=0.9
        )
        lines = signal["power"].sel(axis=name) > 0.0
        amplitude = np.degrees(
            np.sqrt(2.0 * signal["power"].sel(axis=name, harmonic=signal["harmonic"][lines]).values)
        )
        right.vlines(
            signal["frequency"][lines],
            0.0,
            amplitude,
            color=colour,
            linewidth=2.0,
            label=f"{name}  RPF {numbers.loc[name, 'peak_factor']:.2f}",
        )
    left.set_yticks([-10.0 * row for row in range(len(names))], names)
    left.set(
        xlabel="time [s]", title="deflection from trim, 4 deg (0.07) each, 10 deg between axes"
    )
    right.set(
        xlabel="frequency [Hz]",
        ylabel="amplitude of the line [deg]",
        title="lines; nothing between 1.0 and 1.1 Hz",
        ylim=(0.0, 2.4),
    )
    right.legend(fontsize=8, ncols=2, loc="upper center", frameon=False)
    return saved(figure, "input-seven-axes.png")


def spin_run() -> Path:
    """One spin: angles, rates across and about the flight path, coefficients measured and predicted
    on another input.
    """
    import spin_study
    from spin_campaign import predictions
    from spin_recording import draw_errors

    aircraft = flightmech.read_aircraft(ROOT / "data" / "cz150" / "aircraft.toml")
    spin, glide = spin_study.spin(aircraft), spin_study.glide(aircraft)
    found, _ = spin_study.campaign(spin, aircraft, 6, 1, 1)
    data = spin_study.run_data(
        spin, aircraft, draw_errors(aircraft, np.random.default_rng([1, 0])), [1, 1000], which=1
    )
    models = {"spin model": predictions(data, found.models(spin.models))}
    models["glide model"] = predictions(
        data, {c: (p.model, p.estimates) for c, p in glide.published.items()}
    )
    figure, axes = plt.subplots(3, 3, figsize=(12.0, 7.5), layout="constrained", sharex=True)
    time = data["time"].values
    for panel, names, unit in (
        (axes[0, 0], ("alpha", "beta"), "deg"),
        (axes[1, 0], ("p", "Omega"), "deg/s"),
        (axes[2, 0], ("p_osc", "q_osc", "r_osc"), "deg/s"),
    ):
        for name, colour in zip(names, COLOURS):
            panel.plot(time, np.degrees(data[name]), color=colour, linewidth=1.1, label=name)
        panel.set_ylabel(unit)
        panel.legend(fontsize=8, ncols=3, frameon=False)
    for panel, name in zip(axes[:, 1:].T.ravel(), ("CX", "CY", "CZ", "Cl", "Cm", "Cn")):
        panel.plot(
            time, models["glide model"][name], color="#b8b8b8", linewidth=1.0, label="glide model"
        )
        panel.plot(time, data[name], color="black", linewidth=1.6, label="flight")
        panel.plot(
            time,
            models["spin model"][name],
            color=COLOURS[1],
            linewidth=1.0,
            linestyle="--",
            label="spin model",
        )
        spread = np.ptp(data[name].values)
        panel.set_ylim(
            data[name].values.min() - 0.6 * spread, data[name].values.max() + 0.6 * spread
        )
        panel.set_ylabel(name)
    axes[0, 1].legend(fontsize=8, ncols=3, frameon=False)
    for panel in axes[2]:
        panel.set_xlabel("time [s]")
    return saved(figure, "spin-validation.png")


def saved(figure, name: str) -> Path:
    """Write a figure."""
    figure.savefig(IMAGES / name, dpi=110)
    plt.close(figure)
    return IMAGES / name


if __name__ == "__main__":
    for draw in (seven_axes, spin_run):
        print(draw())
