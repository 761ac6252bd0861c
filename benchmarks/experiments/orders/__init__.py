"""Does every method have its order?"""
