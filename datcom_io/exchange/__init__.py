"""Other files of Digital DATCOM and its neighbours: plot files, CSV of DATCOM+, the MATLAB structure."""
