"""How every engine is driven: the contract, the registry, the stop rule. Knows no engine."""
