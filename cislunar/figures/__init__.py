"""Figures, each drawn from data sets of the campaign."""
