"""Work that comes in units, done at once."""


def ended(work, units=None):
    """The result of a generator of units of work; `units` takes what it yields."""
    units = [] if units is None else units
    try:
        while True:
            units.append(next(work))
    except StopIteration as end:
        return end.value
