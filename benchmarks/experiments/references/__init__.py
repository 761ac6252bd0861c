"""Do the certified references hold?"""
