"""Models for the tests of the kernel, and a plain NumPy counterpart of its equations."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import air, axes, terms
from flightmech.aircraft.aircraft import inertia_tensor
from flightmech.simulation.kernel import Simulation
from flightmech.terms import make_term

ALPHA = np.array([-0.2, -0.05, 0.0, 0.1, 0.22, 0.4])
MACH = np.array([0.1, 0.3, 0.5, 0.8])


def thrust_leaf() -> xr.Dataset:
    value = np.array([[300.0, 250.0], [2000.0, 1700.0], [4559.0, 4000.0]])[:, :, None] * np.array(
        [1.0, 0.6]
    )
    return make_term(value, {"throttle": [0.0, 0.6, 1.0], "mach": [0.0, 0.6], "h": [0.0, 8000.0]})


def jet(**changes) -> flightmech.Aircraft:
    """Return a counterpart jet with an offset centre of gravity and all products of inertia."""
    engine = {"thrust": thrust_leaf(), "time_constant": 1.2, "angular_momentum": 55.0}
    fields = {
        "name": "jet",
        "S": 17.0,
        "cbar": 1.67,
        "b": 10.3,
        "mass": 2300.0,
        "Ixx": 10800.0,
        "Iyy": 8100.0,
        "Izz": 15100.0,
        "Ixy": 40.0,
        "Ixz": 350.0,
        "Iyz": -25.0,
        "cg": (0.06, 0.01, 0.22),
        "x_ref_mac": 0.25,
        "engines": (
            flightmech.aircraft.Engine(
                (-0.3, -0.76, 0.05), (0.9987502603949663, 0.0, -0.04997916927067833), **engine
            ),
            flightmech.aircraft.Engine((-0.3, 0.76, 0.05), **engine),
        ),
        "limits": {"delta_e": (-0.35, 0.3), "delta_a": (-0.35, 0.35), "delta_r": (-0.35, 0.35)},
    }
    return flightmech.Aircraft(**(fields | changes))


def leaves() -> dict[str, xr.Dataset]:
    """Return terms of every kind: 0 to 4 axes, K factors, squares, all three implicit regressors,
    both rules outside.
    """
    rng = np.random.default_rng(5)
    rise = 0.25 + 4.8 * ALPHA
    gear = xr.DataArray([0.0, 0.4, 1.0], coords={"gear": [0.0, 0.5, 1.0]}, dims="gear")
    ground = xr.DataArray([1.0, 0.2, 0.0], coords={"h_agl": [0.0, 5.0, 15.0]}, dims="h_agl")
    four = rng.normal(0.0, 0.003, (3, 2, 2, 3))
    four_axes = {
        "alpha": ALPHA[::2],
        "mach": [0.2, 0.6],
        "delta_f": [0.0, 0.7],
        "beta": [-0.2, 0.0, 0.2],
    }
    return {
        "CL/basic": make_term(
            rise[:, None] * (1.0 + 0.1 * MACH), {"alpha": ALPHA, "mach": MACH}, outside="linear"
        ),
        "CL/elevator": make_term(0.36 + 0.05 * MACH, {"mach": MACH}, ["delta_e"]),
        "CL/qhat": make_term(4.1, regressors=["qhat"]),
        "CL/alphadothat": make_term([1.2, 1.5], {"mach": [0.2, 0.7]}, ["alphadothat"]),
        "CL/ground": make_term(0.15, regressors=["alpha"], K1=ground),
        "CD/basic": make_term(0.024 + 0.8 * ALPHA**2, {"alpha": ALPHA}),
        "CD/gear": make_term(0.02 + 0.01 * ALPHA, {"alpha": ALPHA}, K1=gear),
        "CD/square": make_term(0.3, regressors=["alpha", "alpha"]),
        "CD/load_factor": make_term(0.002, regressors=["dnz"]),
        "CY/beta": make_term(-0.6 - 0.1 * ALPHA, {"alpha": ALPHA}, ["beta"]),
        "CY/betadothat": make_term(-0.3, regressors=["betadothat"]),
        "CY/rudder": make_term(0.17, regressors=["delta_r"]),
        "Cl/beta": make_term(
            np.outer(-0.08 + 0.02 * ALPHA, np.ones(4)), {"alpha": ALPHA, "mach": MACH}, ["beta"]
        ),
        "Cl/phat": make_term(-0.44, regressors=["phat"]),
        "Cl/rhat": make_term(0.1 + 0.2 * ALPHA, {"alpha": ALPHA}, ["rhat"]),
        "Cl/aileron": make_term([-0.15, -0.12], {"mach": [0.2, 0.7]}, ["delta_a"]),
        "Cm/basic": make_term(0.03 - 0.7 * ALPHA, {"alpha": ALPHA}),
        "Cm/cg": make_term(0.02, regressors=["x_cg", "alpha"]),
        "Cm/elevator": make_term(-1.05, regressors=["delta_e"]),
        "Cm/qhat": make_term(-13.0, regressors=["qhat"]),
        "Cm/alphadothat": make_term(-4.5, regressors=["alphadothat"]),
        "Cm/power": make_term([0.0, 0.01], {"engine1.thrust": [0.0, 5000.0]}),
        "Cn/beta": make_term(0.1 + 0.05 * ALPHA, {"alpha": ALPHA}, ["beta"]),
        "Cn/rhat": make_term(-0.14, regressors=["rhat"]),
        "Cn/rudder": make_term(-0.07, regressors=["delta_r"]),
        "Cn/basic": make_term(four, four_axes),
    }


def tree(content: dict[str, xr.Dataset], **attrs) -> xr.DataTree:
    found = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in content.items()})
    found.attrs.update(attrs)
    return found


class Reference:
    """The derivative of the kernel, written once more in NumPy: no shared code, iterative geodesy,
    no closed forms.
    """

    a, f, mu, J2, rate = 6378137.0, 1.0 / 298.257223563, 3.986004418e14, 0.00108262982, 7.292115e-5

    def __init__(self, aircraft: flightmech.Aircraft, content: dict[str, xr.Dataset], earth: int):
        self.aircraft, self.content, self.earth = aircraft, content, earth
        self.J = inertia_tensor(aircraft)

    def place(self, r: np.ndarray) -> tuple[float, np.ndarray]:
        """Height, and the matrix Earth axes to north-east-down."""
        if not self.earth:
            return -r[2], np.eye(3)
        e2 = self.f * (2.0 - self.f)
        p, lon = np.hypot(r[0], r[1]), np.arctan2(r[1], r[0])
        lat = np.arctan2(r[2], p)
        for _ in range(20):
            N = self.a / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
            lat = np.arctan2(r[2] + e2 * N * np.sin(lat), p)
        h = p * np.cos(lat) + r[2] * np.sin(lat) - self.a * np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
        c, s = np.cos(lat), np.sin(lat)
        return h, np.array(
            [
                [-s * np.cos(lon), -s * np.sin(lon), c],
                [-np.sin(lon), np.cos(lon), 0.0],
                [-c * np.cos(lon), -c * np.sin(lon), -s],
            ]
        )

    def gravity(self, r: np.ndarray) -> np.ndarray:
        if not self.earth:
            return np.array([0.0, 0.0, 9.80665])
        n = np.linalg.norm(r)
        k = 1.5 * self.J2 * (self.a / n) ** 2
        zz = 5.0 * (r[2] / n) ** 2
        return -self.mu * r / n**3 * (1.0 - k * (zz - np.array([1.0, 1.0, 3.0])))

    def derivative(self, x: np.ndarray, u: dict[str, float]) -> np.ndarray:
        craft, W = self.aircraft, np.array([0.0, 0.0, self.rate * self.earth])
        r, v, q, w, lag = x[:3], x[3:6], x[6:10], x[10:13], x[13:]
        h, ned = self.place(r)
        C = axes.matrix_from_quaternion(q)
        atm = air.atmosphere(h)
        velocity = C @ (v - ned.T @ np.array([u["wind_n"], u["wind_e"], u["wind_d"]]))
        V = np.linalg.norm(velocity)
        alpha, beta = np.arctan2(velocity[2], velocity[0]), np.arcsin(velocity[1] / V)
        cg = np.array(craft.cg)
        down = ned[2] @ C.T
        z = {
            **u,
            "alpha": alpha,
            "beta": beta,
            "mach": V / atm.a_sound,
            "h": h,
            "h_agl": h + down @ cg,
            "x_cg": craft.x_ref_mac - cg[0] / craft.cbar,
            "phat": w[0] * craft.b / (2 * V),
            "qhat": w[1] * craft.cbar / (2 * V),
            "rhat": w[2] * craft.b / (2 * V),
        }
        F_T, M_T, H, steady = np.zeros(3), np.zeros(3), np.zeros(3), []
        for i, engine in enumerate(craft.engines):
            force = lag[i] * np.array(engine.direction)
            F_T, M_T = F_T + force, M_T + np.cross(np.array(engine.position) - cg, force)
            H = H + engine.angular_momentum * np.array(engine.direction)
            own = {"throttle": u[f"engine{i + 1}.throttle"], "mach": z["mach"], "h": h}
            steady.append(float(terms.evaluate_term(engine.thrust, own, outside="clamp")))
            z[f"engine{i + 1}.thrust"] = lag[i]
        g = self.gravity(r) - 2.0 * np.cross(W, v) - np.cross(W, np.cross(W, r))
        qS = 0.5 * float(atm.rho) * V**2 * craft.S

        def motion(implicit: np.ndarray):
            """Force, moment and the implicit variables that follow from assumed ones."""
            known = {**z, "alphadothat": implicit[0], "betadothat": implicit[1], "dnz": implicit[2]}
            c = dict.fromkeys(("CL", "CD", "CY", "Cl", "Cm", "Cn"), 0.0)
            for name, leaf in self.content.items():
                c[name.split("/")[0]] += float(terms.evaluate_term(leaf, known, outside="clamp"))
            F_A = qS * axes.stability_to_body([-c["CD"], c["CY"], -c["CL"]], alpha)
            M = (
                qS * np.array([craft.b * c["Cl"], craft.cbar * c["Cm"], craft.b * c["Cn"]])
                + np.cross(-cg, F_A)
                + M_T
            )
            F = F_A + F_T
            a = F / craft.mass + C @ g - np.cross(w - C @ W, velocity)
            alpha_dot = (velocity[0] * a[2] - velocity[2] * a[0]) / (
                velocity[0] ** 2 + velocity[2] ** 2
            )
            beta_dot = (a[1] - velocity[1] * (velocity @ a) / V**2) / np.hypot(
                velocity[0], velocity[2]
            )
            nz = -F[2] / craft.mass / 9.80665
            return (
                F,
                M,
                np.array(
                    [alpha_dot * craft.cbar / (2 * V), beta_dot * craft.b / (2 * V), nz - 1.0]
                ),
            )

        # the map from assumed to following variables is affine: three differences give its matrix
        base = motion(np.zeros(3))[2]
        gain = np.stack([motion(e)[2] - base for e in np.eye(3)], axis=1)
        F, M, _ = motion(np.linalg.solve(np.eye(3) - gain, base))
        rel = w - C @ W
        quat = (
            0.5 * np.array([-q[1:] @ rel, *(q[0] * rel + np.cross(q[1:], rel))]) + (1.0 - q @ q) * q
        )
        w_dot = np.linalg.solve(self.J, M - np.cross(w, self.J @ w + H))
        tau = np.array([engine.time_constant for engine in craft.engines])
        return np.concatenate(
            [v, C.T @ F / craft.mass + g, quat, w_dot, (np.array(steady) - lag) / tau]
        )


def started(sim: flightmech.SimModel, **values: float) -> Simulation:
    """Return an initialised simulation; a dot in the name of a parameter or input is written __."""
    run = Simulation(sim.model)
    u = np.zeros(len(sim.inputs))
    for key, value in values.items():
        name = key.replace("__", ".")
        if name in sim.inputs:
            u[sim.inputs.index(name)] = value
        else:
            run.set_parameter(sim.parameters.index(name), value)
    run.set_inputs(u)
    run.initialize()
    return run


@pytest.fixture(scope="session")
def start():
    return started


@pytest.fixture(scope="session")
def flown():
    """Outputs at the start under parameters and inputs."""
    return lambda sim, **values: dict(
        zip(sim.outputs, started(sim, **values).outputs(), strict=True)
    )


@pytest.fixture(scope="session")
def content() -> dict[str, xr.Dataset]:
    return leaves()


@pytest.fixture(scope="session")
def sim(content) -> flightmech.SimModel:
    return flightmech.compile(jet(), tree(content))


@pytest.fixture(scope="session")
def make_aircraft():
    return jet


@pytest.fixture(scope="session")
def make_tree():
    return tree


@pytest.fixture(scope="session")
def counterpart():
    return Reference
