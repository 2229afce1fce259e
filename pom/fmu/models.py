"""Models of a batch: FMUs with their canonical names and control laws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flightmech.errors import SchemaError
from pom.cases.case import PomCase
from pom.fmu.description import demand_platform, read_fmu_interface
from pom.fmu.variable_map import Fmu, Links, links_of


@dataclass(frozen=True)
class FmuModel:
    """An FMU, its variables by canonical name, and the control law of the case, if it has one."""

    fmu: Fmu
    links: Links
    law: FmuModel | None = None

    def origin(self) -> str:
        """Return file, version and hash, as in the attributes of a result."""
        kind = ", model exchange" if self.fmu.exchange else ""
        return f"{self.fmu.path.name}, FMI {self.fmu.version}{kind}, sha256 {self.fmu.sha256}"


class Models:
    """The models of a batch, read once. A case may have tables of names.

    The methods may be called from any thread: each stored result is complete when it is stored.

    Parameters
    ----------
    runs : mapping of str to path
        Name of a model to its FMU.
    names : mapping of str to path, optional
        Name of a model to its table of names (`links_of`). It has priority over the table of a
        case.

    Raises
    ------
    ParseError, FileNotFoundError
        A file is not an FMU, or does not exist.
    SchemaError
        A model has the name of the recording, ``flight``, or a table is for an unknown model.
    """

    def __init__(
        self, runs: Mapping[str, str | Path], names: Mapping[str, str | Path] | None = None
    ):
        self.names = {name: str(table) for name, table in (names or {}).items()}
        if "flight" in runs:
            raise SchemaError(
                "models", ["flight is the name of the recording; give the model another one"]
            )
        unknown = [name for name in self.names if name not in runs]
        if unknown:
            models = ", ".join(runs)
            raise SchemaError(
                "names", [f"{name}: no such model; there are {models}" for name in unknown]
            )
        self._fmus = {name: read_fmu_interface(file) for name, file in runs.items()}
        self._links: dict[tuple[str, str | None], Links] = {}
        self._laws: dict[tuple[str, str], FmuModel] = {}

    def demand_platform(self) -> None:
        """Raise if a model has no library for this platform.

        Raises
        ------
        SchemaError
            With every such model.
        """
        problems = []
        for name, fmu in self._fmus.items():
            try:
                demand_platform(fmu)
            except SchemaError as error:
                problems += [f"model {name}: {text}" for text in error.problems]
        if problems:
            raise SchemaError("models", problems)

    def of(self, case: PomCase) -> dict[str, FmuModel]:
        """Return the models with the names and the control law of a case.

        Raises
        ------
        ParseError, FileNotFoundError
            A table of names is not TOML, or does not exist.
        SchemaError
            A table that does not fit its FMU.
        """
        tables = {**case.models, **self.names}
        law = None
        if case.law:
            law = self.law_of(case)
        models = {}
        for name, fmu in self._fmus.items():
            models[name] = FmuModel(fmu, self._links_once(name, tables.get(name)), law)
        return models

    def law_of(self, case: PomCase) -> FmuModel:
        """Return the control law of a case that has one; errors as `of`."""
        return self._law_once(case.law, case.law_names)

    def _law_once(self, file: str, names: str) -> FmuModel:
        if (file, names) not in self._laws:
            fmu = read_fmu_interface(file)
            self._laws[file, names] = FmuModel(fmu, links_of(fmu, names or None))
        return self._laws[file, names]

    def _links_once(self, name: str, table: str | None) -> Links:
        if (name, table) not in self._links:
            self._links[name, table] = links_of(self._fmus[name], table)
        return self._links[name, table]
