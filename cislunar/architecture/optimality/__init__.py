"""Proof of the largest J: relaxation, bounds, branch and bound."""
