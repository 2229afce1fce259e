"""Runs of the compiled simulation that a filter corrects after every sample.

The state of a filter is the motion relative to steady air, in the coordinates

    V, alpha, beta, phi, theta, psi, p, q, r, h

A gust moves the air past the aircraft: it is a wind that acts on the forces and on air-relative
readings. The coordinates of a run are those outputs that the kernel computes without the gust.

A correction of the angles turns the aircraft and its wind, and keeps the velocity relative to the
air in body axes. It therefore changes neither V nor alpha nor beta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.simulation.kernel_library import double_pointer, load_kernel
from flightmech.simulation.run import index_of_parameter

COORDINATES = ("V", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "h")
# Steps of the differences: they are as wide as the uncertainty of a state, so that the kinks of
# tables are averaged. [SI]
_STEPS = np.array([0.5, 4e-3, 4e-3, 4e-3, 4e-3, 4e-3, 4e-3, 4e-3, 4e-3, 5.0])
_ANGLES = (3, 4, 5)  # phi, theta, psi
_WINDS = ("wind_n", "wind_e", "wind_d")
_VELOCITY, _QUATERNION, _RATES = slice(3, 6), slice(6, 10), slice(10, 13)  # of the kernel's state
_HALF_TURN = 3.0  # a larger difference of two angles is one turn less [rad]


class StepSlopes(NamedTuple):
    """Linear model of runs about their present states.

    Attributes
    ----------
    F, F_gust : array (run, coordinate, coordinate), (run, coordinate, gust axis)
        Coordinates after one step by those before, and by gusts [m/s] constant over the step.
    F_rise : array (run, coordinate, gust axis)
        By a gust that rises from zero over the step.
    H, H_gust : array (run, output, coordinate), (run, output, gust axis)
        Outputs by coordinates and gusts.
    """

    F: np.ndarray
    F_gust: np.ndarray
    F_rise: np.ndarray
    H: np.ndarray
    H_gust: np.ndarray


class KernelFlights:
    """Simulations of one record with different parameters, sample by sample.

    Parameters
    ----------
    sim : SimModel
    time : array (time,)
        Uniform. [s]
    u : array (time, input)
    outputs : sequence of str
    inertial : sequence of str
        Outputs among `COORDINATES` that a gust does not reach.
    coordinates : sequence of str
        Those of `COORDINATES` that the filter corrects.
    axes : sequence of int
        Body axes of the gusts: 0, 1 or 2. A gust is positive if it adds to the velocity of the
        aircraft relative to the air along this axis.
    """

    def __init__(
        self,
        sim: SimModel,
        time: np.ndarray,
        u: np.ndarray,
        outputs: Sequence[str],
        inertial: Sequence[str],
        coordinates: Sequence[str],
        axes: Sequence[int],
    ):
        self.sim, self.time = sim, time
        self.u = np.ascontiguousarray(u)
        self.chosen = [sim.outputs.index(name) for name in outputs]
        self.read = [sim.outputs.index(name) for name in COORDINATES]
        self.inertial = [k for k, name in enumerate(outputs) if name in inertial]
        self.inertial_read = [COORDINATES.index(outputs[k]) for k in self.inertial]
        self.positions = [COORDINATES.index(name) for name in coordinates]
        self.axes = list(axes)
        self.wind = [sim.inputs.index(name) for name in _WINDS]
        self.kernel = load_kernel()
        # buffers of one call of the kernel: their pointers stay valid
        self.y = np.empty(len(sim.outputs))
        self.ends = np.empty((2, u.shape[1]))
        self.x = np.empty(len(sim.states))
        self._y, self._x = double_pointer(self.y), double_pointer(self.x)
        self._ends = double_pointer(self.ends[0]), double_pointer(self.ends[1])
        self.probe = Simulation(sim.model)

    def start(self, names: Sequence[str], rows: np.ndarray, fixed: Mapping[str, float]) -> None:
        """Start one run for each row of parameters.

        Parameters
        ----------
        names : sequence of str
            Parameters that differ.
        rows : array (run, parameter)
        fixed : mapping of str to float
            Parameters of all runs.
        """
        base = Simulation(self.sim.model)
        for name, value in fixed.items():
            if name not in self.sim.inputs:
                base.set_parameter(index_of_parameter(self.sim, name), float(value))
        varied = [index_of_parameter(self.sim, name) for name in names]
        self.runs, self.failed = [], np.zeros(len(rows), bool)
        for number, row in enumerate(rows):
            run = base.copy()
            status = 0
            for index, value in zip(varied, row):
                status |= self.kernel.am_set_parameter(run.handle, index, value)
            self.ends[0] = self.u[0]
            status |= self.kernel.am_set_inputs(run.handle, self._ends[0])
            status |= self.kernel.am_initialize(run.handle, float(self.time[0]))
            self.failed[number] = bool(status)
            self.runs.append(run)

    def look(self, sample: int, gusts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates (run, 10) and outputs (run, output) at a sample; NaN after a failure.

        Parameters
        ----------
        sample : int
        gusts : array (run, gust axis)
            [m/s]
        """
        coordinates = np.full((len(self.runs), len(COORDINATES)), np.nan)
        y = np.full((len(self.runs), len(self.chosen)), np.nan)
        calm = np.zeros(3)
        for number, run in enumerate(self.runs):
            if not self.failed[number] and self._evaluate(run, sample, wind=calm):
                coordinates[number], y[number] = self.y[self.read], self.y[self.chosen]
        if self.axes:
            winds = self._winds_of(gusts, coordinates)
            for number, run in enumerate(self.runs):
                if not self.failed[number] and self._evaluate(run, sample, wind=winds[number]):
                    y[number] = self.y[self.chosen]
            y[:, self.inertial] = coordinates[:, self.inertial_read]
        self.failed |= ~np.isfinite(y).all(axis=1)
        return coordinates, y

    def _evaluate(self, run: Simulation, sample: int, wind: np.ndarray) -> bool:
        """Compute the outputs of one run in a wind besides the recorded one; False if it fails."""
        self.ends[0] = self.u[sample]
        self.ends[0, self.wind] += wind
        status = self.kernel.am_set_inputs(run.handle, self._ends[0])
        status |= self.kernel.am_outputs(run.handle, self._y)
        return not status

    def _winds_of(self, gusts: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Return the winds north, east and down (run, 3) of gusts in body axes (run, gust axis)."""
        # A gust adds to the velocity relative to the air: it blows against its axis.
        body = np.zeros((len(coordinates), 3))
        if not self.axes:
            return body
        body[:, self.axes] = -gusts
        return np.einsum("rji,rj->ri", _earth_to_body(coordinates[:, _ANGLES]), body)

    def advance(
        self, sample: int, first: np.ndarray, last: np.ndarray, coordinates: np.ndarray
    ) -> None:
        """Advance all runs to the next sample.

        Parameters
        ----------
        sample : int
        first, last : array (run, gust axis)
            Gusts at both ends, linear between them. [m/s]
        coordinates : array (run, 10)
            At the start of the step.
        """
        winds = self._winds_of(first, coordinates), self._winds_of(last, coordinates)
        for number, run in enumerate(self.runs):
            if not self.failed[number]:
                pair = winds[0][number], winds[1][number]
                self.failed[number] = not self._step(run, sample, pair)

    def _step(self, run: Simulation, sample: int, winds: tuple[np.ndarray, np.ndarray]) -> bool:
        """Advance one run in winds at both ends of the step; False if it fails."""
        self.ends[:] = self.u[sample : sample + 2]
        self.ends[0, self.wind] += winds[0]
        self.ends[1, self.wind] += winds[1]
        start = float(self.time[sample])
        step = float(self.time[sample + 1]) - start
        return not self.kernel.am_step(run.handle, start, step, *self._ends)

    def correct(self, changes: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Correct all runs, and return their new coordinates (run, 10).

        Parameters
        ----------
        changes : array (run, coordinate)
            Of the coordinates of the filter.
        coordinates : array (run, 10)
        """
        whole = np.zeros_like(coordinates)
        whole[:, self.positions] = changes
        states = _move_states(self._states(), coordinates, whole)
        for number, run in enumerate(self.runs):
            if not self.failed[number]:
                self.x[:] = states[number]
                self.failed[number] = bool(self.kernel.am_set_state(run.handle, self._x))
        return coordinates + whole

    def _states(self) -> np.ndarray:
        """Return the states of all runs (run, state)."""
        states = np.empty((len(self.runs), len(self.x)))
        for number, run in enumerate(self.runs):
            self.kernel.am_get_state(run.handle, self._x)
            states[number] = self.x
        return states

    def linearise(self, sample: int, gusts: np.ndarray, coordinates: np.ndarray) -> StepSlopes:
        """Return the linear model of all runs over the next step, by central differences.

        Parameters
        ----------
        sample : int
        gusts : array (run, gust axis)
            [m/s]
        coordinates : array (run, 10)
            At this sample.
        """
        runs, n, m = len(self.runs), len(self.positions), len(self.axes)
        # Columns: coordinates, gusts that stay, gusts that rise over the step.
        total = n + 2 * m
        ahead = np.full((2, total, runs, len(COORDINATES)), np.nan)
        y = np.full((2, total, runs, len(self.chosen)), np.nan)
        before = self._states()
        for side, sign in enumerate((1.0, -1.0)):
            for column in range(total):
                shift, at, end = np.zeros_like(coordinates), gusts, gusts
                if column < n:
                    position = self.positions[column]
                    shift[:, position] = sign * _STEPS[position]
                else:
                    gust = np.zeros(m)
                    gust[(column - n) % m] = sign * _STEPS[0]
                    end = gusts + gust
                    at = end if column < n + m else gusts
                now = coordinates + shift
                winds = self._winds_of(at, now), self._winds_of(end, now)
                states = _move_states(before, coordinates, shift)
                for number, run in enumerate(self.runs):
                    if self.failed[number]:
                        continue
                    self.kernel.am_copy(self.probe.handle, run.handle)
                    self.x[:] = states[number]
                    self.kernel.am_set_state(self.probe.handle, self._x)
                    pair = winds[0][number], winds[1][number]
                    found = self._probe(sample, pair, y=y[side, column, number])
                    ahead[side, column, number] = found
                y[side, column][:, self.inertial] = now[:, self.inertial_read]
        size = np.concatenate([_STEPS[self.positions], np.full(2 * m, _STEPS[0])])
        width = 2.0 * size[:, None, None]
        change = ahead[0] - ahead[1]
        # An angle that passes half a turn between the two sides is one turn off.
        turns = np.abs(change[:, :, _ANGLES]) > _HALF_TURN
        change[:, :, _ANGLES] -= np.where(turns, 2.0 * np.pi * np.sign(change[:, :, _ANGLES]), 0.0)
        F = (change / width)[:, :, self.positions].transpose(1, 2, 0)
        H = ((y[0] - y[1]) / width).transpose(1, 2, 0)
        return StepSlopes(
            F=F[:, :, :n],
            F_gust=F[:, :, n : n + m],
            F_rise=F[:, :, n + m :],
            H=H[:, :, :n],
            H_gust=H[:, :, n : n + m],
        )

    def _probe(
        self, sample: int, winds: tuple[np.ndarray, np.ndarray], y: np.ndarray
    ) -> np.ndarray:
        """Write the outputs of the probe to `y`, and return its coordinates after a step.

        Both are NaN if it fails.
        """
        if not self._evaluate(self.probe, sample, wind=winds[0]):
            return np.full(len(COORDINATES), np.nan)
        y[:] = self.y[self.chosen]
        if not self._step(self.probe, sample, winds):
            return np.full(len(COORDINATES), np.nan)
        self.ends[0] = self.u[sample + 1]
        self.kernel.am_set_inputs(self.probe.handle, self._ends[0])
        self.kernel.am_outputs(self.probe.handle, self._y)
        return self.y[self.read]


def _earth_to_body(angles: np.ndarray) -> np.ndarray:
    """Return the rotations from north, east, down to body axes, (run, 3, 3).

    Parameters
    ----------
    angles : array (run, 3)
        phi, theta, psi. [rad]
    """
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cp * cy, cp * sy, -sp],
        [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
        [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _quaternion_matrix(q: np.ndarray) -> np.ndarray:
    """Return the rotations from the Earth axes of the kernel to body axes, (run, 3, 3)."""
    a, b, c, d = q.T
    rows = [
        [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
        [2.0 * (b * c - a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d + a * b)],
        [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _air_velocity(coordinates: np.ndarray) -> np.ndarray:
    """Return the velocity relative to steady air in body axes (run, 3). [m/s]"""
    V, alpha, beta = coordinates[:, :3].T
    return np.column_stack(
        [V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)]
    )


def _move_states(states: np.ndarray, coordinates: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return states of the kernel (run, state) after changes of the coordinates (run, 10)."""
    moved = states.copy()
    phi, theta = coordinates[:, 3], coordinates[:, 4]
    zero = np.zeros_like(phi)
    # The Euler angles turn about the body's x axis, the level axis across it, and the vertical.
    down = np.column_stack(
        [-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)]
    )
    across = np.column_stack([zero, np.cos(phi), -np.sin(phi)])
    turn = changes[:, 4:5] * across + changes[:, 5:6] * down
    turn[:, 0] += changes[:, 3]
    a, b, c, d = states[:, _QUATERNION].T
    half = 0.5 * turn
    x, y, z = half.T
    q = np.column_stack(
        [
            a - b * x - c * y - d * z,
            b + a * x + c * z - d * y,
            c + a * y - b * z + d * x,
            d + a * z + b * y - c * x,
        ]
    )
    q /= np.sqrt((q**2).sum(axis=1))[:, None]
    moved[:, _QUATERNION] = q
    old, new = _quaternion_matrix(states[:, _QUATERNION]), _quaternion_matrix(q)
    # The wind in Earth axes is what the velocity has beyond that relative to the air.
    air = np.einsum("rji,rj->ri", old, _air_velocity(coordinates))
    wind = states[:, _VELOCITY] - air
    ahead = _air_velocity(coordinates + changes)
    moved[:, _VELOCITY] = np.einsum("rji,rj->ri", new, ahead) + wind
    moved[:, _RATES] += changes[:, 6:9]
    moved[:, :3] -= changes[:, 9:10] * np.einsum("rji,rj->ri", old, down)
    return moved
