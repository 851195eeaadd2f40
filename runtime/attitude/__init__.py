"""How the camera is tilted in each frame, and where that is known from."""
