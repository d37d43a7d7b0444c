"""Recursive estimation: the paper's multiplicative unscented filter, and orbits by angles alone."""
