"""Public names of `datcom_io.printout`."""

from .content import ListingMessage as ListingMessage
from .content import ListingMessage as Message
from .content import Page as Page
from .tables import PrintedTable as PrintedTable
from .tables import PrintedTable as Table
