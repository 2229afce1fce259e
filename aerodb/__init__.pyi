"""Public names of `aerodb` and where they are defined; ``__init__.py`` loads them from this list."""

from .comparison.along_record import read_conditions as read_conditions
from .comparison.comparison import compare as compare
from .edit.blending import blend as blend
from .edit.blending import consistency as consistency
from .edit.table_edits import extend as extend
from .edit.table_edits import regrid as regrid
from .edit.table_edits import regrid_error as regrid_error
from .edit.table_edits import scale as scale
from .edit.table_edits import shift as shift
from .edit.terms import delete_terms as delete_terms
from .edit.terms import replace_terms as replace_terms
from .exchange.daveml.from_database.exporter import export_daveml as export_daveml
from .exchange.daveml.to_database.airframe import import_daveml_aircraft as import_daveml_aircraft
from .exchange.daveml.to_database.importer import import_daveml as import_daveml
from .exchange.jsbsim.read import import_jsbsim as import_jsbsim
from .exchange.jsbsim.write import export_jsbsim as export_jsbsim
from .exchange.tables.check_cases import export_checkcases as export_checkcases
from .exchange.tables.check_cases import run_checkcases as run_checkcases
from .exchange.tables.csv_terms import export_csv as export_csv
from .exchange.tables.csv_terms import import_csv as import_csv
from .exchange.tables.matlab import export_matlab as export_matlab
from .exchange.tables.matlab import import_matlab as import_matlab
from .figures.difference_maps import plot_difference as plot_difference
from .figures.drawing import save_figure as save_figure
from .figures.figure_folder import write_comparison as write_comparison
from .figures.figures import plot_comparison as plot_comparison
from .figures.figures import plot_term as plot_term
from .prior.build import from_datcom as from_datcom
from .store import templates as templates
from .store.evaluation import contributions as contributions
from .store.evaluation import evaluate as evaluate
from .store.files import open as open
from .store.files import save as save
from .store.overview import summary as summary
from .store.schema import check as check
from .store.schema import database as database
from .store.schema import terms as terms
from .store.stored_checks import with_checks as with_checks
from .store.undo_history import forget as forget
from .store.undo_history import history as history
from .store.undo_history import previous as previous
from .transform.ground_effect import (
    bank_in_ground_effect as bank_in_ground_effect,
)
from .transform.ground_effect import (
    in_ground_effect as in_ground_effect,
)
from .transform.ground_effect import (
    with_height_table as with_height_table,
)
from .transform.ground_factor import factored as factored
from .transform.reference_point import move_reference as move_reference
from .transform.rescaling import rescale as rescale
from .update.standard_errors import standard_error as standard_error
from .update.tabulation import tabulate as tabulate
