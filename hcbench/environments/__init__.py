"""Python environments that each hold one engine in one version, in the user's data folder.

hcbench itself is not copied there: a worker process in such an environment imports the very package
that started it (`hcbench.sim.remote`), so there is none that could be out of date.
"""

# The command that installs a missing engine.
ADD = "hcbench engines add"
