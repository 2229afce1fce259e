"""Checks of every case with every model that will simulate it.

A case without a problem is not checked again until the case, its record or a model changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

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
from pom.fmu.models import Models


class CaseChecks:
    """Checks of the cases of a project.

    Parameters
    ----------
    project : Project
    custody : Custody
        Hashes of the files that are read.
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
        """Return the reasons why models cannot be made, and why they cannot simulate cases.

        Parameters
        ----------
        cases : sequence of PomCase
        windows : mapping of int to Dataset (time,) or None
            States of each case, by its index. [SI] None if its record has a problem.
        databases, aircraft : mapping of str to object
            Those of the project's models, by name. Without databases only models from elsewhere
            are checked.
        """
        # One object per aircraft, so that its hash is computed once.
        hashed_aircraft = {name: self._stages.given(item) for name, item in aircraft.items()}
        compiled = _CompiledModels(databases, aircraft)
        problems = self._model_problems(databases, hashed_aircraft, compiled)
        foreign = model_checks.foreign_models(self._project, problems)
        checker = _CaseChecker(self._project, compiled, foreign, aircraft["final"])
        common = {
            "models": {
                "databases": databases,
                "aircraft": hashed_aircraft,
                "engine is identified": self._project.engine is not None,
            },
            "faulty models": problems[:],
            "foreign": self._foreign_files(),
        }
        inputs: dict[str, dict[str, Any]] = {}
        items: dict[str, tuple[PomCase, xr.Dataset | None]] = {}
        for number, case in enumerate(cases):
            label = _label(cases, number)
            states = windows[number]
            items[label] = case, states
            case_inputs = {
                "case": case.without_texts(),
                "files": case.contents(),
                "states": states,
            }
            inputs[label] = case_inputs | common

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for label in missing:
                case, states = items[label]
                faults = checker.check(case, states)
                put(label, faults, keep=not faults and states is not None)

        for stored in self._stages.batch("case check", inputs, compute).values():
            problems += stored.value
        return problems

    def _model_problems(
        self,
        databases: Mapping[str, Kept[xr.DataTree]],
        aircraft: Mapping[str, Kept[Aircraft]],
        compiled: _CompiledModels,
    ) -> list[str]:
        """Return the reasons why models of the project cannot be compiled.

        A model without a problem is compiled again only if a case is checked with it.
        """

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for name in missing:
                faults = compiled.problems(name)
                put(name, faults, keep=not faults)

        inputs: dict[str, dict[str, Any]] = {}
        for name, database in databases.items():
            inputs[name] = {"database": database, "aircraft": aircraft[name]}
        problems: list[str] = []
        for stored in self._stages.batch("model check", inputs, compute).values():
            problems += stored.value
        return problems

    def _foreign_files(self) -> dict[str, list[FileContent | None]]:
        """Return the models from elsewhere and their tables of names as inputs of a stage."""
        contents: dict[str, list[FileContent | None]] = {}
        for name, fmu in self._project.fmus.items():
            contents[name] = [self._content(fmu)]
            if name in self._project.tables:
                contents[name].append(self._content(self._project.tables[name]))
        return contents

    def _content(self, file: Path) -> FileContent | None:
        """Return a file as an input of a stage, or None for a file that cannot be read.

        The check itself reports such a file.
        """
        try:
            return FileContent(file, self._custody.sha256(file))
        except OSError:
            return None


class _CompiledModels:
    """Models of a project, each compiled on first use."""

    def __init__(
        self, databases: Mapping[str, Kept[xr.DataTree]], aircraft: Mapping[str, Aircraft]
    ) -> None:
        self._databases, self._aircraft = databases, aircraft
        self._compiled: dict[str, tuple[SimModel | None, list[str]]] = {}

    def problems(self, name: str) -> list[str]:
        """Return the reasons why a model cannot be compiled."""
        return self._compile(name)[1]

    def models(self) -> dict[str, SimModel]:
        """Return the models that can be compiled, by name."""
        models: dict[str, SimModel] = {}
        for name in self._databases:
            model = self._compile(name)[0]
            if model is not None:
                models[name] = model
        return models

    def _compile(self, name: str) -> tuple[SimModel | None, list[str]]:
        if name not in self._compiled:
            self._compiled[name] = model_checks.own_model(
                name, self._aircraft[name], self._databases[name]
            )
        return self._compiled[name]


class _CaseChecker:
    """Check of single cases with the models of the project and the models from elsewhere."""

    def __init__(
        self,
        project: Project,
        compiled: _CompiledModels,
        foreign: Mapping[str, Models],
        aircraft: Aircraft,
    ) -> None:
        self._project, self._compiled = project, compiled
        self._foreign, self._aircraft = foreign, aircraft
        self._laws = Models({})

    def check(self, case: PomCase, states: xr.Dataset | None) -> list[str]:
        """Return the problems of a case; without states only the models are checked."""
        problems: list[str] = []
        case_label = f"case {case.name}"
        compiled = self._compiled.models()
        models = {name: kernel_model(name, model) for name, model in compiled.items()}
        if case.law:
            law = run_collecting_problems(problems, case_label, self._laws.law_of, case)
            if law is None:
                models = {}
            models = {name: replace(model, law=law) for name, model in models.items()}
        for name, foreign in self._foreign.items():
            mapped = run_collecting_problems(problems, case_label, foreign.of, case)
            if mapped is not None:
                models[name] = mapped[name]
        if states is None:
            return problems
        problems += model_checks.ground_problems(self._aircraft, case)
        problems += start_problems(case, states, models, self._started_models(case, compiled))
        return problems

    def _started_models(
        self, case: PomCase, compiled: Mapping[str, SimModel]
    ) -> dict[str, SimModel]:
        """Return the models whose start can be computed before the match."""
        # The kernel does not simulate the FMU of a control law.
        if case.law:
            return {}
        # An identified engine of the final model may have tables that the aircraft file lacks.
        if self._project.engine is not None:
            before = self._project.prior_model
            return {name: model for name, model in compiled.items() if name == before}
        return dict(compiled)


def _label(cases: Sequence[PomCase], number: int) -> str:
    """Return the name of a case, with its number if several cases have the same name."""
    name = cases[number].name
    if [case.name for case in cases].count(name) == 1:
        return name
    return f"{name} ({number + 1})"
