"""Settings of MuJoCo's own contact."""
