"""Public names of `datcom_io.printout`."""

from .content import Message as Message
from .content import Page as Page
from .tables import Table as Table
