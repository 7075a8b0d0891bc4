"""Recipes: from a target to a setting of one engine."""
