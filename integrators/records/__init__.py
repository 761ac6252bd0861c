"""The records of the integration methods (`record.Method`), one module for each kind of method."""
