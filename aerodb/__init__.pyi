"""Public names of `aerodb`."""

from . import comparison as comparison
from . import edit as edit
from . import edit as transform
from . import estimators as estimators
from . import exchange as exchange
from . import figures as figures
from . import prior as prior
from . import store as store
from . import update as update
from .comparison.comparison import compare as compare
from .edit.term_edits import delete_terms as delete_terms
from .edit.term_edits import replace_terms as replace_terms
from .estimators.build import from_estimate as from_estimate
from .prior.build import from_datcom as from_datcom
from .store.evaluation import contributions as contributions
from .store.evaluation import evaluate as evaluate
from .store.files import open as open
from .store.files import save as save
from .store.overview import summary as summary
from .store.schema import check as check
from .store.schema import make_database as database
from .store.schema import make_database as make_database
from .store.schema import terms as terms
from .update.tabulation import tabulate as tabulate
