"""Observer architectures: objectives (J is one), searches, proof of optimality."""
