"""What a campaign is told: settings, scenarios, variants, sweeps, and what is refused."""
