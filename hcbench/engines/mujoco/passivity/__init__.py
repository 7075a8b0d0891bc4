"""Whether MuJoCo's own contact ever gives energy: in the model of its rows, and in plain steps."""
