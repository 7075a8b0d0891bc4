"""OpenSim: Simbody's Hunt-Crossley contact."""
