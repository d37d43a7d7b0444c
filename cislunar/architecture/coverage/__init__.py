"""Coverage of static targets: measures, objectives, greedy, search and certified bound."""
