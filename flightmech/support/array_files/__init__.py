"""Files of arrays: netCDF-4 read and written, and the reader of MATLAB files."""
