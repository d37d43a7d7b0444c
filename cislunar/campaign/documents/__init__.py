"""Numbers of a finished campaign in README and docs."""
