"""Sensors of a reconstruction: the readings of a record, grouped by clock and latency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flighttest.reconstruction.problem import output_equations
from flighttest.reconstruction.problem.problem import Model, Sensor
from flighttest.reconstruction.problem.record_inputs import RecordInputs
from flighttest.records.sensors.measurements import lies_in_windows

# m/s and s: size and memory of the sideslip velocity where no vane shows it
SIDESLIP = (3.0, 5.0)
_RADIO_MAXIMUM = 700.0  # m: highest radio altitude, where the instrument states none
_DELAY_SIGMAS = 4.0  # standard deviations of a latency that a reading may need inside its window
_CLOCK_ROUNDING = 1e-9  # s
# Index of the state variable that a channel measures.
_STATE_INDEX = {"phi": 0, "theta": 1, "psi": 2, "vn": 3, "ve": 4, "vd": 5, "h_gps": 6}


def group_sensors(inputs: RecordInputs, reference: tuple[float, float]) -> list[Sensor]:
    """Return the readings of a record, grouped by clock.

    Parameters
    ----------
    inputs : RecordInputs
    reference : (float, float)
        Reference height and the measured temperature there. [m], [K]
    """
    sensors = []
    for names in _clock_groups(inputs, list(_STATE_INDEX)):
        places = np.array([_STATE_INDEX[name] for name in names])
        model = output_equations.show_states
        sensors.append(_make_sensor(inputs, names, model=model, extra={"places": places}))
    for names in _clock_groups(inputs, inputs.vanes):
        clock, _ = inputs.channels.get(names[0])
        speed = inputs.air.speed_at(clock)
        model = output_equations.show_vanes
        sensors.append(_make_sensor(inputs, names, model=model, extra={}, speed=speed))
    for names in _clock_groups(inputs, [inputs.air.channel, "p_static"]):
        sensors.append(_air_sensor(inputs, names, reference))
    if "beta_vane" not in inputs.vanes:
        sensors.append(_sideslip_sensor(inputs))
    low = low_radio_heights(inputs)
    if low is not None:
        extra = {"arm": inputs.arm("h_radio"), "elevation": inputs.runway}
        model = output_equations.show_radio_height
        sensors.append(_make_sensor(inputs, ["h_radio"], model=model, extra=extra, usable=low))
    return [sensor for sensor in sensors if len(sensor.time)]


def low_radio_heights(inputs: RecordInputs) -> np.ndarray | None:
    """Return which radio altitudes are low enough to use (M,).

    The result is None if the record has none in its windows, or the runway elevation is unknown.
    """
    if not inputs.can_use("h_radio") or inputs.runway is None:
        return None
    clock, heights = inputs.channels.get("h_radio")
    low = heights < (inputs.specification.of("h_radio").maximum or _RADIO_MAXIMUM)
    if not (low & lies_in_windows(inputs.windows, clock)).any():
        return None
    return low


def _clock_groups(inputs: RecordInputs, names: Sequence[str]) -> list[list[str]]:
    """Return the usable channels that share a clock, a latency and a least speed.

    An instrument that states neither belongs to the first instrument of its table, because it has
    the time stamps of this instrument.
    """
    specification = inputs.specification
    usable = [name for name in names if inputs.can_use(name)]
    groups: list[list[str]] = []
    for same_clock in inputs.channels.by_leaf(usable):
        by_instrument: dict[str | None, list[str]] = {}
        first = specification.name_of(same_clock[0])
        for name in same_clock:
            item = specification.of(name)
            instrument = first
            if item.delay is not None or item.minimum_speed > 0.0:
                instrument = specification.name_of(name)
            by_instrument.setdefault(instrument, []).append(name)
        groups += by_instrument.values()
    return groups


def _make_sensor(
    inputs: RecordInputs,
    names: Sequence[str],
    model: Model,
    extra: dict[str, Any],
    speed: np.ndarray | None = None,
    usable: np.ndarray | None = None,
) -> Sensor:
    """Return a sensor with the readings that can be used.

    Readings stay inside their window for every latency that the prior allows. They are not spikes,
    belong to the mask `usable` (M,) and to speeds (M,) above the minimum of the instrument.
    """
    item = inputs.specification.of(names[0])
    clock, _ = inputs.channels.get(names[0])
    z = np.stack([inputs.channels.get(name)[1] for name in names], axis=1)
    mean, sigma = item.delay or (0.0, 0.0)
    early = clock - (mean + _DELAY_SIGMAS * sigma)
    late = clock - (mean - _DELAY_SIGMAS * sigma)
    inside = np.zeros(len(clock), bool)
    for start, stop in inputs.windows:
        inside |= (early >= start - _CLOCK_ROUNDING) & (late <= stop + _CLOCK_ROUNDING)
    if speed is not None:
        inside &= speed > item.minimum_speed
    if usable is not None:
        inside &= usable
    inside &= ~np.any([inputs.channels.spikes(name) for name in names], axis=0)
    if "temperature" in extra:
        # the one argument with a value per reading
        extra = extra | {"temperature": extra["temperature"][inside]}
    return Sensor(
        names=tuple(names),
        time=clock[inside],
        z=z[inside],
        sigma=np.array([inputs.specification.noise(name) for name in names]),
        model=model,
        delay=inputs.specification.delay_of(names[0]),
        extra=extra,
    )


def _air_sensor(
    inputs: RecordInputs, names: Sequence[str], reference: tuple[float, float]
) -> Sensor:
    """Return the sensor of airspeed and static pressure."""
    air = inputs.air
    clock, _ = inputs.channels.get(names[0])
    extra = {"temperature": np.interp(clock, air.time, air.temperature), "reference": reference}
    if inputs.specification.of(air.channel).position is not None:
        extra["arm"] = inputs.arm(air.channel)
    speed = np.interp(clock, air.time, air.speed)
    return _make_sensor(inputs, names, model=output_equations.air_data, extra=extra, speed=speed)


def _sideslip_sensor(inputs: RecordInputs) -> Sensor:
    """Return a weak reading of zero sideslip, one per memory time.

    Why: an aeroplane does not fly sideways for long.
    """
    size, memory = SIDESLIP
    clock = np.concatenate([np.arange(start, stop, memory) for start, stop in inputs.windows])
    return Sensor(
        names=("v",),
        time=clock,
        z=np.zeros((len(clock), 1)),
        sigma=np.array([size]),
        model=output_equations.no_sideslip,
    )
