"""Contact laws: Hertz contact, the law of Hunt and Crossley and those
published since. Knows no engine.
"""
