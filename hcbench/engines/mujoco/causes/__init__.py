"""What keeps a pair in a MuJoCo model from bouncing, with fixes."""
