"""Systems to integrate: from formulae or from loops written by hand, and systems derived from other ones."""
