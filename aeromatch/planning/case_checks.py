"""Every case with every model that will fly it; a case without a problem is not checked again until
it, its record or a model changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import xarray as xr

import pom
from aeromatch.planning import model_checks
from aeromatch.planning.steps import run_collecting_problems
from aeromatch.project.project import Project
from flightmech.aircraft.aircraft import Aircraft
from flightmech.simulation.compiler import SimModel
from flightmech.support.kept_stages.content_hashes import FileContent
from flightmech.support.kept_stages.stages import Kept, Stages
from pom.cases.case import PomCase
from pom.checking.case_check import kernel_model, start_problems
from pom.fmu.simulate import Models


class CaseChecks:
    """Checks of the cases of a project.

    Parameters
    ----------
    project : Project
    custody : Custody
        Of the files that are read.
    stages : Stages
    """

    def __init__(self, project: Project, custody: pom.archive.Custody, stages: Stages) -> None:
        self._project, self._custody, self._stages = project, custody, stages

    def problems(
        self,
        cases: Sequence[PomCase],
        windows: Mapping[int, xr.Dataset | None],
        databases: Mapping[str, Kept[xr.DataTree]],
        aircraft: Mapping[str, Aircraft],
    ) -> list[str]:
        """Return why models cannot be made, and why cases cannot be flown by them.

        Parameters
        ----------
        cases : sequence of PomCase
        windows : mapping of int to Dataset (time,) or None
            By place of the case: its states. [SI] None where its record has a problem.
        databases, aircraft : mapping of str to object
            Of the own models, by name; without databases only foreign models are checked.
        """
        problems: list[str] = []
        flown = {name: self._stages.given(one) for name, one in aircraft.items()}  # hashed once

        @cache
        def compiled(name: str) -> tuple[SimModel | None, list[str]]:
            return model_checks.own_model(name, aircraft[name], databases[name])

        problems += self._faults_of_models(databases, flown, lambda name: compiled(name)[1])
        foreign = model_checks.foreign_models(self._project, problems)
        laws = Models({})

        def check(case: PomCase, states: xr.Dataset | None) -> list[str]:
            found: list[str] = []
            own = {name: sim for name in databases if (sim := compiled(name)[0]) is not None}
            models = {name: kernel_model(name, sim) for name, sim in own.items()}
            if case.law:
                law = run_collecting_problems(found, f"case {case.name}", laws.law_of, case)
                models = (
                    {name: replace(model, law=law) for name, model in models.items()}
                    if law is not None
                    else {}
                )
            for name, one in foreign.items():
                models |= (
                    {name: made[name]}
                    if (made := run_collecting_problems(found, f"case {case.name}", one.of, case))
                    is not None
                    else {}
                )
            if states is None:
                return found
            # the kernel flies no control law; the engines of the final model may be identified, with
            # tables that the aircraft file does not have
            started = {
                name: sim
                for name, sim in own.items()
                if not case.law and (name == "datcom" or self._project.engine is None)
            }
            return [
                *found,
                *model_checks.ground_problems(aircraft["final"], case),
                *start_problems(case, states, models, started),
            ]

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for item in missing:
                case, states = items[item]
                faults = check(case, states)
                put(item, faults, keep=not faults and states is not None)

        items = {
            _label(cases, number): (case, windows[number]) for number, case in enumerate(cases)
        }
        made_of = {
            "databases": databases,
            "aircraft": flown,
            "engine is identified": self._project.engine is not None,
        }
        common = {"models": made_of, "faulty models": problems[:], "foreign": self._foreign()}
        inputs = {
            item: {"case": case, "files": self._files(case), "states": states, **common}
            for item, (case, states) in items.items()
        }
        found = self._stages.batch("case check", inputs, compute)
        return [*problems, *(text for kept in found.values() for text in kept.value)]

    def _faults_of_models(
        self,
        databases: Mapping[str, Kept[xr.DataTree]],
        aircraft: Mapping[str, Kept[Aircraft]],
        faults_of: Callable[[str], list[str]],
    ) -> list[str]:
        """Return why own models cannot be compiled; one without a fault is compiled only when a
        case is checked with it.
        """

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for name in missing:
                faults = faults_of(name)
                put(name, faults, keep=not faults)

        inputs = {
            name: {"database": database, "aircraft": aircraft[name]}
            for name, database in databases.items()
        }
        found = self._stages.batch("model check", inputs, compute)
        return [text for kept in found.values() for text in kept.value]

    def _foreign(self) -> dict[str, list[FileContent | None]]:
        """Return the models from elsewhere with their tables of names as inputs of a stage."""
        files = {
            name: [file, self._project.tables.get(name)]
            for name, file in self._project.models.items()
        }
        return {
            name: [self._content(file) for file in own if file is not None]
            for name, own in files.items()
        }

    def _files(self, case: PomCase) -> list[FileContent | None]:
        return [
            self._content(Path(name))
            for name in (case.names, case.aircraft, case.law, case.law_names)
            if name
        ]

    def _content(self, file: Path) -> FileContent | None:
        """Return a file as an input of a stage; None where it cannot be read, which the check
        states.
        """
        try:
            return FileContent(file, self._custody.sha256(file))
        except OSError:
            return None


def _label(cases: Sequence[PomCase], number: int) -> str:
    """Return the name of a case, with its number where several have it."""
    name = cases[number].name
    return name if [case.name for case in cases].count(name) == 1 else f"{name} ({number + 1})"
