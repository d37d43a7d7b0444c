"""Observer architectures: cost, optimisers, optimality certificate."""
