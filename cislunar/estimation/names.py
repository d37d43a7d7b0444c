"""Names of the estimators, in a module that imports nothing."""

ESTIMATORS = ("mukf", "batch")
"""The paper's filter, and the batch estimator of the attitude with a filter of the orbit."""
