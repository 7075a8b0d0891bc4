"""Scenes for Drake beyond those of one bounce."""
