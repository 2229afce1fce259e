"""Public names of `aerodb.exchange` and where they are defined; ``__init__.py`` loads them from this list."""

from .daveml.from_database.exporter import export_daveml as export_daveml
from .daveml.to_database.airframe import import_daveml_aircraft as import_daveml_aircraft
from .daveml.to_database.importer import import_daveml as import_daveml
from .jsbsim.mass_properties import import_jsbsim_aircraft as import_jsbsim_aircraft
from .jsbsim.read import import_jsbsim as import_jsbsim
from .jsbsim.write import export_jsbsim as export_jsbsim
from .tables.check_cases import export_checkcases as export_checkcases
from .tables.check_cases import run_checkcases as run_checkcases
from .tables.csv_terms import export_csv as export_csv
from .tables.csv_terms import import_csv as import_csv
from .tables.matlab import export_matlab as export_matlab
from .tables.matlab import import_matlab as import_matlab
