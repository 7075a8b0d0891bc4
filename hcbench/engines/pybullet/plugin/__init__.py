"""The law as a plug-in for PyBullet."""
