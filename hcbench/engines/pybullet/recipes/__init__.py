"""Settings of PyBullet's own contact."""
