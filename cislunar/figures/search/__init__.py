"""Figures of searches and sweeps."""
