"""Earlier name of `hcbench.laws`."""
