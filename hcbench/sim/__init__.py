"""The contract of an engine, the registry of engines, and the rule that ends a
launch. Knows no single engine.
"""
