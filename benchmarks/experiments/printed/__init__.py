"""Are the talks' printed tables reproduced?"""
