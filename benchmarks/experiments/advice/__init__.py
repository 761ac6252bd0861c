"""Is what is advised what was asked for, and how far is it from the best?"""
