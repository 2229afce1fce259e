"""Requests of the page of the identification for selections, output error and the board."""

from __future__ import annotations

from aeromatch.workbench.models.board import (
    compare_models,
    list_models,
    motion_words,
    show_model,
    show_prediction,
)
from aeromatch.workbench.models.selection import select_terms

ROUTES = {
    ("GET", "/api/models"): list_models,
    ("GET", "/api/model"): show_model,
    ("POST", "/api/select"): select_terms,
    ("POST", "/api/motion"): motion_words,
    ("POST", "/api/board"): compare_models,
    ("POST", "/api/prediction"): show_prediction,
}
"""Requests of this folder, in the form of `aeromatch.workbench.records.ROUTES`."""
