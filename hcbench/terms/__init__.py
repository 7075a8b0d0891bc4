"""Terms of an impact: units, options, scene, setting, launch and impact, and their table of fields."""
