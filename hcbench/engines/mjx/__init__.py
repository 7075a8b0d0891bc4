"""MuJoCo MJX: MuJoCo written in JAX, on the scenes of MuJoCo."""
