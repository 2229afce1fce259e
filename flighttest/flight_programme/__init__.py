"""flighttest/flight_programme"""
