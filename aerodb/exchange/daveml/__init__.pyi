"""Public names of `aerodb.exchange.daveml`."""

from .document.model import DaveModel as DaveModel
from .document.reading import read as read
from .exporter import export_daveml as export_daveml
from .importer import import_daveml as import_daveml
