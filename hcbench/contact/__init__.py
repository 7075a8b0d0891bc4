"""Hunt-Crossley contact that a simulation of your own can load."""
