"""Public names of `aerodb.store`."""

from . import templates as templates
from .evaluation import contributions as contributions
from .evaluation import evaluate as evaluate
from .evaluation import with_checks as with_checks
from .files import open as open
from .files import save as save
from .overview import summary as summary
from .schema import check as check
from .schema import make_database as database
from .schema import make_database as make_database
from .schema import terms as terms
from .undo_history import drop_undo_history as drop_undo_history
from .undo_history import drop_undo_history as forget
from .undo_history import history as history
from .undo_history import undo_edits as previous
from .undo_history import undo_edits as undo_edits
