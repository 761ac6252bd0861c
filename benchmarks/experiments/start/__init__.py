"""How long until the first result?"""
