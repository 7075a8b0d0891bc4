"""What Drake is asked to simulate beyond the scenes of one bounce."""
