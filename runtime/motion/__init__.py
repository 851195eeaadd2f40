"""The robot's motion and attitude: health, rest, tracker, odometries and their judges."""
