"""Do the intervals of an estimated energy drift cover the true drift?"""
