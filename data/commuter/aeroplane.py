"""The aeroplane of the recordings: a commuter with two turboprops, with numbers of our own.

Its equations are not those of the product: propellers of one blade section with induced velocity,
gas generators and governors of their own laws, aerodynamics with effects of the slipstream. Body
axes x forward, y right, z down; SI and radians. Elevator trailing edge down, aileron left roll and
rudder trailing edge left are positive.
"""

from __future__ import annotations

import math

import numpy as np

G0, R_AIR, P0, T0 = 9.80665, 287.05287, 101325.0, 288.15
WARMER = 5.0  # than the standard air [K]
S, C, B, MASS = 36.0, 2.0, 18.6, 5600.0
IXX, IYY, IZZ, IXZ = 22000.0, 26500.0, 44500.0, 1600.0
DETERMINANT = IXX * IZZ - IXZ**2
HUBS = ((1.6, -2.9, -0.6), (1.6, 2.9, -0.6))  # from the c.g., which is the reference point [m]
D, SHAFT = 2.40, 9.6  # propeller: diameter [m], inertia with the power turbine [kg m2]
RATED = 178.0  # governed speed [rad/s]
LOW, HIGH = math.radians(14.0), math.radians(52.0)  # stops of the blades
RATINGS = 640e3  # power of a gas generator at sea level [W]
IDLE = 0.55  # speed of a gas generator at idle


def blade_tables() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return J, blade angles, CT and CP (J, angle) of one section at three quarters of the radius.

    The induced velocity w is that of the actuator disk: CT = pi/2 w |J + w|, over n D.
    """
    J, angle = np.linspace(0.0, 3.4, 171), np.radians(np.arange(10.0, 56.1, 0.5))
    x, y = np.meshgrid(J, angle, indexing="ij")

    def blades(w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        axial, turning = x + w, 0.75 * np.pi
        inflow = np.arctan2(axial, turning)
        lift = 1.35 * np.tanh(5.8 / 1.35 * (y - inflow - np.radians(1.0)))
        drag = 0.012 + 0.018 * lift**2
        load = 0.5 * 0.125 * (axial**2 + turning**2)
        CT = load * (lift * np.cos(inflow) - drag * np.sin(inflow))
        return CT, 0.75 * np.pi * load * (lift * np.sin(inflow) + drag * np.cos(inflow))

    low, high = np.full_like(x, -1.5), np.full_like(x, 1.5)
    for _ in range(50):
        w = 0.5 * (low + high)
        more = blades(w)[0] > 0.5 * np.pi * w * np.abs(x + w)
        low, high = np.where(more, w, low), np.where(more, high, w)
    CT, CP = blades(0.5 * (low + high))
    return J, angle, CT, CP


_J, _ANGLE, _CT, _CP = blade_tables()
_ROWS = (_CT.tolist(), _CP.tolist())
_STEPS = float(_J[1] - _J[0]), float(_ANGLE[0]), float(_ANGLE[1] - _ANGLE[0])
_ENDS = len(_J) - 1.001, len(_ANGLE) - 1.001


def coefficients(J: float, angle: float) -> tuple[float, float]:
    """Return CT and CP of the propeller."""
    x = min(max(J / _STEPS[0], 0.0), _ENDS[0])
    y = min(max((angle - _STEPS[1]) / _STEPS[2], 0.0), _ENDS[1])
    i, k = int(x), int(y)
    f, g = x - i, y - k
    values = []
    for rows in _ROWS:
        a, b = rows[i], rows[i + 1]
        values.append(
            (1 - f) * ((1 - g) * a[k] + g * a[k + 1]) + f * ((1 - g) * b[k] + g * b[k + 1])
        )
    return values[0], values[1]


def engine_power(ng: float, mach: float, density: float) -> float:
    """Return the power of a burning gas generator. [W]"""
    share = max((ng - IDLE) / (1.0 - IDLE), 0.0)
    return RATINGS * (density / 1.225) ** 0.85 * (1.0 + 0.25 * mach) * (0.04 + 0.96 * share**1.5)


def geometric_height(h: np.ndarray) -> np.ndarray:
    """Return the height of a pressure altitude in the warmer air, by dz = dh T / T_standard. [m]"""
    return h + WARMER / 0.0065 * np.log(T0 / (T0 - 0.0065 * h))


def air(h: float) -> tuple[float, float, float, float]:
    """Return pressure, temperature, density and speed of sound at a pressure altitude."""
    standard = T0 - 0.0065 * h
    p = P0 * (standard / T0) ** (G0 / (R_AIR * 0.0065))
    T = standard + WARMER
    return p, T, p / (R_AIR * T), math.sqrt(1.4 * R_AIR * T)


START = {"u": 80.0, "h": 2000.0, "ng1": 0.8, "ng2": 0.8, "rpm1": RATED, "rpm2": RATED}
STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "north", "east", "h")
STATES += ("ng1", "flame1", "rpm1", "angle1", "ng2", "flame2", "rpm2", "angle2")


def derivatives(x: list[float], controls: dict[str, float]) -> tuple[list[float], dict[str, float]]:
    """Return the rates of `STATES` and what there is to measure.

    Controls: ``elevator aileron rudder`` [rad], ``lever1 lever2 cut1 cut2`` and, if there is
    ice, ``ice`` 0 ... 1.
    """
    u, v, w, p, q, r, phi, theta, psi, _, _, h = x[:12]
    pressure, temperature, density, sound = air(h)
    V = math.sqrt(u * u + v * v + w * w)
    al, be = math.atan2(w, u), math.asin(v / V)
    qbar = 0.5 * density * V * V
    F, M = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    rates, seen, loading = [], {}, []
    for k, (hx, hy, hz) in enumerate(HUBS, 1):
        ng, flame, rpm, angle = x[8 + 4 * k : 12 + 4 * k]
        cut = controls[f"cut{k}"] > 0.5
        lever = min(max(controls[f"lever{k}"], 0.0), 1.0)
        wanted = 0.12 if cut else IDLE + (1.0 - IDLE) * lever**0.85
        ng_rate = (wanted - ng) / (3.0 if cut else 0.9 if wanted > ng else 0.7)
        flame_rate = ((0.0 if cut else 1.0) - flame) / 0.3
        # velocity of the hub
        a, b, c = u + q * hz - r * hy, v + r * hx - p * hz, w + p * hy - q * hx
        n = max(rpm, 1.0) / (2.0 * math.pi)
        J = a / (n * D)
        CT, CP = coefficients(J, angle)
        load = density * n * n * D**4
        T, Q = load * CT, load * D * CP / (2.0 * math.pi)
        power = flame * engine_power(ng, V / sound, density)
        made = power / rpm
        rpm_rate = (made - Q) / SHAFT
        # governor with a lead
        move = 0.03 * (rpm - RATED) + 0.008 * rpm_rate
        move = min(max(move, -0.3), 0.3)
        if (angle <= LOW and move < 0.0) or (angle >= HIGH and move > 0.0):
            move = 0.0
        rates += [ng_rate, flame_rate, rpm_rate, move]
        # force in the disk and P-factor, right-handed propellers
        disk, turn = load * (0.11 + 0.03 * J), load * D * (0.012 + 0.012 * J)
        fx, fy, fz = T, -disk * b / V, -disk * c / V
        F = [F[0] + fx, F[1] + fy, F[2] + fz]
        H = SHAFT * rpm
        M[0] += hy * fz - hz * fy - made
        M[1] += hz * fx - hx * fz - turn * b / V - r * H
        M[2] += hx * fy - hy * fx - turn * c / V + q * H
        loading.append(T / (qbar * S))
        seen |= {f"thrust{k}": T, f"torque{k}": made, f"J{k}": J}
    CT_left, CT_right = loading
    CT_all = CT_left + CT_right
    de, da, dr = (controls[name] for name in ("elevator", "aileron", "rudder"))
    # ice on the tail, 0 to 1: less of the elevator and of the stability, more drag
    ice = controls.get("ice", 0.0)
    ph, qh, rh = p * B / (2 * V), q * C / (2 * V), r * B / (2 * V)
    CL = 0.36 + 5.5 * al - 5.0 * max(al - 0.15, 0.0) ** 2 + 7.0 * qh + 0.42 * de
    CL += 0.35 * CT_all * (al + 0.08)
    CD = 0.033 + 0.044 * CL * CL + 0.3 * be * be + 0.012 * ice
    Cm = 0.04 - 1.25 * (1.0 - 0.15 * ice) * al - 24.0 * qh + 0.05 * CT_all
    Cm -= 1.5 * (1.0 - 0.2 * ice) * de * (1.0 + 0.2 * CT_all)
    CY = -0.80 * be - 0.10 * ph + 0.40 * rh + 0.24 * dr
    Cl = -0.095 * be - 0.50 * ph + 0.13 * rh - 0.17 * da + 0.015 * dr + 0.01 * (CT_left - CT_right)
    Cn = 0.125 * be - 0.05 * ph - 0.19 * rh - 0.105 * dr + 0.008 * da
    ca, sa = math.cos(al), math.sin(al)
    X = F[0] + qbar * S * (CL * sa - CD * ca)
    Y = F[1] + qbar * S * CY
    Z = F[2] - qbar * S * (CL * ca + CD * sa)
    L, N = M[0] + qbar * S * B * Cl, M[2] + qbar * S * B * Cn
    Mp = M[1] + qbar * S * C * Cm
    # Euler's equations with Ixz
    a = L - (IZZ - IYY) * q * r + IXZ * p * q
    c = N - (IYY - IXX) * p * q - IXZ * q * r
    pd, rd = (IZZ * a + IXZ * c) / DETERMINANT, (IXX * c + IXZ * a) / DETERMINANT
    qd = (Mp - (IXX - IZZ) * p * r - IXZ * (p * p - r * r)) / IYY
    ax, ay, az = X / MASS, Y / MASS, Z / MASS
    sp, cp, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    ud = r * v - q * w - G0 * st + ax
    vd = p * w - r * u + G0 * ct * sp + ay
    wd = q * u - p * v + G0 * ct * cp + az
    ss, cs = math.sin(psi), math.cos(psi)
    north = u * ct * cs + v * (sp * st * cs - cp * ss) + w * (cp * st * cs + sp * ss)
    east = u * ct * ss + v * (sp * st * ss + cp * cs) + w * (cp * st * ss - sp * cs)
    climb = u * st - v * sp * ct - w * cp * ct
    # dp = -rho g dz in the warmer air, and dp = -rho_standard g dh
    h_dot = climb * (T0 - 0.0065 * h) / temperature
    euler = [p + (q * sp + r * cp) * st / ct, q * cp - r * sp, (q * sp + r * cp) / ct]
    rate = [ud, vd, wd, pd, qd, rd, *euler, north, east, h_dot, *rates]
    seen |= {"ax": ax, "ay": ay, "az": az, "p_dot": pd, "q_dot": qd, "r_dot": rd, "V": V}
    seen |= {
        "vn": north,
        "ve": east,
        "vd": -climb,
        "p_static": pressure,
        "temperature": temperature,
    }
    seen |= {"mach": V / sound, "alpha": al, "beta": be}
    return rate, seen


def advance(x: list[float], controls: dict[str, float], dt: float) -> list[float]:
    """Return the states after a step of the classical Runge-Kutta method."""

    def moved(k: list[float], share: float) -> list[float]:
        return [a + share * dt * b for a, b in zip(x, k)]

    k1 = derivatives(x, controls)[0]
    k2 = derivatives(moved(k1, 0.5), controls)[0]
    k3 = derivatives(moved(k2, 0.5), controls)[0]
    k4 = derivatives(moved(k3, 1.0), controls)[0]
    new = []
    for a, b, c, d, e in zip(x, k1, k2, k3, k4):
        new.append(a + dt / 6.0 * (b + 2.0 * c + 2.0 * d + e))
    for k in (15, 19):
        new[k] = min(max(new[k], LOW), HIGH)
    return new
