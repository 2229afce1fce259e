"""Board of saved models: their predictions of windows that they have not used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from aeromatch.workbench.coefficients import form_windows
from aeromatch.workbench.fit_request import (
    FitRequest,
    RecordWindow,
    order_fit_windows,
    records_of_request,
)
from aeromatch.workbench.models.selection import window_words
from aeromatch.workbench.opened import FITS, Levels, OpenProject, decimate_channels
from flightmech.errors import UnknownName
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import from_si
from flighttest.maximum_likelihood.linear.motions import MOTIONS
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.validating.used_windows import ValidationWindow, digest_record
from flighttest.maximum_likelihood.validating.validation import (
    open_model,
    predict_window,
    validate_models,
)
from flighttest.remarks import remarks_to_json

_SHOWN = {"rad": "deg", "rad s-1": "deg/s"}
# Points of a line on the screen.
_POINTS = 1500


class BoardRequest(Strict):
    """Request of a comparison: files of models, and windows."""

    models: Annotated[tuple[str, ...], Field(min_length=1, max_length=24)]
    windows: Annotated[tuple[RecordWindow, ...], Field(min_length=1)]
    cutoff: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None

    def as_fit(self) -> FitRequest:
        """Return windows and cut-off as the request of a fit, for the functions of windows."""
        return FitRequest(windows=self.windows, model="CL = 1", cutoff=self.cutoff)


class MotionRequest(Strict):
    """Request of a fit by output error or filter error."""

    windows: Annotated[tuple[RecordWindow, ...], Field(min_length=1)]
    motion: Literal["short-period", "lateral"]
    disturbance: Literal["none", "process"] = "none"


def saved_models(opened: OpenProject) -> dict[str, Path]:
    """Return the files of the saved models by place."""
    files = sorted((opened.work / FITS).glob("*.nc"))
    return {opened.places.named(file): file for file in files}


def _model(opened: OpenProject, place: str) -> Any:
    files = saved_models(opened)
    if place not in files:
        raise UnknownName(place, files, "saved model")
    file = files[place]
    return opened.kept(("model",), [file], lambda: open_model(file))


def list_models(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the saved models and the motions of a fit by output error."""
    return {"models": list(saved_models(opened)), "motions": MOTIONS}


def compare_models(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the board of the models in the body on its windows, and the command of the same."""
    request = validate_content(BoardRequest, body if isinstance(body, dict) else {}, "board")
    models = {Path(place).stem: _model(opened, place) for place in request.models}
    board = validate_models(models, _windows(opened, request))
    return {**board.as_dict(), "command": board_words(opened, request)}


def _windows(opened: OpenProject, request: BoardRequest) -> list[ValidationWindow]:
    return named_windows(opened, request.as_fit())


def named_windows(opened: OpenProject, request: FitRequest) -> list[ValidationWindow]:
    """Return the windows of a request with name and hash of their records."""
    named = []
    for window, data in zip(order_fit_windows(request), form_windows(opened, request), strict=True):
        digest = _digest(opened, opened.path_file(window.record))
        named.append(ValidationWindow(window.record, data, digest))
    return named


def _digest(opened: OpenProject, file: Path) -> str:
    return opened.kept(("digest",), [file], lambda: digest_record(file))


def board_words(opened: OpenProject, request: BoardRequest) -> list[str]:
    """Return the words of ``flight validate`` for a board, without ``-o`` and its file."""
    fit = request.as_fit()
    words = ["flight", "validate", *request.models]
    for record in records_of_request(fit):
        words += ["--path", opened.places.named(opened.path_file(record))]
    words += ["--aircraft", opened.places.named(opened.project.aircraft), *window_words(fit)]
    if request.cutoff is not None:
        words += ["--cutoff", repr(request.cutoff)]
    return words


def show_prediction(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return measured and predicted channels of the first window by the first model."""
    request = validate_content(BoardRequest, body if isinstance(body, dict) else {}, "board")
    model, window = _model(opened, request.models[0]), _windows(opened, request)[0]
    channels, remarks = predict_window(model, window.data)
    time = window.data["time"].values.astype(float)
    found = []
    for channel in channels:
        unit = _SHOWN.get(channel.unit, channel.unit)
        lines = {"measured": channel.measured, "predicted": channel.predicted}
        shown = {}
        for name, values in lines.items():
            shown[name] = Levels(from_si(values, unit) if unit != channel.unit else values)
        times, levels = decimate_channels(time, shown, start=-np.inf, stop=np.inf, points=_POINTS)
        found.append({"channel": channel.name, "unit": unit, "time": times, **levels})
    return {"window": window.name, "channels": found, "remarks": remarks}


def motion_words(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the words of ``flight fit-linear`` for the windows in the body."""
    content = body if isinstance(body, dict) else {}
    request = validate_content(MotionRequest, content, "output error")
    fit = FitRequest(windows=request.windows, model="CL = 1")
    paths = [opened.places.named(opened.path_file(record)) for record in records_of_request(fit)]
    words = ["flight", "fit-linear", *paths, "--motion", request.motion, *window_words(fit)]
    if request.disturbance != "none":
        words += ["--disturbance", request.disturbance]
    return {"command": words}


def show_model(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return estimates and remarks of the saved model ``model``."""
    place = query.get("model", "")
    model = _model(opened, place)
    estimates = model.estimates
    dim = "parameter" if isinstance(model, OutputError) else "term"
    rows = []
    for k, name in enumerate(estimates[dim].values):
        row: dict[str, Any] = {"name": str(name)}
        for column in ("estimate", "stderr"):
            row[column] = float(estimates[column].values[k])
        rows.append(row)
    return {
        "model": place,
        "text": "" if isinstance(model, OutputError) else str(model.model),
        "method": str(estimates.attrs.get("method", "equation error")),
        "rows": rows,
        "remarks": remarks_to_json(model.remarks),
    }
