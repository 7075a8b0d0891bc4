"""Trajectories recorded elsewhere, read from files."""
