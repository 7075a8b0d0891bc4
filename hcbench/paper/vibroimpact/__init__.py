"""The paper's vibro-impact system: a body between two contacts, driven."""
