"""Fit the static thrust table ``thrust.nc`` and the time constant of ``aircraft.toml`` to the recordings in ``flight/``.

    python data/t37/make_thrust.py
"""

from pathlib import Path

import numpy as np

import flighttest

HERE = Path(__file__).parent
AXES = {"throttle": [0.0, 0.2, 0.4, 0.6, 0.8, 1.0], "mach": [0.0, 0.2, 0.45], "h": [0.0, 1500.0, 6200.0]}


def conditions(path: Path):
    """Return a recording at 10 Hz with Mach number and height, from the channels as recorded."""
    record = flighttest.read(path, HERE / "names.toml")
    data = flighttest.cut(record, 0.0, min(float(leaf["time"][-1]) for leaf in record.children.values()), rate=10.0)
    return data.assign(mach=data["V"] / np.sqrt(1.4 * 287.05287 * data["temperature"]), h=data["h_gps"])


fit = flighttest.fit_thrust([conditions(path) for path in sorted((HERE / "flight").glob("*.nc"))], AXES, engines=(1, 2))
fit.leaf.attrs["comment"] = "fitted by make_thrust.py to the recorded thrust of all runs, mean of both engines"
fit.leaf.to_netcdf(HERE / "thrust.nc", engine="h5netcdf")
print(f"time constant {fit.time_constant:.2f} s; residual {fit.rms_settled:.0f} N settled, {fit.rms:.0f} N all, of {fit.span:.0f} N")
