"""A folder a question: what is measured, the page that answers, its figures."""
