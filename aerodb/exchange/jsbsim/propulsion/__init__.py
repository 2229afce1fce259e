"""Propellers, piston engines and turboprops of JSBSim."""
