"""Public names of `aerodb.estimators.programs`."""

from .avl import read_avl as read_avl
from .missile_datcom import read_missile_datcom as read_missile_datcom
from .tornado import read_tornado as read_tornado
from .vspaero import read_vspaero as read_vspaero
from .xflr5 import read_xflr5 as read_xflr5
