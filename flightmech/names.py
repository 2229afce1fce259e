"""Vocabulary of the product: name, unit, positive sense and description of each quantity.

Names are the usual symbols in ASCII. Angles are in radians. Names of AIAA S-119 are listed for
quantities that the standard defines. A quantity of one engine has a prefix: ``engine1.thrust``.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from flightmech.errors import UnknownName
from flightmech.units import from_si


class Quantity(NamedTuple):
    """One row of the vocabulary.

    Its fields are name, SI unit, positive sense, description, AIAA S-119 name and display unit.
    """

    name: str
    units: str
    sign: str
    long_name: str
    s119: str
    display_units: str


SIGNS = {
    "ANU": "aircraft nose up",
    "ANR": "aircraft nose right",
    "RWD": "right wing down",
    "FWD": "forward",
    "RT": "right",
    "DN": "down",
    "TED": "trailing edge down",
    "TEL": "trailing edge left",
}
"""Meaning of the abbreviations of positive senses (AIAA S-119)."""

# name, SI unit, positive sense, description, AIAA S-119 name, display unit
# fmt: off
_ROWS = [
    ("time", "s", "", "time from the start of the run", "time", "s"),
    # air-relative motion
    ("V", "m s-1", "", "true airspeed", "trueAirspeed", "kt"),
    ("V_cas", "m s-1", "", "calibrated airspeed", "", "kt"),
    ("V_eas", "m s-1", "", "equivalent airspeed", "equivalentAirspeed", "kt"),
    ("V_ground", "m s-1", "", "ground speed", "", "kt"),
    ("mach", "1", "", "Mach number", "mach", "1"),
    ("qbar", "Pa", "", "dynamic pressure", "dynamicPressure", "Pa"),
    ("q_c", "Pa", "", "impact pressure", "", "Pa"),
    ("alpha", "rad", "ANU", "angle of attack", "angleOfAttack", "deg"),
    ("beta", "rad", "wind from right", "angle of sideslip", "angleOfSideslip", "deg"),
    ("alpha_dot", "rad s-1", "ANU", "rate of angle of attack", "angleOfAttackRate", "deg/s"),
    ("beta_dot", "rad s-1", "wind from right", "rate of angle of sideslip", "angleOfSideslipRate",
     "deg/s"),
    ("u", "m s-1", "FWD", "air-relative velocity along body x", "", "m s-1"),
    ("v", "m s-1", "RT", "air-relative velocity along body y", "", "m s-1"),
    ("w", "m s-1", "DN", "air-relative velocity along body z", "", "m s-1"),
    # rotation and attitude
    ("p", "rad s-1", "RWD", "body roll rate", "bodyAngularRate_Roll", "deg/s"),
    ("q", "rad s-1", "ANU", "body pitch rate", "bodyAngularRate_Pitch", "deg/s"),
    ("r", "rad s-1", "ANR", "body yaw rate", "bodyAngularRate_Yaw", "deg/s"),
    ("p_dot", "rad s-2", "RWD", "body roll acceleration", "", "deg/s2"),
    ("q_dot", "rad s-2", "ANU", "body pitch acceleration", "", "deg/s2"),
    ("r_dot", "rad s-2", "ANR", "body yaw acceleration", "", "deg/s2"),
    ("psi_dot", "rad s-1", "clockwise from above", "rate of turn", "", "deg/s"),
    ("Omega", "rad s-1", "RWD", "rate of rotation about the flight path", "", "deg/s"),
    ("p_osc", "rad s-1", "RWD", "body roll rate without the rotation about the flight path", "",
     "deg/s"),
    ("q_osc", "rad s-1", "ANU", "body pitch rate without the rotation about the flight path", "",
     "deg/s"),
    ("r_osc", "rad s-1", "ANR", "body yaw rate without the rotation about the flight path", "",
     "deg/s"),
    ("r_wind", "rad s-1", "ANR", "rate of rotation about the wind z axis", "", "deg/s"),
    ("phi", "rad", "RWD", "bank angle", "eulerAngle_Roll", "deg"),
    ("theta", "rad", "ANU", "pitch attitude", "eulerAngle_Pitch", "deg"),
    ("psi", "rad", "clockwise from north", "true heading", "eulerAngle_Yaw", "deg"),
    ("gamma", "rad", "up", "flight-path angle relative to the ground", "", "deg"),
    # acceleration: specific force, gravity excluded
    ("ax", "m s-2", "FWD", "specific force at the c.g. along body x", "", "g"),
    ("ay", "m s-2", "RT", "specific force at the c.g. along body y", "", "g"),
    ("az", "m s-2", "DN", "specific force at the c.g. along body z", "", "g"),
    ("nz", "1", "up", "load factor at the c.g., -az/g0", "", "1"),
    ("dnz", "1", "up", "load factor minus one", "", "1"),
    # position and ground-relative motion
    ("h", "m", "up", "height of the c.g. over mean sea level", "altitudeMsl", "ft"),
    ("h_agl", "m", "up", "height of the moment reference point over the runway", "", "ft"),
    ("runway_elevation", "m", "up", "height of the runway over mean sea level", "", "ft"),
    ("hdot", "m s-1", "up", "climb rate", "altitudeRateWrtMsl", "ft/min"),
    ("lat", "rad", "north", "geodetic latitude", "latitude", "deg"),
    ("lon", "rad", "east", "longitude", "longitude", "deg"),
    ("north", "m", "north", "position north of the start", "", "m"),
    ("east", "m", "east", "position east of the start", "", "m"),
    ("distance", "m", "", "distance over the ground from the start", "", "ft"),
    ("y_runway", "m", "right", "distance to the right of the track at the start", "", "ft"),
    ("turn_radius", "m", "", "radius of the path over the ground", "", "ft"),
    ("gradient", "1", "up", "height gained over horizontal distance through the air", "", "%"),
    ("vn", "m s-1", "north", "ground velocity north", "", "m s-1"),
    ("ve", "m s-1", "east", "ground velocity east", "", "m s-1"),
    ("vd", "m s-1", "down", "ground velocity down", "", "m s-1"),
    # atmosphere
    ("rho", "kg m-3", "", "air density", "airDensity", "kg m-3"),
    ("p_static", "Pa", "", "ambient pressure", "ambientPressure", "hPa"),
    ("temperature", "K", "", "ambient temperature", "ambientTemperature", "degC"),
    ("a_sound", "m s-1", "", "speed of sound", "speedOfSound", "m s-1"),
    ("wind_n", "m s-1", "towards north", "velocity of the air mass, north", "", "m s-1"),
    ("wind_e", "m s-1", "towards east", "velocity of the air mass, east", "", "m s-1"),
    ("wind_d", "m s-1", "downward", "velocity of the air mass, down", "", "m s-1"),
    ("delta_T", "K", "warmer", "temperature offset from the standard atmosphere", "", "K"),
    # instruments: as recorded, before correction
    ("alpha_vane", "rad", "ANU", "angle of attack shown by the vane, atan(w/u) at the vane", "",
     "deg"),
    ("beta_vane", "rad", "wind from right", "flank angle shown by the vane, atan(v/u) at the vane",
     "", "deg"),
    ("ax_imu", "m s-2", "FWD", "specific force at the inertial unit along body x", "", "g"),
    ("ay_imu", "m s-2", "RT", "specific force at the inertial unit along body y", "", "g"),
    ("az_imu", "m s-2", "DN", "specific force at the inertial unit along body z", "", "g"),
    ("h_baro", "m", "up", "pressure altitude, 1013.25 hPa", "", "ft"),
    ("h_radio", "m", "up", "radio altitude: height of the antenna over the runway", "", "ft"),
    ("h_gps", "m", "up", "satellite height of the c.g. over mean sea level", "", "ft"),
    # controls and configuration
    ("delta_e", "rad", "TED", "elevator deflection", "elevatorDeflection", "deg"),
    ("delta_a", "rad", "right TED, left roll", "aileron deflection, (right - left)/2",
     "aileronDeflection", "deg"),
    ("delta_a_left", "rad", "TED", "left aileron deflection", "", "deg"),
    ("delta_a_right", "rad", "TED", "right aileron deflection", "", "deg"),
    ("delta_r", "rad", "TEL", "rudder deflection", "rudderDeflection", "deg"),
    ("delta_f", "rad", "TED", "flap deflection", "", "deg"),
    ("delta_f_left", "rad", "TED", "left flap deflection", "", "deg"),
    ("delta_f_right", "rad", "TED", "right flap deflection", "", "deg"),
    ("delta_t", "rad", "TED", "elevator trim-tab deflection", "", "deg"),
    ("delta_ta", "rad", "TED", "aileron trim-tab deflection", "", "deg"),
    ("delta_tr", "rad", "TEL", "rudder trim-tab deflection", "", "deg"),
    ("i_h", "rad", "leading edge up", "horizontal-stabilizer incidence", "", "deg"),
    ("trim_rate", "rad s-1", "as the trim surface", "rate of the pitch-trim surface", "", "deg/s"),
    ("trim_indicator", "1", "nose up", "pitch-trim indicator in the cockpit", "", "1"),
    ("delta_s", "1", "left up, left roll", "spoiler height, left minus right, fraction of the "
        "local chord", "", "1"),
    ("delta_sp", "rad", "left up, left roll", "roll-spoiler deflection, left minus right", "",
     "deg"),
    ("delta_d", "rad", "right TED, left roll", "differential stabilizer deflection, (right - "
        "left)/2", "", "deg"),
    ("delta_nw", "rad", "right", "nose-wheel steering command", "", "deg"),
    ("gear.steering", "rad", "right", "steering angle of the nose wheel", "", "deg"),
    ("gear", "1", "out", "undercarriage extension, 0 in, 1 out", "", "1"),
    ("speedbrake", "1", "out", "speed-brake extension, 0 in, 1 out", "", "1"),
    ("brake", "1", "on", "wheel-brake pedal", "", "1"),
    ("brake_left", "1", "on", "left wheel-brake pedal", "", "1"),
    ("brake_right", "1", "on", "right wheel-brake pedal", "", "1"),
    ("column", "m", "aft", "control-column travel", "", "cm"),
    ("wheel", "rad", "right", "control-wheel travel", "", "deg"),
    ("pedal", "m", "right foot", "pedal travel", "", "cm"),
    ("F_column", "N", "pull", "pilot force on the column", "", "lbf"),
    ("F_wheel", "N m", "right", "pilot torque on the wheel", "", "N m"),
    ("F_pedal", "N", "right foot", "pilot force on the pedals", "", "lbf"),
    ("wheel_radius", "m", "", "radius at which the pilot holds the control wheel", "", "cm"),
    ("F_rim", "N", "right", "pilot force at the rim of the wheel, torque over radius", "", "lbf"),
    ("deflection", "rad", "as its source has it", "deflection of a further control, "
        "device.body_flap.deflection", "", "deg"),
    ("setting", "1", "as its source has it", "setting of a further control, device.spike.setting",
     "", "1"),
    ("tiller", "rad", "right", "nose-wheel tiller travel", "", "deg"),
    ("F_tiller", "N", "right", "pilot force on the tiller", "", "lbf"),
    ("F_brake", "N", "forward", "pilot force on the brake pedal", "", "lbf"),
    ("p_brake", "Pa", "", "hydraulic pressure at the wheel brake", "", "psi"),
    ("stall_warning", "1", "on", "stall warning or stick shaker, 0 off, 1 on", "", "1"),
    ("buffet", "1", "on", "buffet that the crew feels, 0 none, 1 felt", "", "1"),
    ("wow_nose", "1", "on ground", "nose wheel on the ground", "", "1"),
    ("wow_left", "1", "on ground", "left main wheel on the ground", "", "1"),
    ("wow_right", "1", "on ground", "right main wheel on the ground", "", "1"),
    ("compression", "m", "in", "compression of the strut", "", "cm"),
    # power plant, one per engine
    ("throttle", "1", "forward", "power lever, 0 idle, 1 full", "", "%"),
    ("pla", "rad", "forward", "power-lever angle", "", "deg"),
    ("n1", "1", "", "low-pressure rotor speed, fraction", "", "%"),
    ("n2", "1", "", "high-pressure rotor speed, fraction", "", "%"),
    ("fuel_flow", "kg s-1", "", "fuel flow", "", "lb/h"),
    ("thrust", "N", "FWD", "net thrust", "thrustBodyForce_X", "lbf"),
    ("gross_thrust", "N", "FWD", "thrust along the thrust line, before ram drag", "", "lbf"),
    ("ram_drag", "N", "aft", "momentum of the air taken in", "", "lbf"),
    ("air_flow", "kg s-1", "", "air flow through the engine", "", "kg s-1"),
    ("itt", "K", "", "inter-turbine temperature", "", "degC"),
    ("epr", "1", "", "engine pressure ratio", "", "1"),
    ("torque", "N m", "", "torque of the propeller shaft", "", "N m"),
    ("manifold_pressure", "Pa", "", "pressure in the intake manifold", "", "hPa"),
    ("prop_lever", "m", "forward", "travel of the propeller lever", "", "in"),
    ("prop_command", "1", "forward", "propeller lever, 0 lowest, 1 highest speed or blade angle",
     "", "%"),
    ("feather", "1", "", "feathering, 0 off, 1 on", "", "1"),
    ("rpm", "rad s-1", "", "speed of the propeller", "", "rpm"),
    ("engine_rpm", "rad s-1", "", "speed of the engine in front of the gearbox of the propeller",
     "", "rpm"),
    ("blade_angle", "rad", "coarse", "blade angle of the propeller", "", "deg"),
    ("J", "1", "FWD", "advance ratio of the propeller, V/(n D)", "", "1"),
    ("tip_mach", "1", "", "Mach number of the helical path of the blade tips", "", "1"),
    ("CT_prop", "1", "FWD", "thrust coefficient of the propeller, T/(rho n^2 D^4)", "", "1"),
    ("CP_prop", "1", "", "power coefficient of the propeller, P/(rho n^3 D^5)", "", "1"),
    ("shaft_power", "W", "", "power at the shaft of the propeller", "", "kW"),
    ("mixture", "1", "forward", "mixture lever, 0 lean, 1 rich", "", "%"),
    ("fuel_air_ratio", "1", "", "mass of fuel over mass of air", "", "1"),
    ("density_ratio", "1", "", "density of the air over 1.225 kg/m3", "", "1"),
    ("current", "A", "", "current of the battery", "", "A"),
    ("battery_voltage", "V", "", "voltage of the battery under load", "", "V"),
    ("charge", "1", "", "charge of the battery, fraction", "", "%"),
    ("corrected_n1", "1", "", "n1 over the root of temperature_ratio", "", "%"),
    ("corrected_n2", "1", "", "n2 over the root of temperature_ratio", "", "%"),
    ("temperature_ratio", "1", "", "total temperature of the air over 288.15 K", "", "1"),
    ("pressure_ratio", "1", "", "ambient pressure over 101325 Pa", "", "1"),
    ("burning", "1", "", "flame, 0 out, 1 burning", "", "1"),
    ("cutoff", "1", "", "fuel lever, 0 open, 1 cut off", "", "1"),
    ("starter", "1", "", "starter with its ignition, 0 off, 1 on", "", "1"),
    ("ignition", "1", "", "ignition, 0 off, 1 on", "", "1"),
    ("flameout", "1", "", "failure that puts the flame out, 0 none, 1 out", "", "1"),
    ("fuel", "kg", "", "fuel on board", "", "lb"),
    ("crossfeed", "1", "", "cross-feed valve of the fuel, 0 shut, 1 open", "", "1"),
    ("pump", "1", "", "pump from tank to tank, 0 off, 1 on", "", "1"),
    ("fuel_used", "kg", "", "fuel burned from the start", "", "lb"),
    # coefficients
    ("CL", "1", "up", "lift coefficient, stability axes", "liftCoefficient", "1"),
    ("CD", "1", "aft", "drag coefficient, stability axes", "dragCoefficient", "1"),
    ("CY", "1", "RT", "side-force coefficient, body axes", "sideforceCoefficient", "1"),
    ("CX", "1", "FWD", "force coefficient along body x", "aeroBodyForceCoefficient_X", "1"),
    ("CZ", "1", "DN", "force coefficient along body z", "aeroBodyForceCoefficient_Z", "1"),
    ("Cl", "1", "RWD", "rolling-moment coefficient, body axes, span b",
     "aeroBodyMomentCoefficient_Roll", "1"),
    ("Cm", "1", "ANU", "pitching-moment coefficient, body axes, mean chord cbar",
     "aeroBodyMomentCoefficient_Pitch", "1"),
    ("Cn", "1", "ANR", "yawing-moment coefficient, body axes, span b",
     "aeroBodyMomentCoefficient_Yaw", "1"),
    ("Ch_e", "1", "TED", "hinge-moment coefficient of the elevator, on qbar and S_hinge c_hinge "
        "of the control", "", "1"),
    ("Ch_a", "1", "as delta_a", "hinge-moment coefficient of the aileron, on qbar and S_hinge "
        "c_hinge of the control", "", "1"),
    ("Ch_r", "1", "TEL", "hinge-moment coefficient of the rudder, on qbar and S_hinge c_hinge of "
        "the control", "", "1"),
    ("CT", "1", "FWD", "thrust coefficient: net thrust of all engines over qbar S", "", "1"),
    # reduced rates
    ("phat", "1", "RWD", "reduced roll rate, p b/(2 V)", "", "1"),
    ("qhat", "1", "ANU", "reduced pitch rate, q cbar/(2 V)", "", "1"),
    ("rhat", "1", "ANR", "reduced yaw rate, r b/(2 V)", "", "1"),
    ("alphadothat", "1", "ANU", "reduced rate of angle of attack, alpha_dot cbar/(2 V)", "", "1"),
    ("betadothat", "1", "wind from right", "reduced rate of sideslip, beta_dot b/(2 V)", "", "1"),
    ("Omegahat", "1", "RWD", "reduced rate about the flight path, Omega b/(2 V)", "", "1"),
    ("phat_osc", "1", "RWD", "reduced p_osc, p_osc b/(2 V)", "", "1"),
    ("qhat_osc", "1", "ANU", "reduced q_osc, q_osc cbar/(2 V)", "", "1"),
    ("rhat_osc", "1", "ANR", "reduced r_osc, r_osc b/(2 V)", "", "1"),
    ("rhat_wind", "1", "ANR", "reduced r_wind, r_wind b/(2 V)", "", "1"),
    # flow separation of the wing halves
    ("X", "1", "attached", "separation point of the flow in chords, mean of both wing halves", "",
     "1"),
    ("X_left", "1", "attached", "separation point on the left wing half, in chords", "", "1"),
    ("X_right", "1", "attached", "separation point on the right wing half, in chords", "", "1"),
    ("X_diff", "1", "left attached", "separation point, left wing half minus right", "", "1"),
    ("X_lift", "1", "attached", "Kirchhoff factor of the lift, ((1 + sqrt X)/2)^2, mean of both "
        "wing halves", "", "1"),
    ("X_lift_diff", "1", "left attached", "Kirchhoff factor of the lift, left wing half minus "
        "right", "", "1"),
    # joints of a vehicle of several bodies, joint.NAME.angle
    ("angle", "rad", "right-handed about its axis", "angle of a joint", "", "deg"),
    ("angle_rate", "rad s-1", "right-handed about its axis", "rate of the angle of a joint", "",
     "deg/s"),
    # aircraft
    ("S", "m2", "", "reference wing area", "referenceWingArea", "m2"),
    ("cbar", "m", "", "reference chord", "referenceWingChord", "m"),
    ("b", "m", "", "reference span", "referenceWingSpan", "m"),
    ("mass", "kg", "", "gross mass", "totalMass", "kg"),
    ("Ixx", "kg m2", "", "moment of inertia in roll", "bodyMomentOfInertia_Roll", "kg m2"),
    ("Iyy", "kg m2", "", "moment of inertia in pitch", "bodyMomentOfInertia_Pitch", "kg m2"),
    ("Izz", "kg m2", "", "moment of inertia in yaw", "bodyMomentOfInertia_Yaw", "kg m2"),
    ("Ixy", "kg m2", "integral of xy dm", "product of inertia", "bodyProductOfInertia_XY", "kg m2"),
    ("Ixz", "kg m2", "integral of xz dm", "product of inertia", "bodyProductOfInertia_XZ", "kg m2"),
    ("Iyz", "kg m2", "integral of yz dm", "product of inertia", "bodyProductOfInertia_YZ", "kg m2"),
    ("x_cg", "1", "aft", "c.g. behind the leading edge of the mean chord, in chords", "", "%"),
    ("x_cg_b", "m", "FWD", "c.g. forward of the moment reference point", "", "m"),
    ("y_cg_b", "m", "RT", "c.g. right of the moment reference point", "", "m"),
    ("z_cg_b", "m", "DN", "c.g. below the moment reference point", "", "m"),
]
# fmt: on

VOCABULARY: dict[str, Quantity] = {row[0]: Quantity(*row) for row in _ROWS}
COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
REDUCED_RATES = {
    "phat": ("p", "b"),
    "qhat": ("q", "cbar"),
    "rhat": ("r", "b"),
    "alphadothat": ("alpha_dot", "cbar"),
    "betadothat": ("beta_dot", "b"),
}
"""Reduced rate: the rate and the reference length in rate * length / (2 V)."""
IMPLICIT = ("alphadothat", "betadothat", "dnz")
"""Variables that the simulation solves for: they depend on the coefficients themselves."""
SEPARATION = ("X", "X_left", "X_right", "X_diff", "X_lift", "X_lift_diff")
"""Variables of the flow separation, which models with the section ``[stall]`` have."""
ATTACHED_FLOW = {name: 0.0 if name.endswith("_diff") else 1.0 for name in SEPARATION}
"""Their values in attached flow."""
WRAPPED = frozenset({"phi", "psi", "lon"})
"""Angles that jump by a full turn."""
GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "theta": "θ",
    "phi": "φ",
    "psi": "ψ",
    "rho": "ρ",
}
"""Letters that begin names of quantities."""
# prefix of the quantities of a submodel
ITEM = re.compile(
    r"^(engine[1-9]\d*|gear\.\w+|joint\.\w+|device\.\w+|tank\.\w+|transfer\.\w+\.\w+"
    r"|column|wheel|pedal)\."
)


def lookup(name: str) -> Quantity:
    """Return the row of `name` in the vocabulary.

    The prefix of a submodel is ignored: ``engine2.thrust`` gives the row of ``thrust``, and
    ``joint.wing.angle`` gives the row of ``angle``.

    Raises
    ------
    UnknownName
        With names of similar spelling.
    """
    row = VOCABULARY.get(ITEM.sub("", name))
    if row is None:
        raise UnknownName(name, VOCABULARY, "quantity")
    return row


def is_quantity(name: str) -> bool:
    """Return whether a name is in the vocabulary; a prefix of a submodel is ignored."""
    return ITEM.sub("", name) in VOCABULARY


def unit_suffix(units: str) -> str:
    """Return a unit as it follows a number: a blank and the unit, nothing for the unit 1."""
    return "" if units == "1" else f" {units}"


def value_text(name: str, value: float, form: str = ".4g") -> str:
    """Return an SI value of a quantity in its display unit, with the unit.

    Examples
    --------
    >>> value_text("alpha", 0.1), value_text("mach", 0.3)
    ('5.73 deg', '0.3')
    """
    units = lookup(name).display_units
    return f"{float(from_si(value, units)):{form}}{unit_suffix(units)}"


def quantity_attributes(name: str) -> dict[str, str]:
    """Return the attributes of a variable of this name: units, long_name and, if defined, sign."""
    row = lookup(name)
    attributes = {"units": row.units, "long_name": row.long_name}
    if row.sign:
        attributes["sign"] = row.sign
    return attributes
