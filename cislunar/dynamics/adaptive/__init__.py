"""Integrators whose steps adapt to a tolerance: of one trajectory, and of many side by side."""
