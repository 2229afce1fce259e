"""Stated errors of instruments that no instrument has: mostly degrees or per cent without a unit.

An instrument with an error of that size determines nothing: the reconstruction follows the other
channels, and every interval is wide, without a failure.
"""

from __future__ import annotations

from collections.abc import Iterator

from flightmech.errors import UnknownName
from flightmech.names import lookup, value_text
from flighttest.reconstruction.quality.finding import Finding
from flighttest.records.sensors.instruments import Instrument, Instruments

# From ten to a hundred times what poor instruments of flight tests have. [SI]
_LARGEST = {
    "rad": 0.1,
    "rad s-1": 0.02,
    "m s-2": 3.0,
    "m s-1": 20.0,
    "m": 500.0,
    "Pa": 5000.0,
    "K": 30.0,
}
_SCALE = 0.2  # standard error of a scale, of an upwash factor, and of a static pressure [1]
_EARLIEST = 2.0  # standard errors by which a lag or delay may be negative
_LATEST = 5.0  # lag or delay of an instrument [s]
_REMEDY = "correct the number, or write its unit: a number without one is in SI, and a share in 1"


def instrument_size_findings(specification: Instruments | None) -> list[Finding]:
    """Return the warnings of stated errors that are too large for any instrument.

    Parameters
    ----------
    specification : Instruments or None

    Returns
    -------
    list of Finding
        Of kind ``instrument``; one for each number.
    """
    findings = []
    for name, instrument in (specification.table if specification is not None else {}).items():
        for channel, text in _excesses(instrument):
            channels = (channel,) if channel else ()
            text = f"instruments.{name}: {text}"
            findings.append(Finding("warning", "instrument", channels, text, _REMEDY))
    return findings


def _excesses(instrument: Instrument) -> Iterator[tuple[str, str]]:
    """Yield the channel, and what is too large."""
    for key in ("noise", "bias_sigma"):
        for channel, size in getattr(instrument, key).items():
            try:
                largest = _LARGEST.get(lookup(channel).units)
            except UnknownName:
                continue
            if largest is not None and size > largest:
                shown, limit = value_text(channel, size), value_text(channel, largest)
                yield channel, f"{key} of {channel} is {shown}; instruments have less than {limit}"
    for channel, size in instrument.scale_sigma.items():
        if size > _SCALE:
            yield channel, f"scale_sigma of {channel} is {size:g}, which is {100.0 * size:g} %"
    for channel, (mean, size) in instrument.factor.items():
        if not 0.5 <= mean <= 2.0 or size > _SCALE:
            yield channel, f"factor of {channel} is {mean:g} +- {size:g}; usual is 1.05 +- 0.05"
    for key in ("lag", "delay"):
        times = getattr(instrument, key)
        if times is not None and max(abs(times[0]), times[1]) > _LATEST:
            yield "", f"{key} is {times[0]:g} +- {times[1]:g} s; instruments have less than 1 s"
        # a small negative delay is one relative to the clock of the record
        elif times is not None and times[0] < -_EARLIEST * times[1]:
            yield (
                "",
                f"{key} is {times[0]:g} +- {times[1]:g} s; an instrument is late, so it is > 0",
            )
    if instrument.static_error is not None:
        mean, size = instrument.static_error
        if max(abs(mean), size) > _SCALE:
            yield "", f"static_error is {mean:g} +- {size:g} of the impact pressure, a share"
