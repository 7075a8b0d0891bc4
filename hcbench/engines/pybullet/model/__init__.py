"""PyBullet: a user's own world, measured."""
