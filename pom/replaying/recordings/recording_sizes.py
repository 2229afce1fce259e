"""Size and sign of the channels of a recording of a device, compared with those of the flight.

A row with two alternatives passes by one of them, so a channel in a wrong unit can hide behind the
other.  A factor of a unit, a change of sign or an output that does not move is a fault of the
recording or of its name map, whatever the rows say.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from flightmech.names import WRAPPED, is_quantity, lookup, value_text
from flightmech.support.arrays import true_runs
from flightmech.units import DEGREE, FOOT, G0, KNOT, POUND_FORCE
from pom.judging.watched_channels import BANDS
from pom.status import RECORDING_FAULT
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import quantity_words

FACTORS = {
    "rad": (("deg", "rad", 1.0 / DEGREE),),
    "rad s-1": (("deg/s", "rad/s", 1.0 / DEGREE),),
    "m": (("ft", "m", 1.0 / FOOT),),
    "m s-1": (("kt", "m/s", 1.0 / KNOT), ("ft/s", "m/s", 1.0 / FOOT)),
    "m s-2": (("g", "m/s2", 1.0 / G0), ("ft/s2", "m/s2", 1.0 / FOOT)),
    "N": (("lbf", "N", 1.0 / POUND_FORCE),),
    "1": (("m/s2", "g", G0), ("%", "1", 100.0)),
}
"""By SI unit of a channel: unit of the file, unit that the name map has, factor between them."""
NEAR_FACTOR = 0.08
"""Largest difference of a ratio from a factor of `FACTORS`, as a share of the factor."""
NEAR_DEGREES = 0.4
"""The same for factors above `LARGE`: no device is that far from the flight."""
LARGE = 8.0
NEAR_SIGN = 0.4
"""Largest difference from 1 of the size of a channel of opposite sign."""
LEAST_CORRELATION = 0.8
"""Of the movements of device and flight, so that their ratio is one of sizes."""
LEVEL = 4.0
"""A channel whose mean is this many times its rms movement is compared by its mean."""
FROZEN = 0.1
"""Share of a case for which an output that moved before repeats one value, to be frozen."""
FROZEN_MOVED = 3.0
"""Movement of the flight meanwhile, in `LEAST_MOVED`: outputs have coarse steps."""
LEAST_MOVED = {"rad": DEGREE, "rad s-1": DEGREE, "1": 0.02, "m": 10.0, "m s-1": 1.0, "N": 5.0}
"""By unit: movement of the flight below which a channel is not compared by it. [SI]"""

STEADY = 0.25
"""Scatter of a displacement, over the displacement, up to which it is constant."""
INCREMENT = 0.1
"""Load factor by which an offset of one may differ from one."""
STARTED = ("V_cas", "h", "theta", "phi", "alpha")
"""States that a device sets at the start."""

Traces = Mapping[str, np.ndarray]


def size_remarks(
    flight: Traces, device: Traces, inputs: Collection[str] = ()
) -> Iterator[RowRemark]:
    """Yield the departures of the channels of a recording by size, sign and movement.

    Parameters
    ----------
    flight, device : mapping of str to array (time,)
        Channels on one clock; NaN where the recording has none. [SI]
    inputs : collection of str
        Channels that are compared as inputs elsewhere, and are left out here.
    """
    frozen: list[str] = []
    partly: list[str] = []
    for name, values in device.items():
        if name not in flight or name in inputs or name in WRAPPED or not is_quantity(name):
            continue
        unit = lookup(name).units
        good = np.isfinite(values) & np.isfinite(flight[name])
        if good.sum() < 3 or unit not in LEAST_MOVED:
            continue
        own, reference = values[good], flight[name][good]
        if np.ptp(own) == 0.0 and np.ptp(reference) > LEAST_MOVED[unit]:
            frozen.append(f"{name} (flight {value_text(name, float(np.ptp(reference)), '.3g')})")
            continue
        share, moved = _frozen_part(own, reference, FROZEN_MOVED * LEAST_MOVED[unit])
        if share > 0.0:
            meanwhile = value_text(name, moved, ".3g")
            partly.append(f"{name} ({share:.0%} of the case; flight meanwhile {meanwhile})")
        # the small mean of an increment looks like another unit
        text = _increment_text(name, own, reference) or _size_text(unit, own, reference)
        text = text or _offset_text(name, own, reference)
        if text:
            yield _fault(f"{name} ({quantity_words(name)}) of the device is {text}")
    if frozen:
        yield _fault(
            f"the recording holds one value for the whole case in {', '.join(frozen)}, which the "
            f"flight moves: these outputs are frozen; record the run again with the outputs of "
            f"the model",
        )
    if partly:
        yield _fault(
            f"the recording repeats one value for a part of the case in {', '.join(partly)}: these "
            f"outputs froze; record the run again with the outputs of the model",
        )


def _frozen_part(own: np.ndarray, reference: np.ndarray, least: float) -> tuple[float, float]:
    """Return the share of the samples for which an output repeats a value after it moved, and the
    movement of the flight meanwhile; zeros if the flight moves by no more than `least`. [1, SI]

    A model is at rest before its first input, so that a run at the start does not count.
    """
    repeats = np.concatenate([[False], np.diff(own) == 0.0])
    for start, stop in true_runs(repeats):
        moved = float(np.ptp(reference[start:stop]))
        if start > 1 and stop - start > FROZEN * len(own) and moved > least:
            return (stop - start) / len(own), moved
    return 0.0, 0.0


def _fault(text: str) -> RowRemark:
    return RowRemark("departure", f"departure: {text}", RECORDING_FAULT)


def _displacement(difference: np.ndarray) -> tuple[float, bool]:
    """Return the middle of a difference, and whether it is constant.

    A displacement of the whole run is a zero or an initial state, a model error grows.
    """
    offset = float(np.median(difference))
    scatter = float(np.percentile(np.abs(difference - offset), 90.0))
    return offset, scatter < STEADY * abs(offset)


def _side_text(name: str, offset: float) -> str:
    side = "above" if offset > 0.0 else "below"
    return f"{value_text(name, abs(offset), '.3g')} {side} the flight throughout"


def _increment_text(name: str, own: np.ndarray, reference: np.ndarray) -> str:
    """Return that a load factor is recorded without its one; empty if it is not."""
    offset, is_constant = _displacement(own - reference)
    if name != "nz" or not is_constant or abs(abs(offset) - 1.0) > INCREMENT:
        return ""
    given = "nz - 1, the increment" if offset < 0.0 else "nz + 1"
    return (
        f"{_side_text(name, offset)}, as if the host recorded {given}; give it offset = "
        f"{-np.sign(offset):g} in the name map of the recording"
    )


def _offset_text(name: str, own: np.ndarray, reference: np.ndarray) -> str:
    """Return by how much a channel is displaced throughout, or at the start; empty if it is not."""
    band = BANDS.get(name)
    if band is None:
        return ""
    difference = own - reference
    offset, is_constant = _displacement(difference)
    if abs(offset) > band and is_constant:
        return (
            f"{_side_text(name, offset)}: another initial state or another zero; start the device "
            f"at the {value_text(name, float(reference[0]), '.4g')} of the flight, or give the "
            f"channel an offset in the name map of the recording"
        )
    begin = float(difference[0])
    if name in STARTED and abs(begin) > band and abs(begin) > STEADY * np.ptp(reference):
        return (
            f"{value_text(name, float(own[0]), '.4g')} at the start, and the flight "
            f"{value_text(name, float(reference[0]), '.4g')}; start the device in the initial "
            f"state of the case, or cut its recording at the start of the case"
        )
    return ""


def _size_text(unit: str, own: np.ndarray, reference: np.ndarray) -> str:
    """Return how the size of a channel differs from that of the flight; empty if it does not."""
    ratio = _ratio(unit, own, reference)
    if ratio is None:
        return ""
    for file_unit, map_unit, factor in FACTORS.get(unit, ()):
        near = NEAR_DEGREES if factor > LARGE else NEAR_FACTOR
        # both directions: the file has the larger or the smaller unit
        for size, (stated, meant) in {
            factor: (map_unit, file_unit),
            1.0 / factor: (file_unit, map_unit),
        }.items():
            if abs(ratio / size - 1.0) <= near:
                return (
                    f"{abs(ratio):.3g} times that of the flight, as {meant} read as {stated} "
                    f"({size:.3g}); state its unit in the name map of the recording"
                )
    # a small mean of opposite sign is an offset
    is_large = max(abs(float(np.mean(reference))), np.ptp(reference)) > 3.0 * LEAST_MOVED[unit]
    if is_large and abs(ratio + 1.0) <= NEAR_SIGN:
        return (
            f"{ratio:.2f} times that of the flight, of opposite sign; turn its sign in the name "
            f"map of the recording"
        )
    return ""


def _ratio(unit: str, own: np.ndarray, reference: np.ndarray) -> float | None:
    """Return the size of a channel over that of the flight; None if nothing shows it."""
    middle, spread = float(np.mean(reference)), float(np.std(reference))
    if abs(middle) > LEVEL * spread and abs(middle) > LEAST_MOVED[unit]:
        return float(np.mean(own)) / middle
    if np.ptp(reference) <= LEAST_MOVED[unit] or not np.std(own) > 0.0:
        return None
    correlation = float(np.corrcoef(own, reference)[0, 1])
    if abs(correlation) < LEAST_CORRELATION:
        return None
    return float(np.copysign(np.std(own) / spread, correlation))
