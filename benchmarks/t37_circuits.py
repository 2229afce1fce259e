"""Control circuits of the T-37 of drawn constants, moved through the shipped flights.

Air, hand and free manoeuvres are those of the shipped runs 41 to 46: the hand of driven motion
holds the recorded travel, pulses and releases have the forces of the flight card. The circuit has
two masses on a cable and bristles at both ends, in semi-implicit Euler steps of 0.25 ms. It is the
model of ``../shared/tools/t37_control_forces.py``, of which drawn constants, errors of the
instruments, noise and resolution come too. The motion of the aeroplane does not follow the controls
here, which makes a programme fast to compute. The C compiler ``cc`` compiles the loop.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.ndimage import gaussian_filter1d

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT.parent / "shared/tools"))
FRAME, RATE = 1.0 / 400.0, 50.0
SUBSTEPS = 10
# Time in which a hand that takes the control again comes to where it wants to be. [s]
TAKE = 0.3
# Time before a release in which the hand stays where it is. [s]
STILL = 0.4
# Force of a pulse, and time from the start of a release to letting go, by control.
PUSH = {"column": 26.0, "wheel": 4.2, "pedal": 62.0}
HOLD = {"column": 1.5, "wheel": 1.5, "pedal": 2.5}
PULSES = [0.0, 0.5, 0.52, 0.67, 0.69, 2.5, 2.52, 2.67, 2.69, 5.0]
SIGNS = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, 0.0, 0.0]
DEFLECTION = {"column": "delta_e", "wheel": "delta_a", "pedal": "delta_r"}
LOOP = r"""
#include <math.h>
/* u by frame: qbar S c, angle, unbalance, bob, nose spring, hand's travel, is free, force, tab */
void move(int frames, int substeps, double h, double take, const double *c, const double *u,
          double *out)
{
    double G = c[0], K = c[1], D = c[2], aft = c[3] * G * G, m = c[4], span = c[6] - c[5];
    double s = u[5], v = 0, a = s, w = 0, y = 0, z = 0, away = 0, F = 0;
    for (int k = 0; k < frames; k++, u += 9) {
        for (int i = 0; i < substeps; i++) {
            double wanted = u[5] + away;
            F = u[6] > 0.5 ? u[7] : c[19] * (wanted - s) - c[20] * v;
            away = u[6] > 0.5 ? s - u[5] : away * (1 - h / take);
            y = (y + h * v / c[9]) / (1 + h * fabs(v) / c[9]);
            z = (z + h * w / c[9]) / (1 + h * fabs(w) / c[9]);
            double cable = K * (s - a) + D * (v - w);
            double stop = c[18] * (fmin(0, s - c[5]) + fmax(0, s - c[6]));
            double spring = c[10] * tanh(s / (0.01 * span)) + u[4] * s;
            double d = G * a;
            double H = u[0] * (c[13] + c[14] * u[1] + c[15] * d + c[16] * d * d * d + c[17] * u[8]);
            v += h * (F - c[11] * v - c[7] * y - cable - stop - spring - u[3]) / m;
            w += h * (cable - c[12] * G * G * w - c[8] * fabs(G) * z + G * H + u[2]) / aft;
            s += h * v;
            a += h * w;
        }
        out[3 * k] = s, out[3 * k + 1] = a, out[3 * k + 2] = F;
    }
}
"""


class Programme(NamedTuple):
    """Driven and free motion of one control, and the true constants of its circuit."""

    driven: list[xr.Dataset]
    free: list[xr.Dataset]
    circuit: dict[str, Any]


def compile_loop() -> Any:
    """Return the function of `LOOP`."""
    folder = Path(tempfile.mkdtemp())
    source, library = folder / "circuit.c", folder / "circuit.so"
    source.write_text(LOOP, encoding="utf-8")
    words = ["cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", str(source), "-o", str(library)]
    subprocess.run([*words, "-lm"], check=True)
    return ctypes.CDLL(str(library)).move


def draw_programme(flights: dict[str, xr.Dataset], item: str, seed: int) -> Programme:
    """Return the programme of one control with constants and errors of a seed.

    `flights` are states of the shipped runs by name, with their manoeuvres as attribute.
    """
    import t37_control_forces as tool

    errors = tool.draw_errors(seed)
    circuit, move = errors["control_system"][item], compile_loop()
    driven, free = [], []
    for number, states in enumerate(flights.values()):
        spans = free_spans(states, item)
        if item == "column":
            states = trim_tab(move, tool, circuit, states)
        motion = move_circuit(move, tool, circuit, states, spans, item)
        rng = np.random.default_rng([seed, number])
        measured = measure(tool, errors, states, motion, item, rng)
        begin = 0.0
        for start, end, _ in spans:
            driven.append(measured.sel(time=slice(begin, start)))
            free.append(measured.sel(time=slice(start, end)))
            begin = end
        driven.append(measured.sel(time=slice(begin, None)))
    return Programme([part for part in driven if part.sizes["time"] > 1], free, circuit)


def trim_tab(move: Any, tool: Any, circuit: dict[str, Any], states: xr.Dataset) -> xr.Dataset:
    """Return states whose tab leaves the recorded force of the column in the first six seconds."""
    motion = move_circuit(move, tool, circuit, states, [], "column")
    first = slice(1, 300)
    load = circuit["G"] * circuit["S"] * circuit["c"] * circuit["Ch_tab"]
    by_tab = -load * float(states["qbar"].values[first].mean())
    missing = float((states["F_column"].values - motion[:, 2])[first].mean())
    # On the ground the tab has no effect.
    if abs(by_tab) < 10.0:
        return states
    return states.assign(delta_t=states["delta_t"] + missing / by_tab)


def free_spans(states: xr.Dataset, item: str) -> list[tuple[float, float, str]]:
    """Return start, end and name of pulses and releases."""
    spans = []
    for one in json.loads(states.attrs["manoeuvres"]):
        if one["manoeuvre"] in (f"force_{item}", f"release_{item}"):
            spans.append((one["start"], one["end"], one["manoeuvre"]))
    return spans


def move_circuit(
    move: Any,
    tool: Any,
    circuit: dict[str, Any],
    states: xr.Dataset,
    spans: list[tuple[float, float, str]],
    item: str,
) -> np.ndarray:
    """Return travel, travel of the surface end, and force at the times of the states, (time, 3)."""
    time = states["time"].values
    frames = np.arange(time[0] + FRAME, time[-1] + 0.5 * FRAME, FRAME)

    def at_frames(x: np.ndarray) -> np.ndarray:
        return np.interp(frames, time, x)

    angle = {"column": "alpha", "pedal": "beta"}.get(item)
    if angle is None:
        attack = states["p"].values * circuit["y"] / np.maximum(states["V"].values, 5.0)
    else:
        attack = states[angle].values
    nz = at_frames(states["nz"].values)
    # The hand that gave this force was as far away as its stiffness needs; without noise of F.
    recorded = states[f"F_{item}"].values / tool.HAND[item][0]
    wanted = gaussian_filter1d(states[item].values + recorded, 3.0)
    for start, end, name in spans:
        if name.startswith("release"):
            # It stays where it is until it lets go; the filter has mixed what follows into it.
            letting_go = start + HOLD[item]
            held = (time > letting_go - STILL) & (time < end)
            wanted[held] = wanted[held.argmax()]
    is_free, force = np.zeros((2, len(frames)))
    # The card is read once per record of 20 ms.
    tick = np.floor((frames - 0.5 * FRAME) * RATE) / RATE
    for start, end, name in spans:
        begin = start + (HOLD[item] if name.startswith("release") else 0.0)
        now = (tick >= begin - 1e-9) & (tick < end - 1.5 / RATE)
        is_free[now] = 1.0
        if name.startswith("force"):
            force[now] = PUSH[item] * np.interp(tick[now] - start, PULSES, SIGNS)
    inputs = np.column_stack(
        [
            at_frames(states["qbar"].values) * circuit["S"] * circuit["c"],
            at_frames(gaussian_filter1d(attack, 2.0)),
            circuit["unbalance"] * tool.G0 * nz * circuit["G"],
            circuit["bob"] * tool.G0 * nz,
            circuit.get("nose_wheel", 0.0) * (at_frames(states["wow_nose"].values) > 0.5),
            at_frames(wanted),
            is_free,
            force,
            at_frames(gaussian_filter1d(states["delta_t"].values, 5.0)) * (item == "column"),
        ]
    )
    low, high = circuit["stops"]
    names = ("G", "K", "D", "J", "m")
    rest = ("preload", "W", "w", "Ch_0", "Ch_alpha", "Ch_delta", "Ch_cubic", "Ch_tab")
    bristle = tool.BRISTLE * (high - low)
    constants = np.array(
        [
            *(circuit[name] for name in names),
            *(low, high, circuit["R"], circuit["r"], bristle),
            *(circuit[name] for name in rest),
            *(tool.STOP[item], *tool.HAND[item]),
        ]
    )
    out = np.zeros((len(frames), 3))
    real = ctypes.POINTER(ctypes.c_double)
    move(
        ctypes.c_int(len(frames)),
        ctypes.c_int(SUBSTEPS),
        ctypes.c_double(FRAME / SUBSTEPS),
        ctypes.c_double(TAKE),
        *(np.ascontiguousarray(x).ctypes.data_as(real) for x in (constants, inputs, out)),
    )
    last = np.rint((time - time[0]) / FRAME).astype(int) - 1
    return out[np.clip(last, 0, len(out) - 1)]


def measure(
    tool: Any,
    errors: dict[str, Any],
    states: xr.Dataset,
    motion: np.ndarray,
    item: str,
    rng: np.random.Generator,
) -> xr.Dataset:
    """Return the states with the recorded travel, deflection, force and tab of the motion."""
    noise, steps, G = tool.T.NOISE, tool.T.RESOLUTION, errors["control_system"][item]["G"]
    bias, factor = errors["bias"], errors["factor"]
    surface, parts = DEFLECTION[item], [DEFLECTION[item]]
    if surface == "delta_a":
        parts = ["delta_a_left", "delta_a_right"]
    true = {item: motion[:, 0], f"F_{item}": motion[:, 2]}
    tab = gaussian_filter1d(states["delta_t"].values, 5.0)
    channels = {}
    for name, x in true.items():
        y = x * factor.get(name, 1.0) + bias[name] + rng.normal(0.0, noise[name], len(x))
        channels[name] = ("time", np.round(y / steps[name]) * steps[name])
    of_both = np.zeros(len(tab))
    for part in parts:
        y = G * motion[:, 1] * factor.get(part, 1.0) + bias[part]
        y = y + rng.normal(0.0, noise[part], len(y))
        of_both += np.round(y / steps[part]) * steps[part] / len(parts)
    channels[surface] = ("time", of_both)
    y = tab + bias["tab_e"] + rng.normal(0.0, noise["tab_e"], len(tab))
    channels["delta_t"] = ("time", y)
    return states.assign(channels).assign(wow=states["wow_nose"])
