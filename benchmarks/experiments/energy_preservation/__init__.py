"""Do Schemes IV and V keep the energy, and what does it cost?"""
