"""A flight of the T-37 example as a PX4 autopilot would log it: topics, rates and fields of a
fixed-wing log, servos from -1 to 1.
"""

from pathlib import Path

import numpy as np

import flighttest

from . import ulog

DATA = Path(__file__).parents[3] / "data" / "t37"
TRAVEL = {
    "delta_a_left": 0.5,
    "delta_a_right": 0.5,
    "delta_e": -0.5,
    "delta_r": 0.5,
}  # rad for an output of 1


def write(path, stop=60.0):
    """Write the first `stop` seconds [s] of the cruise record."""
    record = flighttest.read(DATA / "flight" / "t37_02_clean_cruise_5kft.nc", DATA / "names.toml")
    imu, air, gps, controls = (
        record[leaf].to_dataset() for leaf in ("imu", "air_data", "gps", "controls")
    )
    half = {name: imu[name].values / 2.0 for name in ("phi", "theta", "psi")}
    (cp, ct, cy), (sp, st, sy) = ([f(half[name]) for name in half] for f in (np.cos, np.sin))
    attitude = [
        cp * ct * cy + sp * st * sy,
        sp * ct * cy - cp * st * sy,
        cp * st * cy + sp * ct * sy,
        cp * ct * sy - sp * st * cy,
    ]
    servos = [controls[name].values / travel for name, travel in TRAVEL.items()]
    topics = {
        "vehicle_attitude": (imu, ["q[4]"], attitude),
        "vehicle_angular_velocity": (imu, ["xyz[3]"], [imu[name].values for name in "pqr"]),
        "vehicle_acceleration": (
            imu,
            ["xyz[3]"],
            [imu[name].values for name in ("ax_imu", "ay_imu", "az_imu")],
        ),
        "airspeed_validated": (
            air,
            ["calibrated_airspeed_m_s", "true_airspeed_m_s"],
            [air["V_cas"].values, air["V"].values],
        ),
        "differential_pressure": (air, ["differential_pressure_pa"], [air["q_c"].values]),
        "vehicle_air_data": (
            air,
            ["baro_pressure_pa", "baro_alt_meter", "ambient_temperature"],
            [air["p_static"].values, air["h_baro"].values, air["temperature"].values - 273.15],
        ),
        "vehicle_gps_position": (
            gps,
            ["vel_n_m_s", "vel_e_m_s", "vel_d_m_s", "altitude_msl_m"],
            [gps[name].values for name in ("vn", "ve", "vd", "h_gps")],
        ),
        "actuator_servos": (controls, ["control[4]"], servos),
    }
    written = {}
    for topic, (leaf, fields, columns) in topics.items():
        kept = leaf["time"].values < stop
        stamps = (leaf["time"].values[kept] * 1e6).round().astype(int) + 1_000_000
        rows = [
            (int(stamp), *map(float, row))
            for stamp, *row in zip(stamps, *(column[kept] for column in columns), strict=True)
        ]
        kinds = [
            (f"float[{name.split('[')[1]}", name.split("[")[0]) if "[" in name else ("float", name)
            for name in fields
        ]
        written[topic, 0] = ([("uint64_t", "timestamp"), *kinds], rows)
    path.write_bytes(ulog.written(written))
