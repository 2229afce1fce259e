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
from ..replaying.replay_case import check_plan, plan_of

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
    problems: list[str] = []
    for _ in range(MOST_CHANNELS):
        try:
            plan = plan_of(case, states)
            break
        except UnknownName as error:
            # The channel is added without motion, so that the next one that is missing is found as well.
            problems.append(_named(case, str(error)))
            if error.name in states:
                return problems
            states = states.assign({error.name: ("time", np.zeros(states.sizes["time"]))})
        except (SchemaError, OutOfRange) as error:
            return [*problems, *(_named(case, text) for text in _texts(error))]
    else:
        return problems
    for name, model in models.items():
        try:
            check_plan(plan, model)
        except (SchemaError, OutOfRange) as error:
            problems += [f"case {case.name}, model {name}: {text}" for text in _texts(error)]
    return problems


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


def start_problems(case: PomCase, states: xr.Dataset, name: str, sim: SimModel) -> list[str]:
    """Return why the kernel refuses to start a case, apart from its trim: a drive that no engine of the aircraft has, and the like.

    Parameters
    ----------
    case : PomCase
        One without problems (`case_problems`), and without a control law.
    states : Dataset (time,)
        As for `case_problems`. [SI]
    name : str
        Name of the model.
    sim : SimModel
    """
    try:
        start_untrimmed(sim, plan_of(case, states).job)
    except SimulationError as error:
        return [f"case {case.name}, model {name}: {error}"]
    return []


def _named(case: PomCase, text: str) -> str:
    """Return a problem behind the name of its case."""
    return text if text.startswith(f"case {case.name}") else f"case {case.name}: {text}"


def _texts(error: AeromatchError) -> list[str]:
    return list(error.problems) if isinstance(error, SchemaError) else [str(error)]
