"""Pairs of materials whose restitution somebody measured and published, each with its source."""
