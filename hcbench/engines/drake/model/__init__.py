"""Users' models in Drake: files that it loads, with a pair in them, measured as they are."""
