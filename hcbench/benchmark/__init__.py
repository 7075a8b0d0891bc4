"""Runs studies: every setting at every speed and phase, in one process, several, or a cluster."""
