"""MuJoCo: a user's own model, measured and tuned."""
