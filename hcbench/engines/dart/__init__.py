"""DART: rigid contact with Newton's restitution, in one step."""
