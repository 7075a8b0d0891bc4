"""Newton."""
