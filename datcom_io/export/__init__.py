"""Cases as data frames, CSV and netCDF."""
