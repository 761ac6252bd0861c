"""Do the intervals of a drift cover it?"""
