"""Figures of orbits, architectures and targets in space."""
