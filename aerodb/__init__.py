"""The aerodynamic database: built from DATCOM, checked, edited, compared, stored.

A database is an ``xarray.DataTree``; every leaf ``/<coefficient>/<contribution>`` is one term of the model as
`flightmech.terms` defines it.  ``docs/aero-model.md`` tells what the terms mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from . import templates
    from .along import read_conditions
    from .blending import blend, consistency
    from .build import from_datcom
    from .comparison import compare
    from .drawing import save_figure
    from .edit import delete_terms, replace_terms
    from .evaluation import contributions, evaluate
    from .exchange.check_cases import export_checkcases, run_checkcases, with_checks
    from .exchange.csv_terms import export_csv, import_csv
    from .exchange.daveml.airframe import import_daveml_aircraft
    from .exchange.daveml.exporting import export_daveml
    from .exchange.daveml.importing import import_daveml
    from .exchange.jsbsim_read import import_jsbsim
    from .exchange.jsbsim_write import export_jsbsim
    from .exchange.matlab_terms import export_matlab, import_matlab
    from .factoring import factored
    from .figure_folder import write_comparison
    from .figures import plot_comparison, plot_term
    from .files import open, save
    from .ground_effect import bank_in_ground_effect, in_ground_effect, with_height_table
    from .maps import plot_difference
    from .moving import move_reference
    from .overview import summary
    from .rescaling import rescale
    from .schema import check, database, terms
    from .shaping import extend, regrid, regrid_error, scale, shift
    from .spread import standard_error
    from .states import forget, history, previous
    from .tabulation import tabulate

_HOME = {
    "export_daveml": "exchange.daveml.exporting",
    "import_daveml": "exchange.daveml.importing",
    "import_daveml_aircraft": "exchange.daveml.airframe",
    "blend": "blending",
    "consistency": "blending",
    "move_reference": "moving",
    "extend": "shaping",
    "regrid": "shaping",
    "regrid_error": "shaping",
    "scale": "shaping",
    "shift": "shaping",
    "forget": "states",
    "history": "states",
    "previous": "states",
    "from_datcom": "build",
    "compare": "comparison",
    "plot_comparison": "figures",
    "plot_difference": "maps",
    "plot_term": "figures",
    "read_conditions": "along",
    "save_figure": "drawing",
    "standard_error": "spread",
    "write_comparison": "figure_folder",
    "delete_terms": "edit",
    "replace_terms": "edit",
    "contributions": "evaluation",
    "evaluate": "evaluation",
    "open": "files",
    "save": "files",
    "export_jsbsim": "exchange.jsbsim_write",
    "import_jsbsim": "exchange.jsbsim_read",
    "export_checkcases": "exchange.check_cases",
    "run_checkcases": "exchange.check_cases",
    "with_checks": "exchange.check_cases",
    "export_csv": "exchange.csv_terms",
    "import_csv": "exchange.csv_terms",
    "export_matlab": "exchange.matlab_terms",
    "import_matlab": "exchange.matlab_terms",
    "check": "schema",
    "database": "schema",
    "terms": "schema",
    "rescale": "rescaling",
    "summary": "overview",
    "factored": "factoring",
    "bank_in_ground_effect": "ground_effect",
    "in_ground_effect": "ground_effect",
    "with_height_table": "ground_effect",
    "tabulate": "tabulation",
    "templates": "templates",
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
