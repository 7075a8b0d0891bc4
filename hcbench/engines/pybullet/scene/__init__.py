"""PyBullet: hcbench's own scenes, loaded, stepped and read."""
