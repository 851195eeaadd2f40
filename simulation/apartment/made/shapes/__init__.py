"""What models of our own are put together from. All in metres, x out of a piece's front, y left, z up."""
