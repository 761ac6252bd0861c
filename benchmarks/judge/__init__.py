"""Judges claims about an integrator (order, symplecticity, conservation, ...) from rows of measurements.

``evidence``
    what one row shows: a structure is kept or broken, an error is bounded or drifts, an order agrees or not
``decide``
    the verdict that the rows of all systems give together, by the standard of a certificate or of an audit
``checks``
    one check per claim: the values it may take, the rows it reads, its judgement
``requirements``
    what every integrator has to satisfy, whatever is claimed of it
``judge``
    applies all checks to all claims and gives the overall verdict
``verdict``
    the possible outcomes, and `Judgement`: outcome, measured number, interval, deciding systems and reason
"""
