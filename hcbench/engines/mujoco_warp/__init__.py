"""The engine MuJoCo Warp."""
