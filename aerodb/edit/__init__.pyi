"""Public names of `aerodb.edit`."""

from .blending import blend as blend
from .blending import consistency as consistency
from .breakpoint_edits import extend as extend
from .breakpoint_edits import regrid as regrid
from .breakpoint_edits import regrid_error as regrid_error
from .ground_effect import bank_in_ground_effect as bank_in_ground_effect
from .ground_effect import factor_table as factor_table
from .ground_effect import factor_table as factored
from .ground_effect import in_ground_effect as in_ground_effect
from .ground_effect import with_height_table as with_height_table
from .ice import add_ice as add_ice
from .ice_file import IceDifference as IceDifference
from .ice_file import IceFile as IceFile
from .ice_file import read_ice as read_ice
from .joined_sources.prior_blending import PriorBlend as PriorBlend
from .joined_sources.prior_blending import blend_sources as blend_sources
from .reference_point import move_reference as move_reference
from .rescaling import rescale as rescale
from .table_edits import scale as scale
from .table_edits import set_nodes as set_nodes
from .table_edits import shift as shift
from .term_edits import delete_terms as delete_terms
from .term_edits import replace_terms as replace_terms
