"""Batch estimation of attitude from whole light curves."""
