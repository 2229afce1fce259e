"""What an exported file and JSBSim itself make of random states, compared with the database at the
same states.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import aerodb
from aerodb.store.schema import database_coefficients
from flightmech.units import DEGREE, FOOT, INCH, POUND_FORCE

FORCES = tuple(f"forces/fb{axis}-aero-lbs" for axis in "xyz")
MOMENTS = tuple(f"moments/{axis}-aero-lbsft" for axis in "lmn")
PSF = POUND_FORCE / FOOT**2
READ = {
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    "mach": ("velocities/mach", 1.0),
    "V": ("velocities/vt-fps", FOOT),
    "qbar": ("aero/qbar-psf", PSF),
    "h": ("position/h-sl-ft", FOOT),
    "phi": ("attitude/phi-rad", 1.0),
    "theta": ("attitude/theta-rad", 1.0),
    "h_cg": ("position/h-agl-ft", FOOT),
    "p": ("velocities/p-aero-rad_sec", 1.0),
    "q": ("velocities/q-aero-rad_sec", 1.0),
    "r": ("velocities/r-aero-rad_sec", 1.0),
    "alpha_dot": ("aero/alphadot-rad_sec", 1.0),
    "beta_dot": ("aero/betadot-rad_sec", 1.0),
    "Nz": ("accelerations/Nz", 1.0),
    "delta_e": ("fcs/elevator-pos-rad", 1.0),
    "delta_r": ("fcs/rudder-pos-rad", 1.0),
    "delta_f": ("fcs/flap-pos-rad", 1.0),
    "left": ("fcs/left-aileron-pos-rad", 1.0),
    "right": ("fcs/right-aileron-pos-rad", 1.0),
    "gear": ("gear/gear-pos-norm", 1.0),
    "speedbrake": ("fcs/speedbrake-pos-norm", 1.0),
    **{f"{axis}_cg": (f"inertia/cg-{axis}-in", INCH) for axis in "xyz"},
    **{f"{axis}_rp": (f"metrics/aero-rp-{axis}-in", INCH) for axis in "xyz"},
}
COMMANDS = tuple(
    f"fcs/{name}-cmd-norm"
    for name in ("elevator", "aileron", "rudder", "pitch-trim", "roll-trim", "yaw-trim")
)
ONE_SIDED = ("fcs/flap-cmd-norm", "gear/gear-cmd-norm", "fcs/speedbrake-cmd-norm")


def states(count, seed, speeds=(60.0, 320.0)):
    """Return random states and commands: either side of the ground-effect heights, angles well
    beyond ordinary flight.
    """
    draw = np.random.default_rng(seed).uniform
    given, commands = [], []
    for _ in range(count):
        terrain = draw(0.0, 3000.0)
        given.append(
            {
                "ic/terrain-elevation-ft": terrain,
                "ic/h-sl-ft": terrain + 10.0 ** draw(1.0, 4.3),
                "ic/vt-fps": draw(*speeds) / FOOT,
                "ic/theta-rad": draw(-0.3, 0.4),
                "ic/phi-rad": draw(-0.8, 0.8),
                "ic/alpha-rad": draw(-20.0, 35.0) * DEGREE,
                "ic/beta-rad": draw(-20.0, 20.0) * DEGREE,
                "ic/p-rad_sec": draw(-1.0, 1.0),
                "ic/q-rad_sec": draw(-0.5, 0.5),
                "ic/r-rad_sec": draw(-0.5, 0.5),
            }
        )
        commands.append(
            {
                name: draw(0.0 if name in ONE_SIDED else -1.0, 1.0)
                for name in (*COMMANDS, *ONE_SIDED)
            }
        )
    return given, commands


def fly(path, given, commands, more=(), shipped=False, settle=0, follow=(), make=()):
    """Return what JSBSim reads at each state: every quantity in SI, its forces [N] and moments [N
    m] about the c.g.
    """
    names = [name for name, _ in READ.values()]
    job = {
        "file": str(path),
        "shipped": shipped,
        "states": given,
        "commands": commands,
        "read": [*names, *FORCES, *MOMENTS, *more],
    }
    job |= {"settle": settle, "follow": follow, "make": make}
    child = Path(__file__).with_name("jsbsim_child.py")
    with (
        tempfile.TemporaryDirectory() as elsewhere
    ):  # aircraft files may name files that JSBSim writes
        ran = subprocess.run(
            [sys.executable, str(child)],
            input=json.dumps(job),
            capture_output=True,
            text=True,
            timeout=1200,
            cwd=elsewhere,
        )
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]
    rows = np.array(json.loads(ran.stdout.splitlines()[-1]))
    found = {name: rows[:, i] * factor for i, (name, (_, factor)) in enumerate(READ.items())}
    found |= {name: rows[:, len(names) + 6 + i] for i, name in enumerate(more)}
    return (
        found,
        rows[:, len(names) : len(names) + 3] * POUND_FORCE,
        rows[:, len(names) + 3 : len(names) + 6] * POUND_FORCE * FOOT,
    )


def conditions(found, aircraft):
    """Return the model variables of the states."""
    V, b, cbar = found["V"], aircraft.b, aircraft.cbar
    arm = np.stack(
        [
            found["x_cg"] - found["x_rp"],
            found["y_rp"] - found["y_cg"],
            found["z_cg"] - found["z_rp"],
        ],
        -1,
    )
    phi, theta = found["phi"], found["theta"]
    down = -np.sin(theta) * arm[:, 0] + np.cos(theta) * (
        np.sin(phi) * arm[:, 1] + np.cos(phi) * arm[:, 2]
    )
    return {
        **found,
        "phat": found["p"] * b / (2 * V),
        "qhat": found["q"] * cbar / (2 * V),
        "rhat": found["r"] * b / (2 * V),
        "alphadothat": found["alpha_dot"] * cbar / (2 * V),
        "betadothat": found["beta_dot"] * b / (2 * V),
        "dnz": found["Nz"] - 1.0,
        "delta_a": (found["right"] - found["left"]) / 2,
        "h_agl": found["h_cg"] - down,
        "x_cg": aircraft.x_ref_mac + (found["x_cg"] - found["x_rp"]) / cbar,
        "arm": arm,
    }


def loads(db, at, aircraft):
    """Return forces [N] and moments [N m] about the c.g., body axes, that a database gives at
    conditions.
    """
    zero = np.zeros_like(at["alpha"])
    C = {
        name: zero + aerodb.evaluate(db, name, outside="clamp", **at)
        for name in database_coefficients(db)
    }
    ca, sa, cb, sb = (f(at[angle]) for angle in ("alpha", "beta") for f in (np.cos, np.sin))
    if db.attrs["force_axes"] == "body":
        X, Y, Z = C["CX"], C["CY"], C["CZ"]
    else:
        D, Y, L = C["CD"], C["CY"], C["CL"]
        if db.attrs["force_axes"] == "wind":
            D, Y = cb * D + sb * Y, cb * Y - sb * D
        X, Z = sa * L - ca * D, -ca * L - sa * D
    force = (at["qbar"] * aircraft.S)[:, None] * np.stack([X, Y, Z], -1)
    size = np.array([aircraft.b, aircraft.cbar, aircraft.b]) * aircraft.S
    moment = at["qbar"][:, None] * size * np.stack([C["Cl"], C["Cm"], C["Cn"]], -1)
    return force, moment + np.cross(at["arm"], force)


def worst(ours, theirs):
    """Return the largest difference of the components, each state by itself, over the length of its
    vector.
    """
    return (np.abs(ours - theirs) / np.linalg.norm(theirs, axis=1, keepdims=True)).max(0)
