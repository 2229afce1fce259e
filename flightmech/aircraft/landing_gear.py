"""Landing gear: contacts, tyres, brakes, nose-wheel steering and the runway (LR-743 3.5, 4.5.4).

The equations and assumptions are in ``gear.c``, ``tyre.c`` and ``steering.c`` of
``kernel/src/gear``, and in docs/explanation/simulation/landing-gear.md. `landing_gear_file` has the
section ``[gear]`` of the aircraft file.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flightmech.short_text import ShortText
from flightmech.units import KNOT, to_si

if TYPE_CHECKING:
    import xarray as xr

Vector = tuple[float, float, float]
CONDITIONS = ("dry", "wet", "icy")
# Greatest friction of a tyre on a smooth wet runway, 14 CFR 25.109(c)(1): by tyre pressure [psi],
# coefficients of the powers 0 to 3 of V/(100 kt).
WET = {
    50.0: (0.883, -0.851, 0.306, -0.0350),
    100.0: (0.804, -0.805, 0.320, -0.0437),
    200.0: (0.692, -0.658, 0.252, -0.0331),
    300.0: (0.614, -0.611, 0.263, -0.0401),
}


def wet_friction(tyre_pressure: float) -> tuple[float, float, float, float]:
    """Return the greatest friction of a tyre on a wet runway, as a cubic of the ground speed.

    Parameters
    ----------
    tyre_pressure : float
        Inflation pressure over ambient, limited to 50 to 300 psi. [Pa]

    Returns
    -------
    tuple of float (4,)
        Coefficients of 1, V, V^2, V^3. [1, s m-1, s2 m-2, s3 m-3]

    References
    ----------
    .. [CFR25] 14 CFR 25.109(c)(1): cubics in knots at four pressures, linear between them.

    Examples
    --------
    >>> round(wet_friction(100.0 * 6894.757)[0], 3)
    0.804
    """
    pressures = np.array([to_si(psi, "psi") for psi in WET])
    cubics = np.array(list(WET.values()))
    # from powers of V/(100 kt) to powers of V
    c = []
    for power in range(4):
        coefficient = float(np.interp(tyre_pressure, pressures, cubics[:, power]))
        c.append(coefficient / (100.0 * KNOT) ** power)
    return c[0], c[1], c[2], c[3]


@dataclass(frozen=True)
class Contact(ShortText):
    """A wheel or skid that can touch the ground.

    Parameters
    ----------
    name : str
        For example ``nose``, ``left``, ``right`` or ``tail``. The outputs are ``gear.<name>.Fz``
        and so on.
    position : tuple of float (3,)
        Lowest point with the aircraft level and the leg unloaded, body axes, from the moment
        reference point. [m]
    radius : float
        Radius of the unloaded tyre, for the lowest point at pitch and bank angles. [m]
    stiffness, preload : float
        Strut force per compression, and strut force at zero compression. [N m-1, N]
    strut : Dataset, optional
        Additional strut force, a term leaf over ``compression``. [N]
    stroke : float
        Compression at which the strut is at its stop. Beyond it only the tyre deflects. [m]
    damping, damping_ext : float
        Strut force per rate of compression, inwards and outwards. [N s m-1]
    orifice, orifice_ext : float
        Strut force per square of the rate of compression, inwards and outwards. [N s2 m-2]
    tyre_stiffness : float
        Vertical stiffness, in series with the strut. If it is 0, the leg is one spring, and
        `preload` must be 0. [N m-1]
    side_stiffness : float
        Stiffness of the tyre or skid along the ground. [N m-1]
    cornering_stiffness, cornering_load : float
        Greatest side force per slip angle, and the load at which it is reached. The stiffness of a
        skid is 0. [N rad-1, N]
    loss : float
        Damping of the carcass along the ground over its stiffness, at most 0.04. [s]
    rolling : float
        Rolling resistance over load. [1]
    brake : float
        Brake force at the ground with a full pedal. A wheel left of the plane of symmetry has the
        pedal ``brake_left``, a wheel in the plane has the mean of both pedals. [N]
    brake_friction : float
        Brake force over load with a full pedal, added to `brake`, for brakes whose force is
        proportional to the load. [1]
    steering : float
        Angle of the wheel per angle of the steering, 0 if the wheel is not steered. [1]
    friction : float
        Friction of a skid over load. It is 0 for a wheel, whose friction the runway defines. [1]
    retracts : bool
        Whether the load is proportional to the input ``gear``.
    """

    name: str
    position: Vector
    side_stiffness: float
    radius: float = 0.0
    stiffness: float = 0.0
    preload: float = 0.0
    strut: xr.Dataset | None = None
    stroke: float = 10.0
    damping: float = 0.0
    damping_ext: float = 0.0
    orifice: float = 0.0
    orifice_ext: float = 0.0
    tyre_stiffness: float = 0.0
    cornering_stiffness: float = 0.0
    cornering_load: float = 1.0e4
    loss: float = 0.02
    rolling: float = 0.0
    brake: float = 0.0
    brake_friction: float = 0.0
    steering: float = 0.0
    friction: float = 0.0
    retracts: bool = True


@dataclass(frozen=True)
class Steering:
    """Nose-wheel steering.

    Parameters
    ----------
    order : {0, 2, 4}
        Quasi-static, one mass (wheel), or two masses (arm and wheel).
    limit : float
        Greatest angle to either side. [rad]
    stiffness : float
        Moment on the wheel per angle behind the command, or behind the arm. The stiffness 0 with
        order 0 is a castor. [N m rad-1]
    trail : float
        Distance of the side force behind the pivot, mechanical and pneumatic. [m]
    scrub : float
        Friction moment over friction force of a wheel that is steered at zero speed. [m]
    rudder : float
        Angle commanded by the pedals, positive right, per rudder deflection to the right
        (-delta_r). [1]
    damping, inertia : float
        Damping and moment of inertia of the wheel about its pivot. [N m s rad-1, kg m2]
    arm_stiffness, arm_damping, arm_inertia : float
        Properties of the arm between command and wheel, order 4. [N m rad-1, N m s rad-1, kg m2]
    """

    order: int = 0
    limit: float = np.pi / 4.0
    stiffness: float = 0.0
    trail: float = 0.1
    scrub: float = 0.0
    rudder: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0
    arm_stiffness: float = 0.0
    arm_damping: float = 0.0
    arm_inertia: float = 0.0


@dataclass(frozen=True)
class LandingGear(ShortText):
    """Contacts, steering and the runway.

    Parameters
    ----------
    contacts : tuple of Contact
        Wheels and skids.
    steering : Steering
        Steering of the wheels whose `Contact.steering` is not 0.
    condition : {0, 1, 2}
        Condition of the runway at the start: dry, wet, icy.
    mu_dry, mu_icy : float
        Greatest friction of a tyre over load, on ice as in AMC 25.1591. [1]
    mu_wet : tuple of float (4,)
        Greatest friction on a wet runway, a cubic of the ground speed, see `wet_friction`. [1,
        s m-1, s2 m-2, s3 m-3]
    skid_ratio : float
        Friction of a locked wheel over the greatest friction. [1]
    antiskid : float
        Fraction of the greatest friction that the anti-skid system allows, 0 without the system.
        14 CFR 25.109(c)(2): on-off 0.3, quasi-modulating 0.5, fully modulating 0.8. [1]
    """

    contacts: tuple[Contact, ...]
    steering: Steering = field(default_factory=Steering)
    condition: int = 0
    mu_dry: float = 0.8
    mu_wet: tuple[float, float, float, float] = wet_friction(to_si(100.0, "psi"))
    mu_icy: float = 0.05
    skid_ratio: float = 0.7
    antiskid: float = 0.0
