"""The truth: Hertz contact and the law of Hunt and Crossley. Knows no engine."""
