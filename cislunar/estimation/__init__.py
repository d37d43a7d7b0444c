"""Orbit and attitude estimation."""
