"""Which methods, problems and coefficients are there?"""
