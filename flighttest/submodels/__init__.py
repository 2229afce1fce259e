"""flighttest/submodels"""
