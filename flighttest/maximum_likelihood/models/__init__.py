"""Linear models in state space, the Kalman filter, the test for turbulence."""
