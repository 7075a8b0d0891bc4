"""Energy tests of MuJoCo's own contact: in the model of its rows, and in plain steps."""
