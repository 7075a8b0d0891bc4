"""Hunt & Crossley 1975 worked through: every figure redrawn, every printed number computed again."""
