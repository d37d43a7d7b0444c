"""Which observer looks at which target: the worth of pairs, and the best tasking."""
