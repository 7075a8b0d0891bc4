"""Vibro-impact system of the paper: a body between two contacts, driven."""
