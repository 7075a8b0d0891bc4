"""Rapier: rigid contact with Newton's restitution, in 32-bit numbers."""
