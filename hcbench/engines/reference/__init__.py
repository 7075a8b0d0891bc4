"""The law itself as an engine: eq. (16) and its ODE."""
