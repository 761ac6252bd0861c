"""The parts of a report page: verdicts, tables, figures and their style, Markdown and HTML."""
