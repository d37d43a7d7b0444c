"""Apparent magnitude of spheres and of faceted objects."""
