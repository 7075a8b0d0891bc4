"""Engines against measured impacts: the error of each setting, with its
floors and what cannot be told.
"""
