"""Orbit and attitude estimation: the role of an estimator and what its kinds share."""
