"""Information about moving targets: tables, objectives, greedy, search and certified bound."""
