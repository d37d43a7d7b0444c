"""Orbits of the CR3BP among Earth, Moon and Sun as they are: held by thrust, or refined."""
