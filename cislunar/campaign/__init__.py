"""A campaign: settings, data sets, tables, verdicts and documents around the library."""
