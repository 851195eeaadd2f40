"""Building blocks of the procedural models. All in metres, x out of a piece's front, y left, z up."""
