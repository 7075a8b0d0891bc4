"""Settings that match a law: what to match, which recipe, and how well the engine then does."""
