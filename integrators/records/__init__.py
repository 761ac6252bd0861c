"""The records of the methods, one module for each kind of method."""
