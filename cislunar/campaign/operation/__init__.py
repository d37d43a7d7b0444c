"""Running a campaign: damaged results, times, resources."""
