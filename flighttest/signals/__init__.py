"""Sampled signals: filtering, resampling, derivatives, delays, spectra, flags of bad samples."""
