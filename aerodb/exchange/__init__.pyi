"""Public names of `aerodb.exchange`."""

from .daveml.airframe import import_daveml_aircraft as import_daveml_aircraft
from .daveml.exporter import export_daveml as export_daveml
from .daveml.importer import import_daveml as import_daveml
from .jsbsim.aircraft import import_jsbsim_aircraft as import_jsbsim_aircraft
from .jsbsim.propulsion.engines import import_jsbsim_engine as import_jsbsim_engine
from .jsbsim.propulsion.propellers import import_jsbsim_propeller as import_jsbsim_propeller
from .jsbsim.read import import_jsbsim as import_jsbsim
from .jsbsim.write import export_jsbsim as export_jsbsim
from .tables.csv_checks import export_checkcases as export_checkcases
from .tables.csv_checks import run_checkcases as run_checkcases
from .tables.csv_terms import export_csv as export_csv
from .tables.csv_terms import import_csv as import_csv
from .tables.matlab import export_matlab as export_matlab
from .tables.matlab import import_matlab as import_matlab
