"""Public names of `datcom_io.reading`."""

from .reader import ListingCase as ListingCase
from .reader import ListingCase as Place
from .reader import iterate as iterate
from .reader import listings_in as listings_in
from .reader import place_of as place_of
from .reader import read as read
from .reader import read_place as read_place
