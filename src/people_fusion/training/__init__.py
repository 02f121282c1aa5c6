"""Floor 3: models learned from recordings and simulation."""
