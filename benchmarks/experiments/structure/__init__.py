"""Which methods are symplectic and symmetric?"""
