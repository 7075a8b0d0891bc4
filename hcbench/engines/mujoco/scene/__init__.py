"""MuJoCo: hcbench's own scenes, compiled, stepped and read."""
