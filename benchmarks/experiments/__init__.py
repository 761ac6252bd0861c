"""Experiments: a folder for each question, with its measurements, the page that answers it, and the page's figures."""
