"""Studies: a module, or a folder, for each question of the report; each has a `STUDY` and is found by being here."""
