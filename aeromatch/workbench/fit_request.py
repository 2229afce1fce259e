"""Request of a fit by the page of the identification."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from flightmech.support.toml_models import Strict, validate_content
from flighttest.records.repeated_windows import repeated_windows


class RecordWindow(Strict):
    """Window of a reconstructed record. [s]"""

    record: str
    start: Annotated[float, Field(allow_inf_nan=False)]
    end: Annotated[float, Field(allow_inf_nan=False)]


_Frequency = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class FitRequest(Strict):
    """Request of a fit: windows, model and method."""

    windows: Annotated[tuple[RecordWindow, ...], Field(min_length=1)]
    model: str
    intercepts: Literal["common", "separate"] = "common"
    weights: Literal["equal", "manoeuvre", "robust"] = "equal"
    cutoff: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    prior: str | None = None
    ridge: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | Literal["auto"] = 0.0
    band: tuple[_Frequency, _Frequency] | None = None

    @model_validator(mode="after")
    def _check_band(self) -> FitRequest:
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ValueError(
                f"band {self.band[0]:g} to {self.band[1]:g} Hz; the upper edge must be the larger"
            )
        if self.band is not None and self.weights != "equal":
            raise ValueError(
                "weights go with a fit in time; a fit in frequency weighs by its spectrum"
            )
        return self

    @model_validator(mode="after")
    def _take_samples_once(self) -> FitRequest:
        problems: list[str] = []
        for record in records_of_request(self):
            own = [window for window in self.windows if window.record == record]
            spans = [(window.start, window.end) for window in own]
            problems += [f"{record}: {text}" for text in repeated_windows(spans)]
        if problems:
            raise ValueError("; ".join(problems))
        return self


def validate_request(content: Any) -> FitRequest:
    """Return the request of a fit; content of another type has all problems of an empty one."""
    if not isinstance(content, dict):
        content = {}
    return validate_content(FitRequest, content, "fit")


def records_of_request(request: FitRequest) -> list[str]:
    """Return the records of the windows, each once, in order."""
    return list(dict.fromkeys(window.record for window in request.windows))


def order_fit_windows(request: FitRequest) -> list[RecordWindow]:
    """Return the windows record by record, in the order of ``flight identify``."""
    records = records_of_request(request)
    return sorted(request.windows, key=lambda window: records.index(window.record))
