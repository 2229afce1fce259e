"""Public names of `aerodb.edit` and where they are defined; ``__init__.py`` loads them from this list."""

from .blending import blend as blend
from .blending import consistency as consistency
from .table_edits import extend as extend
from .table_edits import regrid as regrid
from .table_edits import regrid_error as regrid_error
from .table_edits import scale as scale
from .table_edits import set_nodes as set_nodes
from .table_edits import shift as shift
from .terms import delete_terms as delete_terms
from .terms import replace_terms as replace_terms
