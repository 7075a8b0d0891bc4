"""Settings that match a law: one recipe a file."""
