"""Namespaces of `aerodb` by subject, and the names of the usual road; ``__init__.py`` loads them from this list."""

from . import comparison as comparison
from . import edit as edit
from . import exchange as exchange
from . import figures as figures
from . import prior as prior
from . import store as store
from . import transform as transform
from . import update as update
from .comparison import compare as compare
from .edit import delete_terms as delete_terms
from .edit import replace_terms as replace_terms
from .prior import from_datcom as from_datcom
from .store import check as check
from .store import contributions as contributions
from .store import database as database
from .store import evaluate as evaluate
from .store import open as open
from .store import save as save
from .store import summary as summary
from .store import terms as terms
from .update import tabulate as tabulate
