"""hcbench measures how physics engines really bounce."""
