"""Exudyn: sphere contact that has eq. (16) as a setting, plates and true cups."""
