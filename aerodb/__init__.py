"""The aerodynamic database: built from DATCOM, checked, edited, compared, stored.

A database is an ``xarray.DataTree``; every leaf ``/<coefficient>/<contribution>`` is one term of the model as
`flightmech.terms` defines it.  ``docs/aero-model.md`` tells what the terms mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.support.lazy import load

if TYPE_CHECKING:
    from .comparison.along_record import read_conditions
    from .comparison.comparison import compare
    from .edit.blending import blend, consistency
    from .edit.table_edits import extend, regrid, regrid_error, scale, shift
    from .edit.terms import delete_terms, replace_terms
    from .exchange.daveml.from_database.exporter import export_daveml
    from .exchange.daveml.to_database.airframe import import_daveml_aircraft
    from .exchange.daveml.to_database.importer import import_daveml
    from .exchange.jsbsim.read import import_jsbsim
    from .exchange.jsbsim.write import export_jsbsim
    from .exchange.tables.check_cases import export_checkcases, run_checkcases
    from .exchange.tables.csv_terms import export_csv, import_csv
    from .exchange.tables.matlab import export_matlab, import_matlab
    from .figures.difference_maps import plot_difference
    from .figures.drawing import save_figure
    from .figures.figure_folder import write_comparison
    from .figures.figures import plot_comparison, plot_term
    from .prior.build import from_datcom
    from .store import templates
    from .store.evaluation import contributions, evaluate
    from .store.files import open, save
    from .store.overview import summary
    from .store.schema import check, database, terms
    from .store.stored_checks import with_checks
    from .store.undo_history import forget, history, previous
    from .transform.ground_effect import bank_in_ground_effect, in_ground_effect, with_height_table
    from .transform.ground_factor import factored
    from .transform.reference_point import move_reference
    from .transform.rescaling import rescale
    from .update.standard_errors import standard_error
    from .update.tabulation import tabulate

_HOME = {
    "export_daveml": "exchange.daveml.from_database.exporter",
    "import_daveml": "exchange.daveml.to_database.importer",
    "import_daveml_aircraft": "exchange.daveml.to_database.airframe",
    "blend": "edit.blending",
    "consistency": "edit.blending",
    "move_reference": "transform.reference_point",
    "extend": "edit.table_edits",
    "regrid": "edit.table_edits",
    "regrid_error": "edit.table_edits",
    "scale": "edit.table_edits",
    "shift": "edit.table_edits",
    "forget": "store.undo_history",
    "history": "store.undo_history",
    "previous": "store.undo_history",
    "from_datcom": "prior.build",
    "compare": "comparison.comparison",
    "plot_comparison": "figures.figures",
    "plot_difference": "figures.difference_maps",
    "plot_term": "figures.figures",
    "read_conditions": "comparison.along_record",
    "save_figure": "figures.drawing",
    "standard_error": "update.standard_errors",
    "write_comparison": "figures.figure_folder",
    "delete_terms": "edit.terms",
    "replace_terms": "edit.terms",
    "contributions": "store.evaluation",
    "evaluate": "store.evaluation",
    "open": "store.files",
    "save": "store.files",
    "export_jsbsim": "exchange.jsbsim.write",
    "import_jsbsim": "exchange.jsbsim.read",
    "export_checkcases": "exchange.tables.check_cases",
    "run_checkcases": "exchange.tables.check_cases",
    "with_checks": "store.stored_checks",
    "export_csv": "exchange.tables.csv_terms",
    "import_csv": "exchange.tables.csv_terms",
    "export_matlab": "exchange.tables.matlab",
    "import_matlab": "exchange.tables.matlab",
    "check": "store.schema",
    "database": "store.schema",
    "terms": "store.schema",
    "rescale": "transform.rescaling",
    "summary": "store.overview",
    "factored": "transform.ground_factor",
    "bank_in_ground_effect": "transform.ground_effect",
    "in_ground_effect": "transform.ground_effect",
    "with_height_table": "transform.ground_effect",
    "tabulate": "update.tabulation",
    "templates": "store.templates",
}
__all__ = [
    "bank_in_ground_effect",
    "blend",
    "check",
    "compare",
    "consistency",
    "contributions",
    "database",
    "delete_terms",
    "evaluate",
    "export_checkcases",
    "export_csv",
    "export_daveml",
    "export_jsbsim",
    "export_matlab",
    "extend",
    "factored",
    "forget",
    "from_datcom",
    "history",
    "import_csv",
    "import_daveml",
    "import_daveml_aircraft",
    "import_jsbsim",
    "import_matlab",
    "in_ground_effect",
    "move_reference",
    "open",
    "plot_comparison",
    "plot_difference",
    "plot_term",
    "previous",
    "read_conditions",
    "regrid",
    "regrid_error",
    "replace_terms",
    "rescale",
    "run_checkcases",
    "save",
    "save_figure",
    "scale",
    "shift",
    "standard_error",
    "summary",
    "tabulate",
    "templates",
    "terms",
    "with_checks",
    "with_height_table",
    "write_comparison",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
