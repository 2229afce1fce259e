"""Selection of the terms of a model on the windows of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

import flighttest
from aeromatch.workbench.coefficients import form_windows
from aeromatch.workbench.fit_request import (
    FitRequest,
    RecordWindow,
    order_fit_windows,
    records_of_request,
)
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import SchemaError
from flightmech.support.toml_models import Strict, validate_content
from flighttest.regression.equation_error.model import MEASURED
from flighttest.regression.model_structure.candidates import monomials
from flighttest.remarks import remarks_to_json

_METHODS: dict[str, Callable[..., Any]] = {
    "stepwise": flighttest.model_structure.select_stepwise,
    "orthogonal": flighttest.model_structure.select_orthogonal,
    "prediction": flighttest.model_structure.select_by_prediction,
}
# Greatest number of models of a set that the page shows.
_MOST_MODELS = 12


class SelectionRequest(Strict):
    """Request of a selection: windows, candidates and method, as of ``flight select``."""

    windows: Annotated[tuple[RecordWindow, ...], Field(min_length=1)]
    coefficient: str
    variables: str = ""
    order: Annotated[int, Field(ge=1, le=9)] = 2
    terms: tuple[str, ...] = ()
    keep: tuple[str, ...] = ()
    method: Literal["stepwise", "orthogonal", "prediction"] = "stepwise"
    free: bool = False
    cutoff: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None

    def as_fit(self) -> FitRequest:
        """Return windows and cut-off as the request of a fit, for the functions of windows."""
        return FitRequest(windows=self.windows, model=f"{self.coefficient} = 1", cutoff=self.cutoff)


def select_terms(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the selected model with the steps of its selection, and the command of the same.

    Raises
    ------
    SchemaError, IdentificationError
        As `flighttest.model_structure.select_stepwise`; a request without candidates.
    """
    request = validate_content(
        SelectionRequest, body if isinstance(body, dict) else {}, "selection"
    )
    if request.coefficient not in MEASURED:
        raise SchemaError(
            "selection",
            [f"coefficient {request.coefficient!r}; there are {', '.join(MEASURED)}"],
        )
    variables = request.variables.replace(",", " ").split()
    if not variables and not request.terms:
        raise SchemaError("selection", ["no candidates; name variables or terms"])
    candidates = [*monomials(variables, request.order)] if variables else ["1"]
    candidates += request.terms
    found = _METHODS[request.method](
        request.coefficient,
        [*candidates, *request.keep],
        form_windows(opened, request.as_fit()),
        keep=("1", *request.keep),
        hierarchy=not request.free,
    )
    return {
        "model": str(found.model),
        "method": found.method,
        "candidates": len(candidates),
        "steps": found.steps.to_dict("records"),
        "idle": found.idle,
        "models": found.models.head(_MOST_MODELS).to_dict("records"),
        "allowed": len(found.models),
        "R2": found.fit.estimates.attrs["R2"],
        "remarks": remarks_to_json(found.fit.remarks),
        "command": selection_words(opened, request),
    }


def selection_words(opened: OpenProject, request: SelectionRequest) -> list[str]:
    """Return the words of ``flight select`` for the same selection, without ``-o`` and its file."""
    fit = request.as_fit()
    paths = [opened.places.named(opened.path_file(record)) for record in records_of_request(fit)]
    words = ["flight", "select", *paths]
    words += ["--aircraft", opened.places.named(opened.project.aircraft)]
    words += ["--coefficient", request.coefficient]
    if request.variables.split():
        variables = " ".join(request.variables.replace(",", " ").split())
        words += ["--variables", variables, "--order", str(request.order)]
    for name, values in (("--term", request.terms), ("--keep", request.keep)):
        for value in values:
            words += [name, value]
    words += ["--method", request.method]
    if request.free:
        words.append("--free")
    words += window_words(fit)
    if request.cutoff is not None:
        words += ["--cutoff", repr(request.cutoff)]
    return [*words, *error_words(opened.project.errors)]


def window_words(request: FitRequest) -> list[str]:
    """Return the windows of a request as options of a command."""
    words: list[str] = []
    for window in order_fit_windows(request):
        words += ["--window-of", window.record, repr(window.start), repr(window.end)]
    return words


def error_words(errors: Mapping[str, float]) -> list[str]:
    """Return the sources of error of the project as options of a command."""
    words: list[str] = []
    for source, size in errors.items():
        words += ["--error", source, repr(size)]
    return words
