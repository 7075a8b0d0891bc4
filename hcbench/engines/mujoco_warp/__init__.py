"""MuJoCo Warp: MuJoCo on GPUs, in float32, on the scenes of MuJoCo."""
