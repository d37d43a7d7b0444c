"""Periodic orbits of the CR3BP: correction, continuation, families, stability."""
