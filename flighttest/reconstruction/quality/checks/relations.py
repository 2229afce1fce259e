"""Relations of kinematics and of the atmosphere between the channels of a record.

Each relation computes one quantity twice, from different channels.  Both sides agree to noise, wind
and neglected effects (sideslip, sensor positions) if every channel has its sign, unit and axis.  A
mistake in any of these makes the sides disagree grossly.  Relations overlap, so that
`mistake_search` can find the one channel that explains all disagreements.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from flightmech.air import calibrated_airspeed
from flighttest.reconstruction.quality.checks import relation_sides as sides
from flighttest.reconstruction.quality.checks.formed_channels import describe_channel
from flighttest.reconstruction.quality.checks.relation_check import Relation, RelationCheck
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.records.sensors.measurements import pressure


def compare_all(signals: ResampledChannels) -> dict[str, RelationCheck]:
    """Return the checks of all relations that the record determines, by name."""
    checks = {}
    for relation in RELATIONS:
        check = relation.compare(signals)
        if check is not None:
            checks[relation.name] = check
    return checks


def not_checked(signals: ResampledChannels) -> pd.DataFrame:
    """Return the relations that a record does not determine, with the reason.

    Returns
    -------
    DataFrame
        ``relation title missing reason``; `missing` are the channels that are absent. It is empty
        if the channels are valid for too short a time.
    """
    table: list = []
    for relation in RELATIONS:
        missing = relation.missing(signals)
        if missing:
            channels = [describe_channel(name, name in relation.formed) for name in missing]
            table.append(
                (relation.name, relation.title, missing, "not recorded: " + "; ".join(channels))
            )
            continue
        seconds = float(relation.mask(signals).sum() * signals.step)
        if seconds < relation.shortest:
            reason = (
                f"{', '.join(relation.channels(signals))} are whole together for {seconds:.1f} s "
                f"of flight; {relation.shortest:.0f} s are needed"
            )
            table.append((relation.name, relation.title, missing, reason))
    return pd.DataFrame(table, columns=["relation", "title", "missing", "reason"])


_ATTITUDE = ("phi", "theta", "p", "q", "r")
_EARTH = ("phi", "theta", "psi", "vn", "ve", "vd")
# channels that a relation of air data may use as formed ones; V itself is never formed for it
_PRESSURES = ("q_c", "p_static", "temperature")
_NO_WIND = 0.25  # limit of the relations that hold in still air only

# cut-offs exclude what sensor positions, flexibility and delays add; tolerances cover noise, wind
# and neglected sideslip
RELATIONS: tuple[Relation, ...] = (
    Relation(
        name="phi_rate",
        title="rate of bank, and p q r",
        needs=_ATTITUDE,
        sides=sides.bank_rate,
        units="rad s-1",
        cutoff=1.5,
        tolerance=0.005,
    ),
    Relation(
        name="theta_rate",
        title="rate of pitch attitude, and q r",
        needs=("phi", "theta", "q", "r"),
        sides=sides.pitch_rate,
        units="rad s-1",
        cutoff=1.5,
        tolerance=0.005,
    ),
    Relation(
        name="psi_rate",
        title="rate of heading, and q r",
        needs=("phi", "theta", "psi", "q", "r"),
        sides=sides.heading_rate,
        units="rad s-1",
        cutoff=1.0,
        tolerance=0.005,
    ),
    Relation(
        name="force_x",
        title="ax, and ground acceleration",
        needs=(*_EARTH, "ax_imu"),
        sides=sides.inertial_force(0, "ax_imu"),
        units="m s-2",
        cutoff=0.25,
        tolerance=0.15,
    ),
    Relation(
        name="force_y",
        title="ay, and ground acceleration",
        needs=(*_EARTH, "ay_imu"),
        sides=sides.inertial_force(1, "ay_imu"),
        units="m s-2",
        cutoff=0.25,
        tolerance=0.25,
        limit=0.45,
    ),
    Relation(
        name="force_z",
        title="az, and ground acceleration",
        needs=(*_EARTH, "az_imu"),
        sides=sides.inertial_force(2, "az_imu"),
        units="m s-2",
        cutoff=0.25,
        tolerance=0.25,
        level=True,
        limit=0.1,
    ),
    Relation(
        name="vertical",
        title="acceleration of height, and ax ay az",
        needs=("h_baro", "phi", "theta", "ax_imu", "ay_imu", "az_imu"),
        sides=sides.vertical_acceleration,
        units="m s-2",
        cutoff=0.1,
        tolerance=0.6,
        level=True,
        limit=0.4,
    ),
    Relation(
        name="along",
        title="rate of airspeed, and ax az",
        needs=("V", "phi", "theta", "ax_imu", "az_imu"),
        sides=sides.airspeed_rate,
        units="m s-2",
        cutoff=0.2,
        tolerance=0.25,
        limit=0.4,
        optional=("alpha_vane", "h_baro"),
    ),
    Relation(
        name="turn",
        title="yaw rate times airspeed, and bank",
        needs=("V", "phi", "theta", "p", "r"),
        sides=sides.lateral_turn,
        units="m s-2",
        cutoff=0.08,
        tolerance=0.6,
        level=True,
        limit=0.4,
        optional=("alpha_vane", "ay_imu"),
    ),
    Relation(
        name="pull",
        title="pitch rate times airspeed, and az",
        needs=("V", "phi", "theta", "q", "az_imu"),
        sides=sides.pull_up,
        units="m s-2",
        cutoff=0.08,
        tolerance=0.6,
        level=True,
        limit=0.4,
    ),
    Relation(
        name="heave",
        title="rate of the alpha vane, and q az",
        needs=("alpha_vane", "V", "phi", "theta", "q", "az_imu"),
        sides=sides.vane_heave,
        units="m s-2",
        cutoff=0.6,
        tolerance=0.7,
        limit=0.45,
    ),
    Relation(
        name="vane",
        title="alpha vane, and attitude less climb",
        needs=("alpha_vane", "phi", "theta", "h_baro", "V"),
        sides=sides.vane_attitude,
        units="rad",
        cutoff=0.2,
        tolerance=0.01,
        level=True,
    ),
    Relation(
        name="slip",
        title="rate of the beta vane, and r p bank ay",
        needs=("beta_vane", "V", "phi", "theta", "p", "r", "ay_imu"),
        sides=sides.vane_slip,
        units="m s-2",
        cutoff=0.6,
        tolerance=0.5,
        limit=0.45,
        optional=("alpha_vane", "h_baro"),
    ),
    Relation(
        name="track_n",
        title="ground velocity north, and heading",
        needs=("vn", "V", "psi", "theta"),
        sides=lambda s: (s["vn"], s["V"] * np.cos(s["psi"]) * np.cos(s["theta"])),
        units="m s-1",
        cutoff=0.2,
        tolerance=12.0,
        level=True,
        limit=_NO_WIND,
    ),
    Relation(
        name="track_e",
        title="ground velocity east, and heading",
        needs=("ve", "V", "psi", "theta"),
        sides=lambda s: (s["ve"], s["V"] * np.sin(s["psi"]) * np.cos(s["theta"])),
        units="m s-1",
        cutoff=0.2,
        tolerance=12.0,
        level=True,
        limit=_NO_WIND,
    ),
    Relation(
        name="climb",
        title="-vd, and rate of pressure height",
        needs=("vd", "h_baro"),
        sides=lambda s: (-s["vd"], sides.rate_of(s, "h_baro")),
        units="m s-1",
        cutoff=0.2,
        tolerance=0.5,
    ),
    Relation(
        name="climb_rate",
        title="climb rate, and rate of pressure height",
        needs=("hdot", "h_baro"),
        sides=lambda s: (s["hdot"], sides.rate_of(s, "h_baro")),
        units="m s-1",
        cutoff=0.2,
        tolerance=0.5,
    ),
    Relation(
        name="heights",
        title="satellite height, and pressure height",
        needs=("h_gps", "h_baro"),
        sides=lambda s: (s["h_gps"], s["h_baro"]),
        units="m",
        cutoff=0.2,
        tolerance=5.0,
        limit=0.2,
    ),
    Relation(
        name="airspeed",
        title="true airspeed, and impact pressure",
        needs=("V", "q_c", "p_static", "temperature"),
        sides=lambda s: (s["V"], sides.mach_of_pressures(s) * sides.speed_of_sound(s)),
        units="m s-1",
        cutoff=0.5,
        tolerance=5.0,
        level=True,
        limit=0.05,
        formed=_PRESSURES,
    ),
    Relation(
        name="mach",
        title="Mach number, and airspeed over speed of sound",
        needs=("mach", "V", "temperature"),
        sides=lambda s: (s["mach"], s["V"] / sides.speed_of_sound(s)),
        units="1",
        cutoff=0.5,
        tolerance=0.01,
        level=True,
        limit=0.05,
        formed=("temperature",),
    ),
    Relation(
        name="mach_pressure",
        title="Mach number, and impact pressure",
        needs=("mach", "q_c", "p_static"),
        sides=lambda s: (s["mach"], sides.mach_of_pressures(s)),
        units="1",
        cutoff=0.5,
        tolerance=0.01,
        level=True,
        limit=0.05,
        formed=("q_c", "p_static"),
    ),
    Relation(
        name="calibrated",
        title="calibrated airspeed, and impact pressure",
        needs=("V_cas", "q_c"),
        sides=lambda s: (s["V_cas"], calibrated_airspeed(np.clip(s["q_c"], 0.0, 1e6))),
        units="m s-1",
        cutoff=0.5,
        tolerance=5.0,
        level=True,
        limit=0.05,
        formed=(),
    ),
    Relation(
        name="altitude",
        title="static pressure, and pressure height",
        needs=("p_static", "h_baro"),
        sides=lambda s: (s["p_static"], pressure(np.clip(s["h_baro"], -2000.0, 30000.0))),
        units="Pa",
        cutoff=0.5,
        tolerance=100.0,
        level=True,
        limit=0.03,
        formed=(),
    ),
)
