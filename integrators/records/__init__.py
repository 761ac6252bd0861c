"""The records (`record.Method`: coefficients, declared properties) of the integration methods, by kind of method."""
