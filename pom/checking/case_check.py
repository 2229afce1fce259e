"""Whether a case can be flown: all that its record or a model lacks, found before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech import SimModel
from flightmech.errors import AeromatchError, OutOfRange, SchemaError, SimulationError, UnknownName

from ..cases.case import PomCase
from ..fmu.fmu_file import Fmu
from ..fmu.simulate import Model
from ..fmu.variable_map import links_of
from ..replaying.kernel_replay import start_untrimmed
from ..replaying.replay_case import Plan, check_plan, plan_of

MOST_CHANNELS = 40
"""Missing channels of one case that are listed; a case needs fewer."""


def case_problems(case: PomCase, states: xr.Dataset, models: Mapping[str, Model]) -> list[str]:
    """Return why a case cannot be flown.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
        States of the whole record: those of a reconstructed path, or `flighttest.reconstruction.start_states`. [SI]
    models : mapping of str to Model
        By name; empty to check the record alone.

    Returns
    -------
    list of str
        A line for every problem: the window, every channel that the record lacks, samples without a value, and every input,
        output and parameter that a model lacks. Empty if the case can be flown.
    """
    return _planned(case, states, models)[0]


def _planned(case: PomCase, states: xr.Dataset, models: Mapping[str, Model]) -> tuple[list[str], Plan | None]:
    """Return why a case cannot be flown, and its plan if there is one."""
    problems: list[str] = []
    for _ in range(MOST_CHANNELS):
        try:
            plan = plan_of(case, states)
            break
        except UnknownName as error:
            # The channel is added without motion, so that the next one that is missing is found as well.
            problems.append(_named(case, str(error)))
            if error.name in states:
                return problems, None
            states = states.assign({error.name: ("time", np.zeros(states.sizes["time"]))})
        except (SchemaError, OutOfRange) as error:
            return [*problems, *(_named(case, text) for text in _texts(error))], None
    else:
        return problems, None
    for name, model in models.items():
        try:
            check_plan(plan, model)
        except (SchemaError, OutOfRange) as error:
            problems += [f"case {case.name}, model {name}: {text}" for text in _texts(error)]
    return problems, plan


def kernel_model(name: str, sim: SimModel) -> Model:
    """Return a compiled model as `check_plan` takes it: as the FMU that `flightmech.write_fmu` makes of it, without writing one.

    Parameters
    ----------
    name : str
        Name of the model.
    sim : SimModel
    """
    interface = Fmu(
        Path(f"{name}.fmu"),
        "3.0",
        "",
        inputs=dict.fromkeys(sim.inputs, ""),
        outputs=dict.fromkeys(sim.outputs, ""),
        parameters=dict.fromkeys(sim.parameters, ""),
    )
    return Model(interface, links_of(interface))


def start_problems(case: PomCase, states: xr.Dataset, models: Mapping[str, Model], sims: Mapping[str, SimModel]) -> list[str]:
    """Return why a case cannot be flown, as `case_problems`, and else why the kernel refuses to start it, apart from its trim.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
    models : mapping of str to Model
        As for `case_problems`.
    sims : mapping of str to SimModel
        Compiled models by name; none for a case with a control law, which the kernel does not fly.

    Returns
    -------
    list of str
        A drive that no engine of the aircraft has, and the like.
    """
    problems, plan = _planned(case, states, models)
    if problems or plan is None:
        return problems
    for name, sim in sims.items():
        try:
            start_untrimmed(sim, plan.job)
        except SimulationError as error:
            problems.append(f"case {case.name}, model {name}: {error}")
    return problems


def _named(case: PomCase, text: str) -> str:
    """Return a problem behind the name of its case."""
    return text if text.startswith(f"case {case.name}") else f"case {case.name}: {text}"


def _texts(error: AeromatchError) -> list[str]:
    return list(error.problems) if isinstance(error, SchemaError) else [str(error)]
