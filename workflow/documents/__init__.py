"""Pages and tables of the repository's documents, generated from the campaign's results."""
