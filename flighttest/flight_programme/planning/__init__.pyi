"""Public names of `flighttest.flight_programme.planning`."""

from .catalogue import Catalogue as Catalogue
from .catalogue import read_catalogue as read_catalogue
from .coverage import Coverage as Coverage
from .coverage import coverage_of as coverage_of
from .coverage import flights_of as flights_of
from .expected_range import draw_stderr as draw_stderr
from .manoeuvre_end import may_end as may_end
from .manoeuvre_end import running_estimate as running_estimate
from .plan import ProgrammePlan as Plan
from .plan import ProgrammePlan as ProgrammePlan
from .plan import plan_programme as plan_programme
from .plan_files import save_plan as save_plan
from .prediction import Prediction as Prediction
from .prediction import predict as predict
from .prediction import with_assumed as with_assumed
from .wanted_rows import RowGradients as RowGradients
from .wanted_rows import read_rows as read_rows
from .wanted_rows import save_rows as save_rows
