"""What a validation needs: predictions of windows, and the windows that a model has used."""
