"""The talks' figures."""
