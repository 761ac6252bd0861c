"""Pages that list what the project has: methods, problems, coefficient tables."""
