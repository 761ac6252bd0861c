"""The methods' records, a module for each kind."""
