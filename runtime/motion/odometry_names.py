"""Names of odometries by what their lengths depend on. No imports: the command line's help reads them."""

PICTURE_ODOMETRIES = ("hybrid", "flow", "planar", "window")  # lengths are in proportion to the height of the lens
