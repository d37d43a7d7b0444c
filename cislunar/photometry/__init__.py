"""Apparent magnitude of spheres, of convex facets and of bodies that shadow themselves."""
