"""Attitude parameters and rigid-body rotation."""
