"""MuJoCo MJX."""
