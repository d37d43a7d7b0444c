"""Proof of the largest value: branch and bound for any objective, bounds and relaxation of J."""
