"""Public names of `flighttest.regression.combining`."""

from .data_partition import Partition as Partition
from .data_partition import bins as bins
from .data_partition import fit_bins as fit_bins
from .joined_fits import Joined as Joined
from .joined_fits import coloured_covariance as coloured_covariance
from .joined_fits import join_fits as join_fits
from .joined_fits import table_samples as table_samples
from .mixed_estimation import Mixed as Mixed
from .mixed_estimation import mix_with_prior as mix_with_prior
from .mixed_estimation import mix_with_prior as mixed
from .mixed_estimation import prior_of as prior_of
from .pooling import pool as pool
from .pooling import pool_fits as pool_fits
from .published import published_fit as published_fit
from .published_table import read_published as read_published
