"""What is worth knowing of a record although nothing is wrong with it: what is absent, coarse, off centre or meaningless at low speed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flightmech.units import DEGREE, KNOT

from ..finding import Finding, rows
from .relations import Comparison
from .signals import Signals

COARSE = 0.4  # share of samples that repeat the one before
_ABSENT = (  # any one of these is enough, what it is for
    (("psi",), "heading: wind and heading rate cannot be checked"),
    (("beta_vane", "beta"), "sideslip: it follows from side force and rates only"),
    (("alpha_vane", "alpha"), "angle of attack: it follows from attitude, climb and airspeed only"),
    (("vn", "north", "lat"), "ground velocity: wind and specific force cannot be checked against it"),
    (("ax_imu", "ax"), "specific force: no force coefficients without it"),
    (("temperature",), "temperature: density and true airspeed rest on an assumption"),
    (("V", "V_cas", "mach", "q_c"), "airspeed"),
    (("delta_f",), "flaps"),
)
_OFF_CENTRE = 0.8 * DEGREE
_STRAIGHT_BANK, _STRAIGHT_RATE = 5.0 * DEGREE, 0.5 * DEGREE  # rad, rad/s
_CLOSE = 4.0 * DEGREE  # rms within which a vane means something
_BIN = 5.0  # m/s


def remarks(signals: Signals, table: pd.DataFrame, comparisons: dict[str, Comparison], recorded: Signals) -> list[Finding]:
    """Return notes on a record.

    Parameters
    ----------
    signals : Signals
        Mistakes undone.
    table : DataFrame
        Of `channel_table`.
    comparisons : dict of Comparison
        Of `explain`.
    recorded : Signals
        As recorded.
    """
    return _absent(recorded) + _coarse(table) + _off_centre(signals) + _minimum_speed(signals, comparisons)


def _absent(signals: Signals) -> list[Finding]:
    missing = [(names, why) for names, why in _ABSENT if not any(name in signals for name in names)]
    if not missing:
        return []
    text = "not in the record: " + "; ".join(why for _, why in missing)
    return [Finding("note", "absent", tuple(names[0] for names, _ in missing), text, "check the name map if the file has them")]


def _coarse(table: pd.DataFrame) -> list[Finding]:
    found = []
    for row in rows(table):
        if np.isfinite(row.noise) and COARSE < row.repeated < 1.0:
            text = (
                f"{row.channel} repeats {row.repeated:.0%} of its samples: it is recorded at {row.rate:g} Hz "
                "and changes far less often, or in coarse steps"
            )
            found.append(
                Finding("note", "coarse", (row.channel,), text, "do not differentiate it; its bandwidth is below that of the recorder")
            )
    return found


def _off_centre(signals: Signals) -> list[Finding]:
    """Mean of aileron and rudder in straight, level flight."""
    if not {"phi", "p", "r"} <= set(signals.values):
        return []
    found = []
    for name in {"delta_a", "delta_r"} & set(signals.values):
        mask = signals.mask((name, "phi", "p", "r"))
        mask &= (np.abs(signals["phi"]) < _STRAIGHT_BANK) & (np.hypot(signals["p"], signals["r"]) < _STRAIGHT_RATE)
        if mask.sum() * signals.step < 30.0 or abs(middle := float(np.median(signals[name][mask]))) < _OFF_CENTRE:
            continue
        text = f"{name} stands at {middle / DEGREE:+.1f} deg in straight flight: bias of the pick-up, trim or an asymmetry"
        remedy = "let regressions have an intercept; calibrate the pick-up with the surface centred"
        found.append(Finding("note", "offset", (name,), text, remedy, evidence={"offset": middle}))
    return found


def _minimum_speed(signals: Signals, comparisons: dict[str, Comparison]) -> list[Finding]:
    """Speed below which the alpha vane does not follow attitude and climb, on the ground included."""
    if "vane" not in comparisons:
        return []
    c = comparisons["vane"]
    apart, speed = np.abs(c.first - c.second - c.offset), signals.completed(("V",))["V"]
    limit = 0.0
    for edge in np.arange(0.0, float(np.percentile(speed, 99.0)), _BIN):
        inside = (speed >= edge) & (speed < edge + _BIN)
        if inside.any() and np.sqrt(np.mean(apart[inside] ** 2)) < _CLOSE:
            break
        limit = edge + _BIN
    if not limit or limit > 0.6 * float(np.median(speed[signals.flying])):
        return []
    text = f"alpha_vane means nothing below about {limit:.0f} m/s ({limit / KNOT:.0f} kt): it does not follow attitude and climb there"
    return [
        Finding(
            "note", "minimum_speed", ("alpha_vane",), text, "give minimum_speed of the vane in the aircraft file", evidence={"speed": limit}
        )
    ]
