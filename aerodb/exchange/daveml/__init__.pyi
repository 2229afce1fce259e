"""Public names of `aerodb.exchange.daveml` and where they are defined; ``__init__.py`` loads them from this list."""

from .document.model import DaveModel as DaveModel
from .document.reading import read as read
from .from_database.exporter import export_daveml as export_daveml
from .to_database.importer import import_daveml as import_daveml
